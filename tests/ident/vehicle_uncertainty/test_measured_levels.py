"""The level errors of a vehicle are measured on its own tests, without noise, and stated for other drives."""

import math
from dataclasses import replace

import numpy as np
import pytest

from eightpost.ident.vehicle.experiment import Experiment, port_slope
from eightpost.ident.vehicle.trust import MeasuredLevels, Powers, Trust, level_errors, measure_names, removable_tests
from eightpost.ident.vehicle.vehicle_fit import measure_table, worst_measures
from eightpost.signals import TimeSeries
from eightpost.uncertainty import MeasureUncertainty, separation, setup_distance
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


@pytest.fixture(scope="module")
def tests(car):
    """A baseline and an alternate test."""
    return record(car, BASELINE), record(car, ALTERNATE)


@pytest.fixture(scope="module")
def three(car, tests):
    """The tests, and another alternate one with another road."""
    return (*tests, record(car, ALTERNATE, seed=5))


def experiment(car):
    return Experiment("quarter", ("road",), ("force",), OUTPUTS, {"": BASELINE})


def heavier(car):
    """The car with 20 % more force at the tire per road than it has."""
    wrong = car.state_space
    C, D = wrong.C.copy(), wrong.D.copy()
    C[1], D[1] = 1.2 * C[1], 1.2 * D[1]
    return replace(car, state_space=replace(wrong, C=C, D=D))


def test_the_error_of_a_single_test_is_its_spread(car, tests):
    """It counts half, beside that of the other measures, which have almost none; a third of it is that of the mean."""
    wrong = MeasuredLevels().uncertainty(heavier(car), tests[:1], experiment(car))["tire_force"]
    (level,) = wrong.levels
    assert level.error == pytest.approx(math.log(1.2), abs=0.01)
    assert level.deviation == pytest.approx(math.sqrt(0.33 / 2.0) * level.error, rel=0.02)
    assert wrong.own == pytest.approx(math.sqrt(0.5 / 2.0) * level.error, rel=0.02)


@pytest.mark.parametrize("which", [0, 1])
def test_the_true_car_reproduces_its_tests_whatever_shock_they_have(car, tests, which):
    simulated, measured = MeasuredLevels().outputs(car, tests[which])
    assert port_slope(tests[which], "") == pytest.approx((BASELINE, ALTERNATE)[which])
    error = (simulated - measured).std(axis=1) / measured.std(axis=1)
    assert error.max() < 2e-3


def test_a_wrong_output_has_the_error_of_its_level_in_every_band_and_the_others_have_none(car, tests):
    found = MeasuredLevels().powers(heavier(car), tests[0])
    assert found.error[1] == pytest.approx(math.log(1.2), rel=0.01)
    assert np.abs(np.delete(found.error, 1)).max() < 2e-3
    assert found.spread.max() < 0.02
    assert found.shares.sum(axis=1) == pytest.approx(1.0)


def test_bands_that_err_in_opposite_directions_are_a_spread_and_no_error():
    simulated, measured = np.array([[math.exp(0.2), math.exp(-0.2)]]), np.array([[1.0, 1.0]])
    found = Powers(simulated, measured)
    assert found.error == pytest.approx(0.5 * math.log(math.cosh(0.2)))
    assert found.spread == pytest.approx(0.1)


@pytest.mark.parametrize(("share", "counts"), [(0.004, False), (0.006, True)])
def test_a_band_with_less_than_half_a_percent_of_the_power_has_no_part_in_the_spread(share, counts):
    """Noise and extrapolation decide its error, here a factor of 10."""
    measured = np.array([[0.5, 0.5 - share, share]])
    found = Powers(measured * np.array([1.0, 1.0, 100.0]), measured)
    assert (found.spread > 0.1) == [counts]


@pytest.mark.parametrize("channels", [OUTPUTS[1:], ("road",)])
def test_white_noise_of_outputs_and_of_roads_is_not_an_error_of_the_level(car, tests, channels):
    plain, left = [], []
    for seed in range(4):
        noisy = with_noise(tests[0], channels, 0.2, seed)
        simulated, measured = MeasuredLevels().outputs(car, noisy)
        plain.append(np.log(simulated.std(axis=1) / measured.std(axis=1)))
        left.append(MeasuredLevels().powers(car, noisy).error)
    worst = np.abs(np.mean(plain, axis=0)).max()
    assert worst > 0.01
    assert np.abs(np.mean(left, axis=0)).max() < 0.5 * worst


def test_an_error_that_all_tests_have_corrects_predictions_and_the_true_measures_keep_theirs(car, three):
    found = MeasuredLevels().uncertainty(heavier(car), three, experiment(car))
    assert found["tire_force"].bias == pytest.approx(math.log(1.2), rel=0.01)
    assert found["tire_force"].common < 2e-3
    assert {name: one.bias for name, one in found.items() if name != "tire_force"} == dict.fromkeys(
        ("velocity", "hub_acceleration", "ride_height"), 0.0
    )
    assert "tire_force" in MeasuredLevels().note(three, experiment(car), found)


