"""Free-running simulation of tests, its errors, and the faults that it finds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from eightpost.ident.vehicle.common_poles import CommonPoles
from eightpost.ident.vehicle.simulation import fault_in_simulation, free_running, with_dampers
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction, IdentifiedVehicle, add_port_damping, read_vehicle, shipped

from .conftest import BASELINE, COULOMB, rig_tests

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


def test_the_simulation_has_the_times_and_outputs_of_the_test(car, smooth, experiment):
    found = free_running(car, smooth[0], experiment.ports)
    assert set(experiment.outputs) <= set(found.names)
    np.testing.assert_allclose(found.time, smooth[0].time)


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


@pytest.mark.nightly
def test_springs_of_the_tests_are_springs_of_the_car(experiment):
    tests = rig_tests(0.0, 40, progression=2.0)
    found = CommonPoles(samples=0).identify(tests, experiment)
    rate = 1280.0 * 4.4482216152605 / 0.0254
    assert found.vehicle.friction[""].spring == pytest.approx(2.0 * rate, rel=0.1)
    assert found.trust is not None
    assert "port springs" in found.trust.flags
