"""Shocks on the virtual rig have the same forces as in other simulations."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from eightpost.shock import LAWS
from eightpost.signals import TimeSeries
from eightpost.virtual import LinearDamper, configuration, demo_damper


def _beside(name):
    """Import a module from this folder, which is not a package."""
    spec = importlib.util.spec_from_file_location(f"eightpost_tests_{name}", Path(__file__).with_name(f"{name}.py"))
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


reference = _beside("reference_march")

STEP = 2e-4
TIME = STEP * np.arange(2001)
PLACE = 0.004 * (1.0 - np.cos(2 * np.pi * 4.0 * TIME)) + 0.001 * (1.0 - np.cos(2 * np.pi * 17.0 * TIME))
SPEED = 0.004 * 8 * np.pi * np.sin(2 * np.pi * 4.0 * TIME) + 0.001 * 34 * np.pi * np.sin(2 * np.pi * 17.0 * TIME)


def forces_of(*shocks):
    """Return the forces (K, N) of several shocks for the motion, each at one corner."""
    bank = reference.ShockSet([shocks])
    rows = [np.zeros(len(shocks))]
    for k in range(1, TIME.size):
        before, after, place = (np.full((len(shocks), 1), x) for x in (SPEED[k - 1], SPEED[k], PLACE[k]))
        rows.append(bank.advance(before, after, place, STEP)[:, 0])
    return np.array(rows).T


def test_each_corner_has_its_own_shock():
    soft, hard = forces_of(LinearDamper(1000.0), LinearDamper(2000.0))
    assert soft[1:] == pytest.approx(1000.0 * SPEED[1:])
    assert hard[1:] == pytest.approx(2000.0 * SPEED[1:])


@pytest.mark.repeated(2)
@pytest.mark.parametrize("name", LAWS)
def test_a_shock_law_gives_the_same_force_as_outside_the_rig(shocks, name):
    law = shocks[name].law
    state, expected = law.start(0.0), [0.0]
    for k in range(1, TIME.size):
        state = law.advance(state, SPEED[k - 1], SPEED[k], STEP)
        expected.append(law.response(state, SPEED[k], PLACE[k]).force)
    found = forces_of(law)[0]
    assert np.abs(found[1:] - np.array(expected)[1:]).max() < 1e-9 * np.std(expected)


def test_a_demonstration_damper_agrees_with_scipys_integrator():
    damper = demo_damper("A")
    motion = TimeSeries.from_channels(TIME, {"displacement": ("m", PLACE)})
    expected = damper.respond(motion, rate=1.0 / STEP)["force"]
    assert np.abs(forces_of(damper)[0] - expected)[50:].max() < 5e-3 * np.std(expected)


def test_a_physical_damper_agrees_with_scipys_integrator():
    damper = configuration(1)
    motion = TimeSeries.from_channels(TIME, {"displacement": ("m", PLACE)})
    expected = damper.respond(motion, rate=1.0 / STEP)["force"]
    assert np.abs(forces_of(damper)[0] - expected)[50:].max() < 1e-2 * np.std(expected)
