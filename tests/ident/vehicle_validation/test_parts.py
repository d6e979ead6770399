"""Tests of parts of the validation whose results are known in closed form."""

from collections.abc import Callable

import numpy as np
import pytest

from eightpost.errors import TooShortError
from eightpost.ident.validation.comparison import (
    Comparison,
    Judging,
    Trend,
    modes_of,
    recognise_drive,
    sine_output,
    static_outputs,
)
from eightpost.signals import TimeSeries
from eightpost.vehicle import Channel, StateSpace

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
