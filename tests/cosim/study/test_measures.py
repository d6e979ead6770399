"""Measures of signals whose values are known analytically."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy

from cosim.study.measures import (
    FAMILIES,
    STATISTICS,
    AboveBand,
    Car,
    Filtered,
    Measure,
    Response,
    above_band,
    band_ends,
    band_pass,
    family,
    options_for,
    power_above,
    statistic,
)
from cosim.study.verdict import RULES, study_verdict
from eightpost.corners import CORNERS
from eightpost.errors import InputError, MissingChannelError
from eightpost.signals import TimeSeries
from eightpost.validity import Range, Validity
from eightpost.verdict import Grade, Verdict

from .constructed import result

TIME = np.arange(0.0, 20.0, 0.002)
SLOW, FAST = 2.0, 22.0


def run(**channels) -> TimeSeries:
    return TimeSeries.from_channels(TIME, {name: ("N", values) for name, values in channels.items()})


def sine(amplitude, frequency):
    return amplitude * np.sin(2.0 * np.pi * frequency * TIME)


@pytest.fixture
def two_tones() -> TimeSeries:
    """3 N at 2 Hz and 1 N at 22 Hz about 100 N: 104 N at the start, 96 N a quarter of a second later."""
    return run(x=100.0 + 3.0 * np.cos(2.0 * np.pi * SLOW * TIME) + np.cos(2.0 * np.pi * FAST * TIME))


def test_a_band_keeps_its_tone_and_removes_the_other(two_tones):
    # The ends of the record are excluded, because the filter rings there.
    slow = Measure("slow", ("x",), band=(0.5, 6.0), section=(4.0, 16.0)).of(two_tones)
    fast = Measure("fast", ("x",), band=(8.0, 60.0), section=(4.0, 16.0)).of(two_tones)
    assert (slow, fast) == pytest.approx((3.0 / np.sqrt(2.0), 1.0 / np.sqrt(2.0)), rel=2e-3)


def test_a_section_of_two_samples_is_enough_and_of_one_is_not():
    series = run(x=TIME)
    assert Measure("m", ("x",), "mean", section=(4.0, 4.002)).of(series) == pytest.approx(4.001)
    with pytest.raises(InputError, match="fewer than two samples"):
        Measure("m", ("x",), "mean", section=(4.0, 4.001)).of(series)


def test_settling_is_excluded():
    series = run(x=np.where(TIME < 2.0, 1000.0, 0.0))
    assert Measure("m", ("x",), "peak").of(series, start=2.0) == 0.0


def test_channels_add_up_with_their_weights():
    series = run(a=sine(1.0, SLOW), b=sine(1.0, SLOW))
    assert Measure("heave", ("a", "b")).of(series) == pytest.approx(2.0 / np.sqrt(2.0), rel=1e-3)
    assert Measure("roll", ("a", "b"), weights=(1.0, -1.0)).of(series) == 0.0


@pytest.mark.parametrize(
    ("arguments", "absolute"),
    [
        ({"statistic": "mean"}, True),
        ({"statistic": "rms"}, False),
        ({"statistic": "mean", "band": (0.0, 5.0)}, True),
        ({"statistic": "mean", "band": (1.0, 5.0)}, False),
        ({"statistic": "rms", "band": (0.0, 5.0)}, False),
        ({"statistic": "mean", "function": "mine.py:f"}, False),
        ({"statistic": "mean", "function": "mine.py:f", "band": (0.0, 5.0)}, False),
    ],
)
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
        series = run(**{c: s * sine(1.0, SLOW) for c, s in zip(sorted(car.channels, key=_order), sign, strict=True)})
        seen = {m.name.split()[2].rstrip(","): m.of(series) for m in measures}
        assert seen.pop(mode) == pytest.approx(4.0 / np.sqrt(2.0), rel=1e-3)
        assert max(seen.values()) < 1e-9


def test_a_sine_of_heave_is_in_its_own_octave_and_in_no_other_mode():
    car = Car("car", CORNERS, {f"car.{c}.tire_force" for c in CORNERS})
    measures = [replace(m, section=(4.0, 16.0)) for m in family("tire_spectra", car)]
    assert len(measures) == 4 * 6
    series = run(**dict.fromkeys(sorted(car.channels, key=_order), sine(1.0, 2.8)))
    heave = {m.band: m.of(series) for m in measures if "heave" in m.name}
    assert heave.pop((2.0, 4.0)) == pytest.approx(4.0 / np.sqrt(2.0), rel=1e-2)
    assert max(heave.values()) < 0.25
    assert max(m.of(series) for m in measures if "heave" not in m.name) < 1e-9


def _order(name: str) -> int:
    return CORNERS.index(name.split(".")[1])


def test_a_user_defined_measure_is_a_function_in_a_file(tmp_path):
    (tmp_path / "mine.py").write_text(
        "def crest(response):\n    x = response.total\n    return abs(x).max() / x.std()\n"
    )
    measure = Measure("crest factor", ("x",), function=f"{tmp_path}/mine.py:crest", function_unit="1")
    assert measure.of(run(x=sine(3.0, SLOW))) == pytest.approx(np.sqrt(2.0), rel=1e-3)
    assert measure.unit(run(x=sine(3.0, SLOW))) == "1"


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{}/none.py:f", "there is no Python file"),
        ("{}/mine.py:g", "has no function 'g'"),
        ("{}/mine.py", "FILE.py:FUNCTION"),
        ("{}/mine.py:no name", "FILE.py:FUNCTION"),
        ("{}/broken.py:f", "cannot be run: ZeroDivisionError"),
    ],
)
def test_a_user_defined_measure_that_cannot_be_loaded_is_refused(tmp_path, entry, message):
    (tmp_path / "mine.py").write_text("def f(response):\n    return 0.0\n")
    (tmp_path / "broken.py").write_text("1 / 0\n")
    with pytest.raises(InputError, match=message):
        Measure("m", ("x",), function=entry.format(tmp_path)).of(run(x=sine(1.0, SLOW)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"statistic": "median"}, "no statistic 'median'"),
        ({"statistic": "percentile"}, "needs the option 'percent'"),
        ({"options": {"percent": 1.0}}, "has no option 'percent'"),
        ({"band": (5.0, 1.0)}, "band must be two increasing values"),
        ({"section": (5.0, 5.0)}, "section must be two increasing values"),
        ({"weights": (1.0, 2.0)}, "1 channels need 1 weights, not 2"),
        ({"statistic": "work"}, "two channels"),
    ],
)
def test_an_invalid_measure_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        Measure("m", ("x",), **arguments)


def test_a_measure_that_does_not_fit_the_run_is_refused(two_tones):
    with pytest.raises(InputError, match="smaller record_step"):
        Measure("m", ("x",), band=(1.0, 300.0)).of(two_tones)
    span = f"{two_tones.time[0]:g} to {two_tones.time[-1]:g} s"
    with pytest.raises(InputError, match=f"fewer than two samples from 30 to 40 s; the run is {span}$"):
        Measure("m", ("x",), section=(30.0, 40.0)).of(two_tones)
    with pytest.raises(MissingChannelError, match="no such channel"):
        Measure("m", ("y",)).of(two_tones)


def test_the_percentile_of_the_tires_is_the_one_of_its_name():
    car = Car("car", CORNERS, tuple(f"car.{corner}.tire_force" for corner in CORNERS))
    (measure,) = (m for m in family("tires", car) if m.name == "lf tire force, 1st percentile")
    ramp = TimeSeries.from_channels(np.arange(1001.0), {"car.lf.tire_force": ("N", np.arange(1001.0))})
    assert measure.of(ramp) == pytest.approx(10.0)


@pytest.mark.parametrize("name", FAMILIES)
def test_a_family_is_refused_if_the_vehicle_has_none_of_its_channels(name):
    with pytest.raises(InputError, match="has none of its channels; families with channels of car: none"):
        family(name, Car("car", CORNERS, ()))


# ==== Statistics of a few samples, compared with hand calculations ===================================================

#: Two channels [N], whose sum is 5, 1, -3, 9: mean 3, squares about it 4, 4, 36, 36.
ROWS = np.array([[2.0, -1.0, -4.0, 7.0], [3.0, 2.0, 1.0, 2.0]])


def of(name, rows=ROWS, step=0.5, **options):
    return statistic(name).of(Response(np.array(rows), step, options_for(name, options)))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("rms", 20.0**0.5),
        ("rms_with_mean", 29.0**0.5),
        ("joint_rms", ((16.5 + 0.5) / 2.0) ** 0.5),
        ("mean", 3.0),
        ("peak", 6.0),
        ("range", 12.0),
        ("maximum", 9.0),
        ("minimum", -3.0),
        ("variation", 20.0**0.5 / 3.0),
        # Products 6, -2, -4, 14; trapezoidal rule with steps of half a second.
        ("work", 0.5 * (0.5 * 6.0 - 2.0 - 4.0 + 0.5 * 14.0)),
    ],
)
def test_statistics_of_four_samples_equal_hand_calculations(name, expected):
    assert of(name) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(("percent", "expected"), [(0.0, -3.0), (25.0, 0.0), (50.0, 3.0), (100.0, 9.0)])
def test_a_percentile_is_interpolated_between_sorted_samples(percent, expected):
    assert of("percentile", percent=percent) == pytest.approx(expected, abs=1e-14)


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


def test_a_variation_is_positive_for_any_sign_of_the_mean_and_undefined_for_zero():
    assert of("variation", rows=[[-2.0, -4.0]]) == pytest.approx(1.0 / 3.0)
    with pytest.raises(InputError, match="the mean is zero"):
        of("variation", rows=[[-2.0, 2.0]])


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


def test_missing_options_get_defaults_and_unknown_ones_are_reported():
    assert options_for("share", {"to": 2}) == {"from": -np.inf, "to": 2.0}
    with pytest.raises(InputError, match=r"rms has no option 'to'; its options: none"):
        options_for("rms", {"to": 1.0})
    with pytest.raises(InputError, match=r"share has no option 'percent'; its options: from, to"):
        options_for("share", {"percent": 1.0})


# ==== Band-pass of measures: gain at every frequency, no phase, behaviour at the ends of a record ====================

BAND_RATE = 200.0
BAND_TIME = np.arange(6000) / BAND_RATE
MIDDLE = slice(2000, 4000)
FREQUENCIES = (0.5, 1.0, 2.0, 5.0, 8.0, 10.0, 12.0, 20.0, 40.0)


def gain(band, frequency):
    """Return the complex gain in the middle of a record; band_pass is linear, so both parts are filtered separately."""
    wave = np.exp(2j * np.pi * frequency * BAND_TIME)
    found = band_pass(wave.real, BAND_RATE, band, "m") + 1j * band_pass(wave.imag, BAND_RATE, band, "m")
    return (found / wave)[MIDDLE]


def warped(frequency):
    """Return the frequency warped by the bilinear transform."""
    return np.tan(np.pi * frequency / BAND_RATE)


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_a_filter_has_the_gain_of_butterworths_fourth_order_squared_on_each_side(frequency):
    low, high, here = warped(2.0), warped(10.0), warped(frequency)
    ratios = {(0.0, 10.0): here / high, (2.0, np.inf): low / here,
              (2.0, 10.0): (here**2 - low * high) / (here * (high - low))}  # fmt: skip
    for band, ratio in ratios.items():
        np.testing.assert_allclose(gain(band, frequency), 1.0 / (1.0 + ratio**8), atol=1e-6)


@pytest.mark.parametrize("band", [(0.0, 10.0), (2.0, np.inf), (2.0, 10.0), (0.5, 60.0)])
def test_a_record_is_extended_at_its_ends_as_by_scipys_sosfiltfilt(band):
    """The extension is an odd reflection; a record with arbitrary ends shows its length."""
    values = 3.0 + np.cumsum(np.random.default_rng(2).standard_normal(400))
    low, high = band
    kind, edges = (
        ("bandpass", band) if low and np.isfinite(high) else ("lowpass", high) if not low else ("highpass", low)
    )
    sections = scipy.signal.butter(4, edges, kind, fs=BAND_RATE, output="sos")
    expected = scipy.signal.sosfiltfilt(sections, values, padtype="odd", padlen=3 * (2 * len(sections) + 1))
    np.testing.assert_allclose(band_pass(values, BAND_RATE, band, "m"), expected, rtol=0.0, atol=1e-9)


def test_a_band_open_on_both_sides_is_the_record_itself():
    assert band_pass(BAND_TIME, BAND_RATE, (0.0, np.inf), "m") is BAND_TIME


@pytest.mark.parametrize(("band", "fewest"), [((0.0, 10.0), 16), ((2.0, np.inf), 16), ((2.0, 10.0), 28)])
def test_a_record_must_be_longer_than_its_padding(band, fewest):
    assert band_pass(np.ones(fewest), BAND_RATE, band, "m").shape == (fewest,)
    with pytest.raises(InputError, match=f"measure 'm': {fewest - 1} samples are too few .* needs {fewest}$"):
        band_pass(np.ones(fewest - 1), BAND_RATE, band, "m")


@pytest.mark.parametrize("band", [(0.0, 100.0), (2.0, 100.0), (100.0, np.inf), (150.0, np.inf)])
def test_a_band_that_reaches_half_the_rate_is_refused(band):
    with pytest.raises(InputError, match="exceeds half the sample rate of 200 Hz"):
        band_pass(BAND_TIME, BAND_RATE, band, "m")
    if band[0] < 101.0:
        band_pass(BAND_TIME, BAND_RATE, tuple(0.99 * edge for edge in band), "m")


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


def test_nothing_is_above_for_a_constant():
    assert power_above(np.full((1, 100), 3.0), SINES_RATE, 16.0) == 0.0


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


def test_channels_without_a_band_and_statistics_without_power_are_left_out():
    measures = (Measure("force", ("lf.force",)), Measure("mean", ("car.a",), "mean"))
    assert above_band(run_of_sines(), measures, {"car.a": 16.0}, 1.0) == {}


def test_the_ends_are_those_that_the_vehicle_states():
    ranges = (Range("lf.velocity", "frequency", 0.1, 24.0, "Hz"), Range("lf.force", "amplitude", -1.0, 1.0, "N"))
    assert band_ends(Validity(Verdict(()), ranges).to_json(), "car") == {"car.lf.velocity": 24.0}
    assert band_ends(None, "car") == {}


@pytest.mark.parametrize(
    ("share", "rule"), [(0.24, "measures above the identified band"), (0.02, "measures within the identified band")]
)
def test_the_verdict_names_the_measures_and_their_shares(tmp_path, share, rule):
    made = result({"front": lambda digits: 1.0 + digits.sum(axis=1)}, builds=("B/B", "C/C"))
    made_by = replace(made.provenance, above_band={"front": AboveBand(16.0, share)})
    replace(made, provenance=made_by).save(tmp_path / "results.parquet")
    again = type(made).load(tmp_path / "results.parquet")
    reason = next(one for one in study_verdict(again).reasons if one.about == "band of the vehicle")
    assert reason.rule == rule
    assert f"front {share:.0%} above 16 Hz" in reason.figure
    assert RULES.named(rule).grade is (Grade.LIMITED if share > 0.1 else Grade.USABLE)
