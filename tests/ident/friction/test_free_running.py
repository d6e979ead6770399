"""Simulation of an identified car: of its tests, of the faults that it finds, and with shock laws at its ports."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from eightpost.ident.validation.comparison import rig_record
from eightpost.ident.validation.vehicles import validate_vehicle
from eightpost.ident.vehicle.common_poles import CommonPoles
from eightpost.ident.vehicle.port_search import FrictionSearch
from eightpost.ident.vehicle.simulation import fault_in_simulation, free_running, with_dampers
from eightpost.shock import Polylinear, StaticCurve
from eightpost.signals import TimeSeries
from eightpost.units import convert
from eightpost.vehicle import Bristle, Friction, IdentifiedVehicle, add_port_damping, read_vehicle, shipped
from eightpost.virtual import NO_DRIFT, LinearDamper, RigSensors, random_drive, run_test

from .conftest import BASELINE, COULOMB, rig_tests, rubbing_car

BAND = (0.5, 15.0)


@pytest.fixture(scope="module")
def car(experiment):
    """Return the exact car without friction, around the baseline damping."""
    model = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": BASELINE})
    return IdentifiedVehicle("car", model.select(outputs=experiment.outputs), {"": BASELINE})


def without_means(test):
    rows = {n: (test.unit(n), test[n] - test[n].mean()) for n in test.names}
    return TimeSeries.from_channels(test.time, rows)


def errors_of(car, test, experiment):
    """Return the RMS errors of the simulated outputs and those of their levels, over the measured levels in a band."""
    test = without_means(test)
    simulated, sizes = free_running(car, test, experiment.ports), []
    settled = slice(round(3.0 * test.sample_rate), None)
    for name in experiment.outputs:
        lines = np.fft.rfft(np.stack([simulated[name], test[name]])[:, settled] * np.hanning(len(test.time[settled])))
        frequency = np.fft.rfftfreq(len(test.time[settled]), 1.0 / test.sample_rate)
        lines = lines[:, (frequency >= BAND[0]) & (frequency <= BAND[1])]
        sizes.append([np.linalg.norm(rows) for rows in (lines[0] - lines[1], *lines)])
    error, found, measured = np.array(sizes).T
    return error / measured, found / measured - 1.0


def test_the_exact_car_predicts_a_test_with_either_damper(car, smooth, experiment):
    for test in smooth:
        error, level = errors_of(car, test, experiment)
        assert np.abs(level).max() < 0.01
        assert error.max() < 0.04  # the records have 1 % noise, and begin at rest


def test_a_linear_car_has_the_exact_response_to_inputs_with_straight_lines_between_samples(car):
    time = np.arange(1250) / 1250.0
    road = 0.004 * np.sin(2.0 * np.pi * 3.0 * time)  # without a mean
    found = with_dampers(car, TimeSeries.from_channels(time, {"road": ("m", road)}), {"": 2.0 * BASELINE}, every=3)
    model = add_port_damping(car.state_space, {"": BASELINE}).select(inputs=["road"])
    expected = lsim((model.A, model.B, model.C, model.D), road, time)[1].T
    size = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found / size, expected[:, ::3] / size, atol=1e-5)


def test_a_car_without_the_friction_of_the_tests_has_a_larger_error(car, rubbing, experiment):
    sticks = replace(car, friction={"": Friction(bristle=Bristle(COULOMB, 9.5e-5, 1.1))})
    with_friction, without = (errors_of(one, rubbing[0], experiment)[0] for one in (sticks, car))
    assert np.linalg.norm(with_friction) < 0.2 * np.linalg.norm(without)


def test_a_sound_car_has_no_fault(car, smooth):
    assert fault_in_simulation(replace(car, friction={"": Friction(bristle=Bristle(COULOMB))}), smooth) is None


def test_a_baseline_shorter_than_the_simulation_is_used_whole(car, smooth):
    short = smooth[0].window(0.0, 6.0)
    assert fault_in_simulation(replace(car, friction={"": Friction(bristle=Bristle(COULOMB))}), [short]) is None


def test_a_port_spring_that_tips_the_car_over_is_a_fault(car, smooth):
    fault = fault_in_simulation(replace(car, friction={"": Friction(spring=-1e9)}), smooth)
    assert fault is not None
    assert "baseline damping" in fault


@pytest.mark.nightly
def test_the_recipe_falls_back_to_simpler_laws_if_a_car_cannot_be_simulated(rubbing, experiment, monkeypatch):
    def no_bristles(vehicle, _tests):
        return "it failed" if any(law.bristle.force for law in vehicle.friction.values()) else None

    monkeypatch.setattr("eightpost.ident.vehicle.common_poles.fault_in_simulation", no_bristles)
    found = CommonPoles(samples=0).identify(rubbing, experiment)
    assert found.vehicle.friction[""].force > 0.8 * COULOMB
    assert not found.vehicle.friction[""].bristle.force
    assert any("friction that sticks up to" in note and "rejected: it failed" in note for note in found.notes)


#: A damper that no test of the identification had.
FIRM = 1.5 * BASELINE


def _law(rate):
    """Return the law F = rate v."""
    speed = 0.4
    outer = (rate * speed, rate * speed, 0.0, 0.0)
    inner = (rate * speed, *[0.0] * 14)
    return Polylinear(StaticCurve(inner, outer, tuple(-c for c in outer), speed, 0.01, 5.0, 5.0, rate, rate))


@pytest.fixture(scope="module")
def unseen():
    """Return a test of the same car on another drive with a firmer damper."""
    car = rubbing_car(COULOMB)
    drive = random_drive(car, 91, duration=30.0)
    return run_test(car, drive, (LinearDamper(FIRM),), seed=91, sensors=RigSensors.perfect(), drift=NO_DRIFT)


@pytest.fixture(scope="module")
def fit(rubbing, experiment):
    """Return the vehicle identified from the tests with friction."""
    search = FrictionSearch(velocities=(0.01,), reaches=())
    return CommonPoles(friction=search, springs=None, samples=0).identify(rubbing, experiment)


def test_laws_at_the_ports_give_the_levels_of_the_rig_only_with_friction(fit, unseen):
    record = rig_record(unseen, fit.vehicle.state_space)
    (case,) = validate_vehicle(fit, [record], shocks={"": _law(FIRM)}).cases
    assert case.shocks == "shock laws, ports closed"
    assert case.without_friction is not None
    assert max(abs(one.level) for one in case.judged) < 0.01
    assert max(one.error for one in case.judged) < 0.1
    names = {one.name for one in case.judged}
    assert max(abs(one.level) for one in case.without_friction if one.name in names) > 0.03


@pytest.mark.nightly
def test_springs_of_the_tests_are_springs_of_the_car(experiment):
    found = CommonPoles(samples=0).identify(rig_tests(0.0, 40, progression=2.0), experiment)
    assert found.vehicle.friction[""].spring == pytest.approx(2.0 * convert(1280.0, "lbf/in", "N/m"), rel=0.1)
    assert "port springs" in found.trust.flags


def test_a_wrong_law_at_the_port_gives_wrong_levels(fit, unseen):
    record = rig_record(unseen, fit.vehicle.state_space)
    (case,) = validate_vehicle(fit, [record], shocks={"": _law(0.5 * FIRM)}).cases
    assert max(abs(one.level) for one in case.judged) > 0.1
