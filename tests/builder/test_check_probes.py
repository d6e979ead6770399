"""Probes of check on constructed FMUs: what they derive from a description, and what they find."""

import ctypes
import math
import random
from contextlib import nullcontext
from itertools import pairwise
from math import cos, floor, sqrt
from types import SimpleNamespace
from typing import Any

import pytest
from lxml import etree

from builder.check import check
from builder.check.probes import bench as probes
from builder.check.probes import dependencies, simulation
from builder.check.probes.bench import CallError, Skip, amplitude, change_of, differ, inside, other_value, status_name
from builder.check.probes.dependencies import Pairs, _perturb
from builder.check.probes.instances import _freed
from builder.check.probes.misuse import _locked
from eightpost.fmi import Variable, read_description


def _variable(unit: str, causality: str = "input", **given: float) -> Variable:
    texts = {name: str(value) for name, value in given.items()}
    return Variable(0, "u", "0", "Real", causality, "continuous", None, "", {"unit": unit, **texts})


@pytest.mark.parametrize(
    ("experiment", "internal", "expected"),
    [
        ({"stopTime": "10", "stepSize": "0.01"}, "", (0.0, 0.01, 300, 1000)),
        ({"startTime": "1", "stopTime": "1.5", "stepSize": "0.1"}, "", (1.0, 0.1, 5, 5)),
        ({"stopTime": "3.0", "stepSize": "0.01"}, "", (0.0, 0.01, 300, 300)),
        ({"stopTime": "20"}, "", (0.0, 0.02, 300, 1000)),
        ({"stopTime": "1", "stepSize": "2"}, "", (0.0, 2.0, 300, 1000)),
        ({"stopTime": "1", "stepSize": "1"}, "", (0.0, 1.0, 1, 1)),
        ({"stopTime": "x", "stepSize": "y"}, "", (0.0, 1e-3, 300, 1000)),
        ({"stopTime": "1e9", "stepSize": "1e-3"}, "", (0.0, 1e-3, 300, 1_000_000_000)),
        ({}, "", (0.0, 1e-3, 300, 1000)),
        ({"stopTime": "1"}, "1e-4", (0.0, 1e-3, 300, 1000)),
        ({"stopTime": "1"}, "1e-6", (0.0, 1e-4, 300, 10_000)),
        ({"stopTime": "1"}, "1e-7", (0.0, 1e-5, 300, 10_000)),
        ({"stopTime": "1"}, "0.25", (0.0, 0.25, 4, 4)),
        ({"stopTime": "1"}, "-1", (0.0, 1e-3, 300, 1000)),
        ({"stopTime": "1"}, "z", (0.0, 1e-3, 300, 1000)),
    ],
)
def test_the_steps_of_a_run_are_those_of_the_default_experiment(
    experiment: dict[str, str], internal: str, expected: tuple[float, ...]
) -> None:
    root = etree.Element("fmiModelDescription", fmiVersion="2.0")
    etree.SubElement(root, "CoSimulation", modelIdentifier="x", fixedInternalStepSize=internal)
    etree.SubElement(root, "DefaultExperiment", experiment)
    timing = probes._timing(read_description(root))
    assert (timing.start, timing.step, timing.count, timing.whole) == pytest.approx(expected, rel=1e-12)
    assert timing.at(3) == timing.start + 3 * timing.step


@pytest.mark.parametrize(
    ("variable", "size"),
    [
        *(
            (_variable(unit), size)
            for unit, size in (("m/s", 0.2), ("m", 0.005), ("N", 200.0), ("N.m", 200.0), ("rad", 0.01))
        ),
        (_variable("K", start=300.0), 30.0),
        (_variable("K", start=-300.0), 30.0),
        (_variable("1", start=0.5), 0.1),
        (_variable("1", start=2.0), 0.2),
        (_variable("m", start=1.0, min=0.998), 0.002),
        (_variable("m", start=1.0, max=1.001, min=0.0), 0.001),
        (_variable("m", start=1.0, max=1.0), 0.005),
    ],
)
def test_an_amplitude_is_that_of_the_unit_within_the_range(variable: Variable, size: float) -> None:
    assert amplitude(variable) == pytest.approx(size)
    assert change_of(variable) == pytest.approx(1e-3 * size)
    start, high = variable.number("start") or 0.0, variable.number("max")
    values = [other_value(variable, random.Random(seed)) for seed in range(100)]
    assert max(abs(value - start) for value in values) <= size
    assert max(abs(value - start) for value in values) > 0.9 * size
    assert all(high is None or value <= high for value in values)


@pytest.mark.parametrize(
    ("unit", "start", "size"),
    [("N/m", 0.0, 1e3), ("N/m2", 0.0, 1e5), ("s", 0.0, 0.1), ("s", -4.0, 0.4), ("N/m", 5.0, 0.5)],
)
def test_a_parameter_changes_by_a_tenth_or_by_the_size_of_its_unit(unit: str, start: float, size: float) -> None:
    variable = _variable(unit, "parameter", start=start)
    values = [other_value(variable, random.Random(seed)) for seed in range(200)]
    assert 0.95 * size < max(abs(value - start) for value in values) <= size
    assert change_of(variable) == pytest.approx(1e-3 * (abs(start) or size))