def test_errors_that_change_with_the_shocks_are_uncertain_between_setups(car, tests):
    """The car of the second test has 20 % more tire force."""
    heavy = tests[1].with_channel("tire_force", "N", 1.2 * tests[1]["tire_force"])
    same, other = (
        MeasuredLevels().uncertainty(car, (tests[0], last), experiment(car))["tire_force"] for last in (tests[1], heavy)
    )
    error, part = math.log(1.2), 0.5  # of two tests half is pooled, and the usual measure has no such change
    powers = [MeasuredLevels().powers(car, test).measured.sum(axis=1) for test in (tests[0], heavy)]
    levels = [dict(zip(OUTPUTS, np.sqrt(one), strict=True)) for one in powers]
    change = math.log(levels[1]["tire_force"] / levels[0]["tire_force"])
    apart = separation(setup_distance(*levels), change)
    assert other.own == pytest.approx(math.sqrt(0.5 * part) * error / apart, rel=0.02)
    assert same.own < 0.1 * other.own
    assert other.bias == 0.0
    assert other.common == pytest.approx(math.hypot(0.5, math.sqrt(0.33 * part / 2.0)) * error, rel=0.02)


def test_the_error_of_a_level_is_the_rms_over_the_tests_and_includes_what_studies_correct(car, tests):
    """One of two tests is wrong by 20 %."""
    heavy = tests[1].with_channel("tire_force", "N", 1.2 * tests[1]["tire_force"])
    one = level_errors(MeasuredLevels().uncertainty(car, (tests[0], heavy), experiment(car)))
    variance = 0.5 * 0.5  # of two tests half is pooled, and the usual measure has no such change
    assert one["tire_force"] == pytest.approx(math.sqrt(0.25 + variance) * math.log(1.2), rel=0.02)
    both = level_errors(MeasuredLevels().uncertainty(heavier(car), tests, experiment(car)))
    assert both["tire_force"] == pytest.approx(math.log(1.2), rel=0.01)
    assert max(error for name, error in both.items() if name != "tire_force") < 5e-3
    assert level_errors({"tire_force": MeasureUncertainty(0.01, 0.1)}) == {}


def unstable(car):
    """The car with a growing motion of 5 Hz that all outputs show."""
    model, block = car.state_space, np.array([[8.0, 31.4], [-31.4, 8.0]])
    A = np.block([[model.A, np.zeros((len(model.A), 2))], [np.zeros((2, len(model.A))), block]])
    B = np.vstack([model.B, np.ones((2, model.B.shape[1]))])
    C = np.hstack([model.C, np.ones((len(OUTPUTS), 2))])
    return replace(car, state_space=replace(model, A=A, B=B, C=C))


def test_no_uncertainty_is_stated_for_a_car_whose_simulation_diverges(car, tests, three):
    wrong = unstable(car)
    assert MeasuredLevels().uncertainty(wrong, tests, experiment(car)) == {}
    plain = MeasuredLevels().uncertainty(car, three, experiment(car))
    assert MeasuredLevels().uncertainty(car, three, experiment(car), refit=lambda kept: wrong) == plain


def test_only_a_test_without_which_the_shocks_still_differ_is_left_out(car, tests, three):
    assert removable_tests(tests, ("",)) == ()
    assert removable_tests(three, ("",)) == (1, 2)
    asked = []

    def refit(kept):
        asked.append(tuple(kept))
        return car

    MeasuredLevels().uncertainty(car, three, experiment(car), refit=refit)
    assert asked == [(0, 2), (0, 1)]


def test_a_car_with_four_wheels_has_the_sum_of_its_tire_forces_as_a_measure():
    assert measure_names(("velocity", "tire_force")) == ("velocity", "tire_force")
    assert measure_names(("lf.tire_force", "rf.tire_force"))[-1] == "total_tire_force"


def test_an_independent_record_counts_once_as_the_error_of_one_setup(car, tests):
    known = MeasuredLevels().uncertainty(car, tests, experiment(car))
    lap = tests[0].with_channel("tire_force", "N", 0.9 * tests[0]["tire_force"])
    found = MeasuredLevels().with_records(known, car, [lap, lap])
    first, second = found["tire_force"].levels
    assert (first,) == known["tire_force"].levels
    assert second.error == pytest.approx(math.log(1.0 / 0.9), abs=2e-3)
    assert second.deviation == pytest.approx(first.deviation / math.sqrt(0.33))
    assert len(found["velocity"].levels) == 2


def test_a_record_without_an_output_and_a_fit_of_an_earlier_version_show_no_errors(car, tests):
    known = MeasuredLevels().uncertainty(car, tests, experiment(car))
    without = tests[0].select(["road", "velocity", "force"])
    assert MeasuredLevels().with_records(known, car, [without]) == known
    older = {name: MeasureUncertainty(0.01, 0.1) for name in known}
    assert MeasuredLevels().with_records(older, car, [tests[0]]) == older


def test_the_worst_of_a_quantity_has_the_largest_common_and_the_largest_own_error():
    found = {"lf.velocity": (0.01, 0.3), "rf.velocity": (0.02, 0.1), "lf.tire_force": (0.03, 0.2)}
    trust = Trust({}, measures={name: MeasureUncertainty(*errors) for name, errors in found.items()})
    worst = {quantity: (one.common, one.own) for quantity, one in worst_measures(trust)}
    assert worst == {"velocity": (0.02, 0.3), "tire_force": (0.03, 0.2)}
    assert measure_table(trust).row_count == 2
