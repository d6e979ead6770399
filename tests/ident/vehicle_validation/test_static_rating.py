"""Tests of the static rating on a car whose stiffness is known."""

from dataclasses import replace

import numpy as np
import pytest

from eightpost.errors import InputError
from eightpost.ident.vehicle.static_rating import StaticRating, rate_statically, rate_tests
from eightpost.rig import RigTest
from eightpost.rig.geometry import displacement_modes, force_modes
from eightpost.signals import TimeSeries
from eightpost.virtual.drivefiles import static_drive
from eightpost.virtual.program import NO_DRIFT, run_test, stand_in_truth
from eightpost.virtual.shocks import LinearDamper
from eightpost.virtual.simulate import RigSensors

LOADS = ("lf.aero", "rf.aero", "lr.aero", "rr.aero")


@pytest.fixture(scope="module")
def straight():
    """The stand-in without friction and with linear springs, so that its stiffness matrix is exact."""
    car = stand_in_truth().without_friction()
    zero = np.zeros_like(car.springs.progression)
    return replace(car, springs=replace(car.springs, progression=zero, stop_gap=zero + np.inf))


@pytest.fixture(scope="module")
def records(straight):
    """Records of heave, pitch, roll and warp, so small that no tire lifts."""
    return [_held(straight, kind) for kind in ("heave", "pitch", "roll", "warp")]


def _held(car, kind):
    drive = static_drive(car, kind, most=1000.0, levels=2, hold=3.0)
    sensors = RigSensors.perfect()
    return run_test(car, drive, [LinearDamper(9e3)] * 4, sensors=sensors, drift=NO_DRIFT).series.resample(125.0)


def _stiffness(car):
    """Return the stiffness matrix at the aeroloaders, from the car's elements by virtual work."""
    springs, tires = car.springs.rate[:, 0], car.tires.stiffness[:, 0]
    whole = car.stiffness + car.spring.T @ np.diag(springs) @ car.spring + car.wheel.T @ np.diag(tires) @ car.wheel
    return np.linalg.inv(car.load @ np.linalg.solve(whole, car.load.T))


def test_the_stiffness_matrix_follows_from_the_cars_elements(straight, records):
    found = rate_statically(records, LOADS)
    assert found.stiffness is not None
    assert found.unexplained is not None
    exact = _stiffness(straight)
    np.testing.assert_allclose(found.stiffness, exact, atol=5e-3 * np.abs(exact).max())
    assert found.unexplained.max() < 0.01


def test_the_rating_of_a_car_is_the_kept_one(straight, records, unchanged):
    """Of one record, the first levels have a tire without load."""
    lifted = records[1].with_channel("lr.tire_force", "N", records[1]["lr.tire_force"] - 6000.0)
    found, less = rate_statically(records, LOADS), rate_statically([*records, lifted], LOADS)
    # Without the rounding errors of entries that are zero.
    matrices = {name: np.round(getattr(found, name).ravel()[:8]) + 0.0 for name in ("stiffness", "modal")}
    rows = {mode: np.round(row, 5) + 0.0 for mode, row in found.modal_us.items()}
    says = [one.summary(("lf.tire_force", "rear.ride_height")) for one in (found, less)]
    tests = [RigTest(record.resample(1250.0)) for record in records[:2]]
    forces = {"tests": rate_tests(tests, LOADS).zero["lf.tire_force"], "levels": [found.levels, less.levels]}
    unchanged({**matrices, **rows, "says": says, **forces}, relative=1e-3)


def test_the_modal_matrix_is_the_transformed_matrix_of_the_aeroloaders(straight, records):
    found = rate_statically(records, LOADS)
    assert found.modal is not None
    assert straight.geometry is not None
    T_f, T_x = force_modes(straight.geometry), displacement_modes(straight.geometry)
    expected = T_f @ _stiffness(straight) @ np.linalg.inv(T_x)
    np.testing.assert_allclose(found.modal, expected, atol=5e-3 * np.abs(expected).max())


def test_tires_carry_the_car_at_zero_load(straight, records):
    found = rate_statically(records, LOADS)
    for corner, load in zip(straight.corners, straight.tires.static_load[:, 0], strict=True):
        assert found.zero[f"{corner}.tire_force"] == pytest.approx(load, rel=2e-3)
    assert abs(found.zero["front.ride_height"]) < 1e-4


def test_too_few_load_cases_give_levels_but_no_matrix(straight, records):
    # A load cell with an offset of 10 N is not a load case; the level does not depend on it.
    record = records[0].with_channel("lr.aero", "N", records[0]["lr.aero"] + 10.0)
    other = records[2].with_channel("rf.aero", "N", records[2]["rf.aero"] - 10.0)
    found = rate_statically([record, other], LOADS)
    assert found.stiffness is None
    assert found.zero["lf.tire_force"] == pytest.approx(float(straight.tires.static_load[0, 0]), rel=2e-3)


def test_levels_at_which_a_tire_has_no_load_are_omitted(straight, records):
    lifting = run_test(
        straight,
        static_drive(straight, "rf.aero", most=-12e3, levels=4, hold=3.0),
        [LinearDamper(9e3)] * 4,
        sensors=RigSensors.perfect(),
        drift=NO_DRIFT,
    ).series.resample(125.0)
    found = rate_statically([*records, lifting], LOADS)
    assert found.lifted > 0
    assert found.zero["rf.tire_force"] == pytest.approx(float(straight.tires.static_load[1, 0]), rel=2e-3)


def test_records_without_constant_loads_are_rejected(records):
    time = np.arange(1000) / 125.0
    moving = TimeSeries.from_channels(time, {"lf.aero": ("N", 1e3 * np.sin(6.0 * time)), "lf.tire_force": ("N", time)})
    with pytest.raises(InputError, match="0 levels"):
        rate_statically([moving], ["lf.aero"])
    with pytest.raises(InputError, match="none of the loads"):
        rate_statically(records, ["aero_force"])


def test_the_modal_matrix_is_in_thousands_of_pounds_and_feet_per_inch_and_degree():
    """1000 lbf/in, lbf per degree, lbf.ft/in and lbf.ft per degree are 1 in every place of the table."""
    pound, foot, inch, degree = 4.4482216152605, 0.3048, 0.0254, np.pi / 180.0
    forces, steps = 1e3 * pound * np.array([1.0, foot, foot, foot]), np.array([inch, degree, degree, degree])
    rating = StaticRating(5, 0, LOADS, {}, modal=forces[:, None] / steps)
    assert list(rating.modal_us) == ["heave", "pitch", "roll", "warp"]
    np.testing.assert_allclose(list(rating.modal_us.values()), 1.0)
    assert StaticRating(5, 0, LOADS, {}).modal_us == {}
