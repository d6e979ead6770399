"""Measures of signals whose values are known analytically."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from cosim.study.measures import (
    FAMILIES,
    STATISTICS,
    Car,
    Filtered,
    Measure,
    Response,
    above_band,
    band_ends,
    band_pass,
    family,
    options_for,
    statistic,
)
from eightpost.corners import CORNERS
from eightpost.signals import TimeSeries
from eightpost.validity import Range, Validity
from eightpost.verdict import Verdict
from tests.unchanged import refusals

TIME = np.arange(0.0, 20.0, 0.002)
SLOW = 2.0


def run(**channels) -> TimeSeries:
    return TimeSeries.from_channels(TIME, {name: ("N", values) for name, values in channels.items()})


def sine(amplitude, frequency):
    return amplitude * np.sin(2.0 * np.pi * frequency * TIME)


def test_a_section_of_two_samples_is_enough():
    assert Measure("m", ("x",), "mean", section=(4.0, 4.002)).of(run(x=TIME)) == pytest.approx(4.001)


@pytest.mark.parametrize(("arguments", "absolute"), [
    ({"statistic": "mean"}, True), ({"statistic": "rms"}, False), ({"statistic": "mean", "band": (0.0, 5.0)}, True),
    ({"statistic": "mean", "band": (1.0, 5.0)}, False), ({"statistic": "rms", "band": (0.0, 5.0)}, False),
    ({"statistic": "mean", "function": "mine.py:f"}, False),
    ({"statistic": "mean", "function": "mine.py:f", "band": (0.0, 5.0)}, False),
])  # fmt: skip
def test_a_measure_depends_on_the_mean_if_its_statistic_does_and_its_band_passes_it(arguments, absolute):
    assert Measure("m", ("x",), **arguments).absolute == absolute


def test_the_four_bins_of_a_velocity_histogram_add_up_to_the_whole_time():
    car = Car("car", ("lf",), {"car.lf.velocity"})
    series = TimeSeries.from_channels(TIME, {"car.lf.velocity": ("m/s", sine(0.1, SLOW))})
    shares = {m.name: m.of(series) for m in family("velocities", car)}
    assert sum(shares.values()) == pytest.approx(1.0)
    # A sine of amplitude a is within +-b for 2/pi asin(b/a) of the time.
    low = shares["lf time in low-speed bump"] + shares["lf time in low-speed rebound"]
    assert low == pytest.approx(2.0 / np.pi * np.arcsin(0.0508 / 0.1), abs=0.01)


def test_every_tire_mode_responds_only_to_its_own_motion():
    car = Car("car", CORNERS, {f"car.{c}.tire_force" for c in CORNERS})
    signs = {"heave": (1, 1, 1, 1), "pitch": (-1, -1, 1, 1), "roll": (1, -1, 1, -1), "warp": (1, -1, -1, 1)}
    # The ends of the record are excluded, because the filter rings there.
    measures = [replace(m, section=(4.0, 16.0)) for m in family("tire_modes", car) if "chassis" in m.name]
    for mode, sign in signs.items():
        series = run(**{f"car.{c}.tire_force": s * sine(1.0, SLOW) for c, s in zip(CORNERS, sign, strict=True)})
        seen = {m.name.split()[2].rstrip(","): m.of(series) for m in measures}
        assert seen.pop(mode) == pytest.approx(4.0 / np.sqrt(2.0), rel=1e-3)
        assert max(seen.values()) < 1e-9


def test_a_user_defined_measure_is_a_function_in_a_file(tmp_path):
    (tmp_path / "mine.py").write_text(
        "def crest(response):\n    x = response.total\n    return abs(x).max() / x.std()\n"
    )
    measure = Measure("crest factor", ("x",), function=f"{tmp_path}/mine.py:crest", function_unit="1")
    assert measure.of(run(x=sine(3.0, SLOW))) == pytest.approx(np.sqrt(2.0), rel=1e-3)
    assert measure.unit(run(x=sine(3.0, SLOW))) == "1"


# ==== Statistics of a few samples, compared with hand calculations ===================================================

#: Two channels [N], whose sum is 5, 1, -3, 9: mean 3, squares about it 4, 4, 36, 36.
ROWS = np.array([[2.0, -1.0, -4.0, 7.0], [3.0, 2.0, 1.0, 2.0]])


def of(name, rows=ROWS, step=0.5, **options):
    return statistic(name).of(Response(np.array(rows), step, options_for(name, options)))


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, 1.0),
        ({"from": 1.0}, 0.75),  # includes 1
        ({"to": 5.0}, 0.5),  # excludes 5
        ({"from": 1.0, "to": 9.0}, 0.5),
        ({"from": 1.5, "to": 4.5}, 0.0),
    ],
)
def test_a_share_counts_samples_from_the_lower_end_to_just_below_the_upper(options, expected):
    assert of("share", **options) == expected


def test_a_variation_is_positive_for_any_sign_of_the_mean():
    assert of("variation", rows=[[-2.0, -4.0]]) == pytest.approx(1.0 / 3.0)


def test_only_absolute_statistics_change_with_the_mean():
    """A constant is added to the first channel; work and share depend on zero and on bounds and are excluded."""
    for name, entry in STATISTICS.items():
        if name in ("work", "share"):
            continue
        options = {"percent": 40.0} if name == "percentile" else {}
        before, after = of(name, **options), of(name, rows=ROWS + np.array([[10.0], [0.0]]), **options)
        assert (after != pytest.approx(before, rel=1e-9)) == entry.absolute, name


def test_units_are_those_of_the_channels_except_for_ratios_and_work():
    units = {name: entry.unit for name, entry in STATISTICS.items() if entry.unit}
    assert units == {"variation": "1", "work": "J", "share": "1"}
    assert Measure("energy", ("x", "x"), "work").unit(run(x=TIME)) == "J"


def test_what_cannot_be_measured_is_refused(tmp_path, unchanged):
    (tmp_path / "mine.py").write_text("def f(response):\n    return 0.0\n")
    (tmp_path / "broken.py").write_text("1 / 0\n")

    def measured(channel="x", **given):
        return Measure("m", (channel,), **given).of(run(x=sine(3.0, SLOW)))

    def own(entry):
        return partial(measured, function=f"{tmp_path}/{entry}")

    calls = {
        **{entry: own(entry) for entry in ("none.py:f", "mine.py:g", "mine.py", "mine.py:no name", "broken.py:f")},
        "a band beyond the record": partial(measured, band=(1.0, 300.0)), "no channel": partial(measured, "y"),
        "a section beyond the run": partial(measured, section=(30.0, 40.0)),
        "a section of a sample": partial(measured, statistic="mean", section=(4.0, 4.001)),
        "a mean of zero": partial(of, "variation", rows=[[-2.0, 2.0]]),
        "no such option": partial(options_for, "rms", {"to": 1.0}),
        "no percent": partial(options_for, "percentile", {}),
        "two unknown options": partial(options_for, "share", {"b": 1.0, "a": 1.0}),
        **{f"no channel of {name}": partial(family, name, Car("car", CORNERS, ())) for name in FAMILIES},
    }  # fmt: skip
    unchanged(refusals(calls))


# ==== Band-pass of measures: gain at every frequency, no phase, behaviour at the ends of a record ====================

BAND_RATE = 200.0
BAND_TIME = np.arange(6000) / BAND_RATE


def test_a_band_open_on_both_sides_is_the_record_itself():
    assert band_pass(BAND_TIME, BAND_RATE, (0.0, np.inf), "m") is BAND_TIME


def test_a_window_includes_the_samples_at_both_ends():
    run = Filtered(TimeSeries.from_channels(BAND_TIME[:11], {"x": ("N", BAND_TIME[:11])}))
    assert run.samples(0.01, 0.03) == slice(2, 7)
    assert run.samples(0.01 + 1e-4, 0.03 - 1e-4) == slice(3, 6)
    assert run.samples(-np.inf, np.inf) == slice(0, 11)


def test_a_filtered_channel_is_computed_once_for_each_band():
    run = Filtered(TimeSeries.from_channels(BAND_TIME, {"x": ("N", np.sin(BAND_TIME))}))
    assert np.array_equal(run.channel("x", None, "m"), np.sin(BAND_TIME))
    first, second = (run.channel("x", (0.0, high), "m") for high in (10.0, 20.0))
    assert run.channel("x", (0.0, 10.0), "m") is first
    assert not np.array_equal(first, second)


# ==== Power of measures above the band in which a vehicle was identified =============================================

SINES_RATE = 250.0
SINES_TIME = np.arange(5000) / SINES_RATE


def sines(low: float, high: float) -> np.ndarray:
    return low * np.sin(2.0 * np.pi * 5.0 * SINES_TIME) + high * np.sin(2.0 * np.pi * 40.0 * SINES_TIME)


def run_of_sines() -> Filtered:
    channels = {"car.a": ("m", sines(1.0, 1.0)), "car.b": ("m", sines(1.0, -1.0)), "lf.force": ("N", sines(0.0, 1.0))}
    return Filtered(TimeSeries.from_channels(SINES_TIME, channels))


def test_a_sum_in_which_the_high_frequencies_cancel_has_none_above():
    total, apart = Measure("sum", ("car.a", "car.b")), Measure("joint", ("car.a", "car.b"), "joint_rms")
    found = above_band(run_of_sines(), (total, apart), {"car.a": 16.0, "car.b": 20.0}, start=1.0)
    assert found["sum"].share == pytest.approx(0.0, abs=1e-9)
    assert found["joint"].share == pytest.approx(0.5, abs=1e-3)
    assert {one.high for one in found.values()} == {16.0}


def test_a_band_that_ends_at_the_vehicles_band_removes_the_power_above():
    measure = Measure("a", ("car.a",))
    whole, limited = (above_band(run_of_sines(), (m,), {"car.a": 16.0}, 1.0)["a"] for m in
                      (measure, replace(measure, band=(0.5, 16.0))))  # fmt: skip
    assert whole.share == pytest.approx(0.5, abs=1e-3)
    assert limited.share < 1e-3


def test_the_ends_are_those_that_the_vehicle_states():
    ranges = (Range("lf.velocity", "frequency", 0.1, 24.0, "Hz"), Range("lf.force", "amplitude", -1.0, 1.0, "N"))
    assert band_ends(Validity(Verdict(()), ranges).to_json(), "car") == {"car.lf.velocity": 24.0}
    assert band_ends(None, "car") == {}