def test_a_value_is_moved_into_its_range() -> None:
    variable = _variable("m", start=0.0, min=-1.0, max=2.0)
    assert [inside(variable, value) for value in (-3.0, -1.0, 0.5, 2.0, 7.0)] == [-1.0, -1.0, 0.5, 2.0, 2.0]
    assert inside(_variable("m"), 1e300) == 1e300


@pytest.mark.parametrize(
    ("first", "second", "difference"),
    [
        ([[1.0, 2.0], [4.0, -8.0]], [[1.0, 2.0], [4.0, -8.0]], 0.0),
        ([[1.0, 2.0], [4.0, -8.0]], [[1.0, 2.4], [3.8, -8.0]], 0.05),
        ([[0.0]], [[0.25]], 0.25),
        ([[math.nan]], [[math.nan]], 0.0),
        ([[1.0]], [[math.inf]], math.inf),
        ([[math.nan]], [[1.0]], math.inf),
    ],
)
def test_runs_differ_by_a_share_of_the_largest_value_of_an_output(first: Any, second: Any, difference: float) -> None:
    assert differ(first, second) == pytest.approx(difference)


def test_a_status_has_the_name_of_the_standard() -> None:
    names = ["fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending"]
    assert [status_name(status) for status in range(-1, 7)] == [
        "the unknown status -1", *names, "the unknown status 6"
    ]  # fmt: skip


# ---- Feedthrough over tiny steps -------------------------------------------------------------------------------------


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


# ---- Jumps of the first outputs --------------------------------------------------------------------------------------


START = 1.0


def jump(start, h):
    return 2.0 + h if h > 0.0 else 1.0


def jump_to_rest(start, h):
    return 2.0 if h > 0.0 else 1.0


def moving(start, h):
    return 1.0 + h


def internal_steps(start, h):
    """A change within the first internal step of 5 ms, which a tiny step already shows."""
    return 1.0 + math.ceil(h / 0.005)


def jump_at_the_start_time(start, h):
    return 2.0 + h if h > 0.0 and start == START else 1.0


def jump_where_it_can_start(start, h):
    if start != START:
        raise CallError("this time is refused")
    return jump(start, h)


def probed(monkeypatch, output, can=True, variability="continuous"):
    """Return what the probe finds for an FMU of one output without inputs."""
    monkeypatch.setattr(simulation, "_outputs", lambda _bench, _inputs, start, h: [output(start, h)])
    y = SimpleNamespace(name="y", variability=variability, number=lambda _: None)
    bench = SimpleNamespace(
        description=SimpleNamespace(can=lambda _: can),
        outputs=[y],
        inputs=[],
        held=lambda _: [],
        timing=SimpleNamespace(start=START, step=0.01),
    )
    return [one for one in simulation.probe_first_outputs(bench) if isinstance(one, Skip) or one[1]]


@pytest.mark.parametrize("output", [jump, jump_to_rest, jump_where_it_can_start])
def test_an_output_that_jumps_in_a_tiny_step_is_found(monkeypatch, output):
    jumps = [("first-outputs", "y is 1 before the first step, 2 1e-07 s later")]
    assert probed(monkeypatch, output) == 2 * jumps


@pytest.mark.parametrize("output", [moving, internal_steps, jump_at_the_start_time])
def test_motion_internal_steps_and_a_jump_at_the_start_time_alone_are_no_defects(monkeypatch, output):
    assert probed(monkeypatch, output) == []


def test_a_discrete_output_may_jump(monkeypatch):
    assert probed(monkeypatch, jump, variability="discrete") == []


def test_an_fmu_of_fixed_steps_is_not_probed(monkeypatch):
    assert [type(one) for one in probed(monkeypatch, jump, can=False)] == [Skip]


OK, WARNING, ERROR = 0, 1, 3
KEPT, NULL = "the pointer is not NULL after fmi2FreeFMUstate", "fmi2FreeFMUstate of NULL is rejected"


class Fmu:
    """An FMU that frees a state with a status, keeps the pointer or not, and frees NULL with a status."""

    def __init__(self, status, keeps, status_of_null):
        self.status, self.keeps, self.status_of_null = status, keeps, status_of_null

    def state(self):
        self.pointer = ctypes.c_void_p(1)
        return self.pointer

    def call(self, function, _, note=""):
        if self.pointer.value is None:
            return self.status_of_null
        self.pointer.value = 1 if self.keeps else None
        return self.status


@pytest.mark.parametrize(
    ("fmu", "messages"),
    [
        (Fmu(OK, False, OK), []),
        (Fmu(WARNING, False, WARNING), []),
        (Fmu(OK, True, OK), [KEPT]),
        (Fmu(ERROR, False, OK), [KEPT]),
        (Fmu(ERROR, True, OK), [KEPT]),
        (Fmu(OK, False, ERROR), [NULL]),
    ],
)
def test_a_state_must_be_freed_with_its_pointer_and_null_be_ignored(fmu, messages):
    bench = SimpleNamespace(running=lambda: nullcontext(fmu))
    assert list(_freed(bench)) == [("state-freed", message) for message in messages]


