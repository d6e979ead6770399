"""Tests of parts of the validation whose results are known in closed form."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from eightpost.errors import InputError, TooShortError
from eightpost.ident.validation.comparison import (
    Comparison,
    Judging,
    Trend,
    modes_of,
    recognise_drive,
    sine_output,
    static_outputs,
)
from eightpost.ident.vehicle.static_rating import StaticRating, rate_statically, rate_tests
from eightpost.rig import RigTest
from eightpost.rig.geometry import displacement_modes, force_modes
from eightpost.signals import TimeSeries
from eightpost.vehicle import Channel, StateSpace
from eightpost.virtual.drivefiles import static_drive
from eightpost.virtual.program import NO_DRIFT, run_test, stand_in_truth
from eightpost.virtual.shocks import LinearDamper
from eightpost.virtual.simulate import RigSensors

RATE = 250.0
TIME = np.arange(round(40.0 * RATE)) / RATE


def _series(**channels: np.ndarray) -> TimeSeries:
    return TimeSeries.from_channels(TIME, {name: ("m", values) for name, values in channels.items()})


def _comparison(measured: np.ndarray, predicted: np.ndarray) -> Comparison:
    return Comparison("velocity", "m/s", measured, predicted, is_judged=True)


def test_gain_phase_and_harmonics_of_a_sine_are_found() -> None:
    turns = 2.0 * np.pi * 3.0 * TIME
    measured = np.sin(turns) + 0.1 * np.sin(3.0 * turns)
    output = sine_output(_comparison(measured, 1.2 * np.sin(turns + 0.2)), 3.0, RATE)
    assert output.gain == pytest.approx(1.2, rel=1e-6)
    assert output.phase == pytest.approx(0.2, rel=1e-6)
    assert output.harmonics == pytest.approx(0.1 / np.sqrt(1.01), rel=1e-3)


def test_a_gain_error_is_linear_in_the_prediction_and_noise_is_not() -> None:
    generator = np.random.default_rng(1)
    predicted, noise = generator.standard_normal((2, TIME.size))
    gain = _comparison(1.1 * predicted, predicted).spectrum(RATE, 100.0)
    other = _comparison(predicted + 0.1 * noise, predicted).spectrum(RATE, 100.0)
    assert gain is not None
    assert other is not None
    assert gain.share == pytest.approx(1.0, abs=1e-6)
    assert other.share < 0.1


def test_a_record_too_short_for_spectra_has_none() -> None:
    short = np.sin(TIME[: round(10.0 * RATE)])
    assert _comparison(short, 0.9 * short).spectrum(RATE, 20.0) is None


def test_constant_loads_give_the_static_rate() -> None:
    load = 100.0 * np.floor(TIME / 5.0)
    measured = TimeSeries.from_channels(TIME, {"aero_force": ("N", load), "ride_height": ("m", -2e-5 * load)})
    predicted = TimeSeries.from_channels(TIME, {"ride_height": ("m", -3e-5 * load)})
    (found,) = static_outputs(measured, predicted, ["aero_force"])
    assert found.load.size == 8
    assert found.slopes == pytest.approx((-2e-5, -3e-5), rel=1e-9)


def test_loads_that_are_never_constant_have_no_levels() -> None:
    moving = np.sin(2.0 * np.pi * TIME)
    measured = TimeSeries.from_channels(TIME, {"aero_force": ("N", moving), "ride_height": ("m", moving)})
    assert static_outputs(measured, measured.select(["ride_height"]), ["aero_force"]) == ()


@pytest.mark.parametrize(
    ("road", "load", "kind"),
    [
        (0.01 * np.sin(2.0 * np.pi * 2.0 * TIME), 0.0 * TIME, "sine"),
        (0.01 * ((TIME % 10.0) < 5.0), 0.0 * TIME, "bump"),
        (0.0 * TIME, 100.0 * np.floor(TIME / 5.0), "static"),
        (0.0 * TIME, 100.0 * np.random.default_rng(1).standard_normal(TIME.size), "random"),
        (0.01 * np.random.default_rng(2).standard_normal(TIME.size), 0.0 * TIME, "random"),
    ],
)
def test_a_record_is_recognised_by_its_drive(road: np.ndarray, load: np.ndarray, kind: str) -> None:
    assert recognise_drive(_series(road=road - road.mean(), load=load), ["road"], ["load"]).kind == kind


def test_comparisons_sines_levels_and_spectra_are_the_kept_ones(unchanged: Callable[..., None]) -> None:
    generator, turns = np.random.default_rng(5), 2.0 * np.pi * 3.0 * TIME
    measured = np.sin(turns) + 0.2 * generator.standard_normal(TIME.size)
    one = _comparison(measured, 0.9 * np.sin(turns + 0.3))
    figures = {name: getattr(one, name) for name in ("rms", "level", "error", "correlation")}
    load = 100.0 * np.floor(TIME / 4.0) + np.where(TIME % 4.0 < 1.0, 20.0 * generator.standard_normal(TIME.size), 0.0)
    channels = {"lf.aero": ("N", load), "rf.aero": ("N", -load), "other": ("m", load)}
    record = TimeSeries.from_channels(TIME, {**channels, "tire_force": ("N", 0.5 * load + measured)})
    held = static_outputs(record, record.with_channel("tire_force", "N", 0.4 * load), ["lf.aero", "rf.aero"])
    trend = Trend("tire_force", "N", np.array([1.0, 1.1, 1.3, 1.2]), np.array([1.1, 1.2, 1.3, 1.35]))
    trends = {name: getattr(trend, name) for name in ("spread", "correlation", "rank", "bias", "remaining_error")}
    inside = Judging(20.0, settling=15.0).inside(record)
    spectrum, sine = one.spectrum(RATE, 20.0), sine_output(one, 3.0, RATE)
    unchanged(
        {"figures": figures, "spectrum": spectrum, "sine": sine, "gain": sine.gain, "held": held,
         "slopes": [each.slopes for each in held], **trends, "time": inside.time, "inside": inside["tire_force"]}
    )  # fmt: skip


@pytest.mark.parametrize("share", [0.48, 0.52])
def test_a_road_that_stands_for_half_of_the_time_is_a_bump(share: float) -> None:
    noise = np.random.default_rng(6).standard_normal(TIME.size)
    road = np.where(4.0 * share > (TIME % 4.0), 0.0, 0.01 * noise)
    found = recognise_drive(_series(road=road, load=0.0 * TIME), ["road"], ["load"])
    assert (found.kind == "bump") is (share > 0.5), found


@pytest.mark.parametrize(("second", "kind"), [(0.2, "sine"), (0.5, "random")])
def test_a_road_with_nine_tenths_of_its_power_near_one_frequency_is_a_sine(second: float, kind: str) -> None:
    road = 0.01 * (np.sin(2.0 * np.pi * 2.0 * TIME) + second * np.sin(2.0 * np.pi * 5.0 * TIME))
    assert recognise_drive(_series(road=road, load=0.0 * TIME), ["road"], ["load"]).kind == kind


@pytest.mark.parametrize(("size", "kind"), [(0.8e-4, "static"), (1.2e-4, "bump")])
def test_a_road_is_at_rest_below_a_tenth_of_a_millimetre(size: float, kind: str) -> None:
    road = size * np.where(TIME % 10.0 < 5.0, 1.0, -1.0)
    assert recognise_drive(_series(road=road, load=100.0 * np.floor(TIME / 5.0)), ["road"], ["load"]).kind == kind


def test_shapes_that_differ_in_one_sign_have_a_lower_mac() -> None:
    def car(second: float) -> StateSpace:
        A = np.array([[0.0, 1.0], [-(20.0**2), -2.0]])
        C = np.array([[1.0, 0.0], [second, 0.0]])
        channels = tuple(Channel(name, "m") for name in ("a", "b"))
        return StateSpace(A, np.array([[0.0], [1.0]]), C, np.zeros((2, 1)), (Channel("f", "N"),), channels)

    (same,) = modes_of(car(1.0), car(1.0))
    (turned,) = modes_of(car(1.0), car(-1.0))
    (half,) = modes_of(car(1.0), car(0.0))
    assert same.frequency == pytest.approx(20.0 / (2.0 * np.pi))
    assert same.damping == pytest.approx(0.05)
    assert (same.mac, turned.mac, half.mac) == pytest.approx((1.0, 0.0, 0.5), abs=1e-9)


def test_a_flat_trend_is_not_ranked() -> None:
    flat = Trend("velocity", "m/s", np.array([1.0, 1.001, 1.002]), np.array([1.002, 1.001, 1.0]))
    assert flat.is_flat
    assert flat.rank == pytest.approx(-1.0)


def test_outputs_are_compared_up_to_the_end_of_the_fits_band() -> None:
    low, high = np.sin(2.0 * np.pi * 2.0 * TIME), np.sin(2.0 * np.pi * 60.0 * TIME)
    inside = Judging(20.0, settling=4.0).inside(_series(x=low + high))
    assert inside.time[0] == pytest.approx(4.0)
    assert inside["x"].std() == pytest.approx(np.sqrt(0.5), rel=1e-3)


def test_a_record_that_is_too_short_to_be_judged_is_rejected() -> None:
    short = TimeSeries.from_channels(TIME[:300], {"x": ("m", np.sin(TIME[:300]))})
    with pytest.raises(TooShortError, match="less than 1 s of"):
        Judging(20.0).inside(short)


@pytest.mark.parametrize(
    ("predicted", "is_reversed"),
    [
        ((1.000, 1.005, 1.05, 1.10), False),
        ((1.005, 1.000, 1.05, 1.10), False),
        ((1.000, 1.005, 1.10, 1.05), True),
        ((1.10, 1.05, 1.005, 1.000), True),
    ],
    ids=["right", "two equal records exchanged", "two different records exchanged", "all reversed"],
)
def test_only_records_that_differ_can_be_in_the_wrong_order(predicted: tuple[float, ...], is_reversed: bool) -> None:
    trend = Trend("lr.tire_force", "N", np.array([1.000, 1.005, 1.05, 1.10]), np.array(predicted))
    assert trend.is_reversed is is_reversed


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
