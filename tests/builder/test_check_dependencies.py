"""Feedthrough over tiny steps: seen under the motion of states, and not mistaken for an internal step of the FMU."""

from math import cos, floor, sqrt
from types import SimpleNamespace

import pytest

from builder.check import check
from builder.check.probes import dependencies
from builder.check.probes.dependencies import Pairs, _perturb
from eightpost.fmi import Variable

ROAD = Variable(0, "road", "0", "Real", "input", "continuous", None, "", {"unit": "m", "start": "0"})
HEIGHT = Variable(1, "height", "1", "Real", "output", "continuous", None, "", {"unit": "m"})

#: Squared frequency of the mass [rad2/s2].
STIFF = 5e3


def mass(u, h):
    """Return the position of a mass on a spring that stands on the road, from rest."""
    return 0.03 + u * (1.0 - cos(sqrt(STIFF) * h))


def internal(u, h, size=2.5e-4):
    """Return the same by explicit steps of an internal size, at least one."""
    x = v = 0.0
    for _ in range(max(1, floor(h / size * (1 + 1e-9)))):
        v += size * STIFF * (u - x)
        x += size * v
    return 0.03 + x


def chassis(u, h):
    """Return the position of a mass on that mass: its motion begins with the fourth power of the step."""
    return 0.03 + u * STIFF**2 * h**4 / 24.0


LAWS = {
    "a gain": (lambda u, h: 0.2 * u, True),
    "a gain and a mass": (lambda u, h: 0.2 * u + mass(u, h), True),
    "a gain and a chassis": (lambda u, h: 0.2 * u + chassis(u, h), True),
    "a small gain and a mass": (lambda u, h: 1e-3 * u + mass(u, h), True),
    "a chassis": (chassis, False),
    "a mass": (mass, False),
    "a mass in internal steps": (internal, False),
    "a mass in internal steps as long as the step": (lambda u, h: internal(u, h, 1e-3), False),
    "a speed": (lambda u, h: u * h, False),
    "nothing": (lambda u, h: 0.03, False),
}


@pytest.mark.parametrize("name", LAWS)
def test_feedthrough_is_observed_if_and_only_if_there_is_any(name):
    law, has_any = LAWS[name]
    bench = SimpleNamespace(inputs=[ROAD], outputs=[HEIGHT], timing=SimpleNamespace(step=1e-3))
    there = SimpleNamespace(bench=bench, inputs=[0.002], after=lambda inputs, h: [law(inputs[0], h)])
    pairs = Pairs({"height": {"road"}}, {"road"})
    _perturb(bench, there, pairs)
    assert (pairs.unseen_knowns() == set()) is has_any


@pytest.mark.parametrize(("law", "has_any"), [
    (lambda u, h: 1e3 * u * (h + 7e5 * h * h), False),  # a speed that grows within microseconds
    (lambda u, h: 1e3 * u * (h + 1.5e6 * h * h), False),
    (lambda u, h: 1e3 * u * (1e-7 + h + 7e5 * h * h), True),
    (lambda u, h: 1e3 * u * (1e-6 + h + 1.5e6 * h * h), True),
])  # fmt: skip
def test_undeclared_feedthrough_is_reported_but_no_mixture_of_powers_of_the_step(law, has_any):
    bench = SimpleNamespace(inputs=[ROAD], outputs=[HEIGHT], timing=SimpleNamespace(step=1e-3))
    there = SimpleNamespace(bench=bench, inputs=[0.002], after=lambda inputs, h: [law(inputs[0], h)])
    pairs = Pairs({"height": set()}, {"road"})
    _perturb(bench, there, pairs)
    assert [rule for rule, _ in pairs.faults("over a step")] == (["dependency-hidden"] if has_any else [])


@pytest.mark.nightly
def test_all_declared_dependencies_of_a_python_car_are_observed(python_fmus):
    """Its ride heights depend on roads at once, and the motion of the chassis begins below rounding."""
    report = check(python_fmus["seven_dof"], groups=("dependencies",))
    assert {finding.rule.identifier for finding in report.findings} == set()


def test_an_input_is_tried_on_both_sides_and_on_the_other_side_of_its_start_value(monkeypatch):
    monkeypatch.setattr(dependencies, "amplitude", lambda _: 0.5)
    known = SimpleNamespace(number={"start": 1.0}.get)
    assert dependencies._others(known, 3.0) == {2.5, 3.5, -1.0}
