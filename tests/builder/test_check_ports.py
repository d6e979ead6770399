"""The probe of ports drives shocks through closed cycles and pushes vehicles; fake FMUs with known answers."""

import math
from contextlib import nullcontext
from itertools import pairwise
from types import SimpleNamespace

import pytest

from builder.check.probes import simulation
from builder.check.probes.bench import Skip


def variable(name, unit, causality):
    return SimpleNamespace(name=name, unit=unit, causality=causality, number=lambda _: None)


class Fmu:
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


def probed(fmu, velocity="input", displacement=False, can=True):
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
    fmu = Fmu(damper)
    assert probed(fmu, displacement=True, can=can) == []
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
    found = probed(Fmu(lambda given: -damper(given)))
    assert [rule for rule, _ in found] == ["shock-sign", "passive"] * 3
    # the energy of a cycle of 0.05 m/s at 4 Hz: pi c v^2 / omega
    energy = 1000.0 * 0.05**2 * 0.125
    assert found[1][1] == f"force produced {energy:.4g} J in a cycle of 0.05 m/s"


def test_a_spring_of_no_damping_is_passive_but_a_constant_force_has_no_sign():
    spring = Fmu(lambda given: 1e4 * given["displacement"] + 10.0 * given["velocity"])
    assert probed(spring, displacement=True) == []
    found = probed(Fmu(lambda given: 5.0))
    assert {rule for rule, _ in found} == {"shock-sign"}


def test_a_shock_extends_under_a_positive_force_on_the_vehicle():
    moving = {-1.0: [], 1.0: ["vehicle-sign"]}
    for sign, identifiers in moving.items():
        fmu = Fmu(lambda given, sign=sign: sign * 1e-3 * given["force"])
        found = probed(fmu, velocity="output")
        assert [rule for rule, _ in found] == identifiers
        assert [row["force"] for *_, row in fmu.rows] == [0.0] * 5 + [200.0] * 5
    assert found[0][1] == "200 N on force moved velocity by +0.2 m/s"


def test_without_a_pair_of_velocity_and_force_nothing_is_probed():
    assert [type(one) for one in probed(Fmu(damper), velocity="parameter")] == [Skip]
