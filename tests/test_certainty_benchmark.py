"""The simulations of the certainty benchmark: its levels and the effects of its shocks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.certainty_levels import Shocks, changed_law, shock_effects, simulated_levels
from eightpost.corners import CORNERS
from eightpost.rig import BUILDS
from eightpost.rig.post import Actuators, track_drive, truth_named
from eightpost.shock import read_shock
from eightpost.uncertainty import TOTAL
from eightpost.vehicle import IdentifiedVehicle, add_port_damping, read_vehicle, shipped

pytestmark = pytest.mark.nightly

BANK = Path(__file__).resolve().parents[1] / "examples" / "bank"


@pytest.fixture(scope="module")
def shocks():
    return [read_shock(BANK / f"{build.replace('/', '_')}.json") for build in BUILDS[:2]]


@pytest.fixture(scope="module")
def simulated(shocks):
    """Levels of four setups of the linear car, whose identified vehicle is the car itself, with vehicle and lap."""
    car, damping = truth_named("seven_dof"), dict.fromkeys(CORNERS, 3000.0)
    model = add_port_damping(read_vehicle(shipped("seven_dof")).coupled(), damping)
    vehicle = IdentifiedVehicle("seven_dof", model, damping)
    lap = Actuators().follow(track_drive(car, 3, duration=6.0).series, car)
    laws = [shock.law for shock in shocks]
    return simulated_levels(car, vehicle, Shocks(laws, laws), lap, np.array([0, 5, 10, 15])), vehicle, lap


def test_a_vehicle_that_is_the_true_car_predicts_its_levels(simulated):
    """Three seconds after the start, 0.4 % is left of the different starts: at rest, and after a lead-in."""
    levels, _, _ = simulated
    assert TOTAL in levels.names
    np.testing.assert_allclose(levels.predicted, levels.true, rtol=5e-3)
    assert np.ptp(np.log(levels.true), axis=0).max() > 0.1


def test_effects_are_those_of_setups_with_a_changed_build(simulated, shocks):
    levels, vehicle, lap = simulated
    effects = shock_effects(vehicle, levels, lap, shocks)
    assert {one.part for one in effects} == set(BUILDS[:2])
    one = next(e for e in effects if (e.part, e.parameter) == (BUILDS[1], "rebound_scale"))
    best = int(np.argmin(levels.predicted[:, levels.names.index(TOTAL)]))
    places = np.unravel_index(levels.setups[best], (2,) * 4)
    laws = [shock.law for shock in shocks]
    laws.append(changed_law(laws[1], "rebound_scale", 1.0 + one.deviation))
    numbers = [int(np.ravel_multi_index((place, *places[1:]), (3,) * 4)) for place in (1, 2)]
    found = simulated_levels(truth_named("seven_dof"), vehicle, Shocks(laws, laws), lap, np.array(numbers)).predicted
    expected = np.log(found[1] / found[0])
    assert np.abs(expected).max() > 1e-4
    np.testing.assert_allclose([one.changes["lf"][BUILDS[1]][name] for name in levels.names], expected, atol=1e-9)


def test_a_changed_element_leaves_the_others_as_they_were():
    law = read_shock(BANK / "C_C.json").law
    assert changed_law(law, "time_constant", 0.02) == replace(law, time_constant=0.02)
