"""A free-running simulation of a test reveals what a model cannot represent, and ignores noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from eightpost.ident.vehicle.closed_loop import ClosedLoop, port_slope
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.model_form import ModelForm, Shares, measure_names, removable_tests
from eightpost.ident.vehicle.trust import OutputTrust
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle, add_port_damping, read_vehicle, shipped
from eightpost.vehicle.kernel import discretise

RATE, SECONDS, BASELINE, ALTERNATE = 125.0, 20.0, 3000.0, 1300.0  # two periods of the road
OUTPUTS = ("velocity", "tire_force", "hub_acceleration", "ride_height")


@pytest.fixture(scope="module")
def car():
    """The quarter car of Table 4.1 around a linear damper."""
    model = add_port_damping(read_vehicle(shipped("quarter_car")).coupled(), {"": BASELINE})
    return IdentifiedVehicle("quarter", model.select(outputs=OUTPUTS), {"": BASELINE})


def record(car, damping, *, seed=0, seconds=SECONDS):
    """A test of the car with a linear damper, simulated with exact steps at 2000 Hz."""
    model = add_port_damping(car.state_space, {"": damping - BASELINE})
    finer, generator = 16, np.random.default_rng(seed)
    count = round(seconds * RATE) * finer
    time = np.arange(count) / (RATE * finer)
    phases, frequencies = generator.uniform(0.0, 2.0 * np.pi, 200), np.arange(1, 201) / 10.0
    road = 1e-3 * sum(np.sin(2.0 * np.pi * f * time + p) for f, p in zip(frequencies, phases, strict=True))
    steps = discretise(model.A, model.B[:, [model.input_names.index("road")]], time[1])
    x, y = np.zeros(len(model.A)), np.empty((len(OUTPUTS), count))
    for k in range(count):
        if k:
            x = steps.Ad @ x + steps.B0[:, 0] * road[k - 1] + steps.B1[:, 0] * road[k]
        y[:, k] = model.C @ x + model.D[:, model.input_names.index("road")] * road[k]
    rows = {"road": ("m", road[::finer])}
    for name, unit, row in zip(OUTPUTS, ("m/s", "N", "m/s2", "m"), y, strict=True):
        rows[name] = (unit, row[::finer])
    rows["force"] = ("N", damping * y[0, ::finer])
    return TimeSeries.from_channels(time[::finer], rows)


def with_noise(test, channels, size, seed=3):
    """The record with white noise in channels, relative to their standard deviations."""
    generator = np.random.default_rng(seed)
    for name in channels:
        values = test[name] + size * test[name].std() * generator.standard_normal(len(test))
        test = test.with_channel(name, test.unit(name), values)
    return test


def whole(residual):
    """The residual in and above the band together."""
    return np.hypot(residual.inside, residual.above)


@pytest.fixture(scope="module")
def tests(car):
    """A baseline and an alternate test."""
    return record(car, BASELINE), record(car, ALTERNATE)


def experiment(car):
    return Experiment("quarter", ("road",), ("force",), OUTPUTS, {"": BASELINE})


def heavier(car):
    """The car with 20 % more force at the tire per road than it has."""
    wrong = car.state_space
    C, D = wrong.C.copy(), wrong.D.copy()
    C[1], D[1] = 1.2 * C[1], 1.2 * D[1]
    return replace(car, state_space=replace(wrong, C=C, D=D))


@pytest.mark.parametrize("which", [0, 1])
def test_the_true_car_reproduces_its_tests_whatever_shock_they_have(car, tests, which):
    simulated, measured = ClosedLoop().outputs(car, tests[which])
    assert port_slope(tests[which], "") == pytest.approx((BASELINE, ALTERNATE)[which])
    error = (simulated - measured).std(axis=1) / measured.std(axis=1)
    assert error.max() < 2e-3


def test_a_wrong_output_has_a_residual_and_the_others_have_none(car, tests):
    found = ModelForm().residual(heavier(car), tests[0], 16.0)
    assert whole(found)[1] == pytest.approx(0.2, rel=0.02)
    assert np.delete(whole(found), 1).max() < 3e-3


def test_the_residual_is_split_at_the_upper_limit_of_the_band(car, tests):
    low, high = (ModelForm().residual(heavier(car), tests[0], limit) for limit in (5.0, 12.0))
    assert low.inside[1] < high.inside[1]
    assert low.above[1] > high.above[1]
    assert low.share[1] > high.share[1] > 0.0
    assert whole(low)[1] == pytest.approx(whole(high)[1], rel=1e-3)
    assert low.above[1] == pytest.approx(0.2 * low.share[1] ** 0.5, rel=0.05)


@pytest.mark.repeated
@pytest.mark.parametrize("channels", [OUTPUTS[1:], ("road",), ("force", "velocity"), (*OUTPUTS, "road", "force")])
def test_white_noise_of_outputs_and_of_inputs_is_not_a_residual_of_the_model(car, tests, channels):
    left, plain = [], []
    for seed in range(6):
        noisy = with_noise(tests[0], channels, 0.02, seed)
        simulated, measured = ClosedLoop().outputs(car, noisy)
        plain.append((simulated - measured).std(axis=1) / measured.std(axis=1))
        left.append(whole(ModelForm().residual(car, noisy, 25.0)))
    assert np.mean(plain, axis=0).max() > 0.015
    assert (np.mean(left, axis=0) < np.maximum(0.5 * np.mean(plain, axis=0), 2e-3)).all()


def test_a_wrong_output_is_found_in_noise(car, tests):
    noisy = with_noise(tests[0], (*OUTPUTS, "road", "force"), 0.02)
    assert ModelForm().residual(heavier(car), noisy, 25.0).inside[1] == pytest.approx(0.2, rel=0.03)


def test_errors_grow_with_the_residual_and_include_noise(car, tests):
    settings = ModelForm(inside=Shares(0.5, 2.0), above=Shares(0.5, 2.0), noise=Shares(1.5, 4.0))
    quiet = settings.uncertainty(car, tests, experiment(car), (0.1, 25.0))
    wrong = settings.uncertainty(heavier(car), tests, experiment(car), (0.1, 25.0))
    assert wrong["tire_force"].common == pytest.approx(0.1, rel=0.03)
    assert wrong["tire_force"].own == pytest.approx(0.4, rel=0.03)
    assert wrong["velocity"].common < 2e-3
    noise = {"velocity": OutputTrust(0.01, 0.05, 1.0)}
    loud = settings.uncertainty(car, tests, experiment(car), (0.1, 25.0), outputs=noise)["velocity"]
    assert loud.common == pytest.approx(0.075, rel=0.01)
    assert loud.own == pytest.approx(0.2, rel=0.01)
    assert quiet["velocity"].common < 2e-3


def test_where_the_tests_have_no_power_above_the_band_nothing_is_known_of_a_measure_that_has():
    settings = ModelForm(above=Shares(0.1, 0.4))
    excited, quiet = settings.of_residual(0.01, 0.02, 0.04, 0.0), settings.of_residual(0.01, 1e-5, 1e-5, 0.0)
    assert (excited.common_above, excited.own_above) == pytest.approx((0.01, 0.04))  # an error of 10 % there
    assert (quiet.common_above, quiet.own_above) == pytest.approx((0.1, 0.4))  # an error of 100 %
    assert quiet.common < excited.common
    assert quiet.at_share(0.3).common > 3.0 * excited.at_share(0.3).common


def unstable(car):
    """The car with a growing motion of 5 Hz that all outputs show."""
    model, block = car.state_space, np.array([[8.0, 31.4], [-31.4, 8.0]])
    A = np.block([[model.A, np.zeros((len(model.A), 2))], [np.zeros((2, len(model.A))), block]])
    B = np.vstack([model.B, np.ones((2, model.B.shape[1]))])
    C = np.hstack([model.C, np.ones((len(OUTPUTS), 2))])
    return replace(car, state_space=replace(model, A=A, B=B, C=C))


def test_no_uncertainty_is_stated_for_a_car_whose_simulation_diverges(car, tests):
    wrong = unstable(car)
    assert ModelForm().uncertainty(wrong, tests, experiment(car), (0.1, 16.0)) == {}
    three = (*tests, record(car, ALTERNATE, seed=5))
    plain = ModelForm().uncertainty(car, three, experiment(car), (0.1, 16.0))
    assert ModelForm().uncertainty(car, three, experiment(car), (0.1, 16.0), refit=lambda kept: wrong) == plain


def test_only_a_test_without_which_the_shocks_still_differ_is_left_out(car, tests):
    assert removable_tests(tests, ("",)) == ()
    three = (*tests, record(car, ALTERNATE, seed=5))
    assert removable_tests(three, ("",)) == (1, 2)
    asked = []

    def refit(kept):
        asked.append(tuple(kept))
        return car

    ModelForm().uncertainty(car, three, experiment(car), (0.1, 16.0), refit=refit)
    assert asked == [(0, 2), (0, 1)]


def test_a_car_with_four_wheels_has_the_sum_of_its_tire_forces_as_a_measure():
    assert measure_names(("velocity", "tire_force")) == ("velocity", "tire_force")
    assert measure_names(("lf.tire_force", "rf.tire_force"))[-1] == "total_tire_force"