def test_setting_a_fixed_parameter_between_steps_is_tried_and_a_tunable_one_not():
    def parameters(_):
        return [SimpleNamespace(name=f"{v}_gain", variability=v, number=lambda _: 1.0) for v in ("tunable", "fixed")]

    bench = SimpleNamespace(
        description=SimpleNamespace(of=parameters), outputs=[SimpleNamespace(name="force")], running=None
    )
    titles = [misuse.title for misuse in _locked(bench)]
    assert titles == ["setting the fixed fixed_gain between steps", "setting the output force"]


# ---- Ports -----------------------------------------------------------------------------------------------------------


def variable(name, unit, causality):
    return SimpleNamespace(name=name, unit=unit, causality=causality, number=lambda _: None)


class Port:
    """A port whose output is a function of its inputs' values by name; it records what it is given."""

    def __init__(self, law):
        self.law, self.given, self.rows = law, {}, []

    def set_reals(self, inputs, values):
        self.given = dict(zip((one.name for one in inputs), values, strict=True))

    def set(self, one, value):
        self.given = {one.name: value}

    def reals(self, _outputs):
        return [self.law(self.given)]

    def advance(self, time, h):
        self.rows.append((time, h, dict(self.given)))


def probed_ports(fmu, velocity="input", displacement=False, can=True):
    """Return what the probe finds for an FMU with one port."""
    force = "output" if velocity == "input" else "input"
    found = [variable("velocity", "m/s", velocity), variable("force", "N", force)]
    found += [variable("displacement", "m", velocity)] if displacement else []
    description = SimpleNamespace(
        can=lambda _: can,
        by_name={one.name: one for one in found},
        of=lambda causality: [one for one in found if one.causality == causality],
    )
    bench = SimpleNamespace(
        description=description,
        running=lambda: nullcontext(fmu),
        timing=SimpleNamespace(start=2.0, step=0.01, at=lambda point: 2.0 + 0.01 * point),
    )
    return list(simulation.probe_ports(bench))


def damper(given):
    return 1000.0 * given["velocity"]


@pytest.mark.parametrize(("can", "h"), [(True, 1e-3), (False, 0.01)], ids=["4 Hz", "fixed steps"])
def test_a_cycle_is_closed_and_its_displacement_is_the_integral_of_its_velocity(can, h):
    fmu = Port(damper)
    assert probed_ports(fmu, displacement=True, can=can) == []
    times, steps, given = zip(*fmu.rows[:250], strict=True)  # one cycle of the smallest amplitude
    assert times[:2] == (2.0, 2.0 + h) and set(steps) == {h}
    velocity, place = ([row[name] for row in given] for name in ("velocity", "displacement"))
    assert velocity == pytest.approx([0.05 * math.sin(2.0 * math.pi * k / 250) for k in range(250)])
    moved = [(later - before) / h for before, later in pairwise(place)]
    means = [0.5 * (before + later) for before, later in pairwise(velocity)]
    assert moved == pytest.approx(means, abs=1e-5)
    assert fmu.rows[250][2] == pytest.approx(given[0])  # the next cycle begins where the first one did
    assert max(row["velocity"] for *_, row in fmu.rows) == pytest.approx(0.5, rel=1e-3)


def test_a_damper_whose_force_has_the_wrong_sign_is_not_passive_either():
    found = probed_ports(Port(lambda given: -damper(given)))
    assert [rule for rule, _ in found] == ["shock-sign", "passive"] * 3
    # the energy of a cycle of 0.05 m/s at 4 Hz: pi c v^2 / omega
    energy = 1000.0 * 0.05**2 * 0.125
    assert found[1][1] == f"force produced {energy:.4g} J in a cycle of 0.05 m/s"


def test_a_spring_of_no_damping_is_passive_but_a_constant_force_has_no_sign():
    spring = Port(lambda given: 1e4 * given["displacement"] + 10.0 * given["velocity"])
    assert probed_ports(spring, displacement=True) == []
    found = probed_ports(Port(lambda given: 5.0))
    assert {rule for rule, _ in found} == {"shock-sign"}


def test_a_shock_extends_under_a_positive_force_on_the_vehicle():
    moving = {-1.0: [], 1.0: ["vehicle-sign"]}
    for sign, identifiers in moving.items():
        fmu = Port(lambda given, sign=sign: sign * 1e-3 * given["force"])
        found = probed_ports(fmu, velocity="output")
        assert [rule for rule, _ in found] == identifiers
        assert [row["force"] for *_, row in fmu.rows] == [0.0] * 5 + [200.0] * 5
    assert found[0][1] == "200 N on force moved velocity by +0.2 m/s"


def test_without_a_pair_of_velocity_and_force_nothing_is_probed():
    assert [type(one) for one in probed_ports(Port(damper), velocity="parameter")] == [Skip]
