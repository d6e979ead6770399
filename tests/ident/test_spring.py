"""Maxwell's law marched on a table of the curve is the law stepped by its own functions."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from eightpost.ident.shock.curve.basis import curve_forces
from eightpost.ident.shock.laws.compiled import stepped_force
from eightpost.ident.shock.laws.spring import Table, spring_force
from eightpost.shock import Maxwell

STEP = 5e-4


def table(curve, count=4001):
    velocity = np.linspace(-1.0, 1.0, count)
    return Table(-1.0, velocity[1] - velocity[0], curve_forces(curve, velocity))


@pytest.fixture
def velocity():
    """Three sines, up to 0.9 m/s and 60 m/s2."""
    time = np.arange(4000) * STEP
    return 0.4 * np.sin(6.0 * time) + 0.3 * np.sin(70.0 * time + 1.0) + 0.2 * np.sin(170.0 * time + 2.0)


@pytest.mark.parametrize("stiffness", [3e5, 4e6, 5e7])
def test_the_force_is_the_laws_own(curve, velocity, stiffness):
    law = Maxwell(curve, stiffness)
    valve = law.valve._replace(curve=law.curve.numbers())
    expected = stepped_force(Maxwell, valve, (stiffness,), velocity, np.full(velocity.size - 1, STEP))
    found = spring_force(table(curve), stiffness, velocity, STEP)
    assert np.sqrt(np.mean((found - expected) ** 2)) < 1e-5 * np.ptp(expected)
    assert np.abs(found - expected).max() < 1e-3 * np.ptp(expected)


def test_a_straight_curve_is_a_lag(velocity):
    slope, stiffness = 3000.0, 2e6
    straight = Table(-1.0, 2.0, np.array([-slope, slope]))
    found = spring_force(straight, stiffness, velocity, STEP)
    tau, fine = slope / stiffness, np.arange((velocity.size - 1) * 20 + 1) * STEP / 20
    drive = np.interp(fine, np.arange(velocity.size) * STEP, velocity)
    force = [slope * drive[0]]
    for v0, v1 in pairwise(drive):  # the midpoint rule, on a twentieth of the step
        rate = (slope * 0.5 * (v0 + v1) - force[-1]) / (tau + 0.5 * STEP / 20)
        force.append(force[-1] + rate * STEP / 20)
    np.testing.assert_allclose(found, force[::20], atol=1e-3 * slope)


def test_on_a_flat_stretch_the_valves_follow_at_once():
    """Flat beyond 0.2 m/s: the force is that of the flat stretch while the velocity is there."""
    flat = Table(-1.0, 0.2, np.array([-600.0, -600.0, -600.0, -600.0, -600.0, 0.0, 600.0, 600.0, 600.0, 600.0, 600.0]))
    velocity = np.concatenate([np.full(10, 0.9), np.full(10, 0.5)])
    np.testing.assert_allclose(spring_force(flat, 1e6, velocity, STEP), 600.0)
