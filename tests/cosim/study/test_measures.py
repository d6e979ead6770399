"""Measures of signals whose values are known analytically."""

from dataclasses import replace

import numpy as np
import pytest

from cosim.study import Measure
from cosim.study.measures import FAMILIES, Car, family, own_function
from eightpost.corners import CORNERS
from eightpost.errors import InputError, MissingChannelError
from eightpost.signals import TimeSeries

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


@pytest.mark.parametrize(
    ("statistic", "options", "expected"),
    [
        ("rms", {}, np.sqrt((9.0 + 1.0) / 2.0)),
        ("rms_with_mean", {}, np.sqrt(100.0**2 + 5.0)),
        ("mean", {}, 100.0),
        ("percentile", {"percent": 50.0}, 100.0),
        ("variation", {}, np.sqrt(5.0) / 100.0),
        ("maximum", {}, 104.0),
        ("minimum", {}, 96.0),
        ("range", {}, 8.0),
        ("peak", {}, 4.0),
        ("share", {"from": 100.0}, 0.5),
    ],
)
def test_statistics_of_two_tones_equal_their_analytical_values(two_tones, statistic, options, expected):
    found = Measure("m", ("x",), statistic, options=options).of(two_tones)
    # On a 2 ms grid, neither 22 Hz nor half of the time above the mean is exact.
    assert found == pytest.approx(expected, rel=0.01)


def test_a_band_keeps_its_tone_and_removes_the_other(two_tones):
    # The ends of the record are excluded, because the filter rings there.
    slow = Measure("slow", ("x",), band=(0.5, 6.0), section=(4.0, 16.0)).of(two_tones)
    fast = Measure("fast", ("x",), band=(8.0, 60.0), section=(4.0, 16.0)).of(two_tones)
    assert (slow, fast) == pytest.approx((3.0 / np.sqrt(2.0), 1.0 / np.sqrt(2.0)), rel=2e-3)


def test_a_band_that_is_open_below_keeps_the_mean(two_tones):
    assert Measure("m", ("x",), "mean", band=(0.0, 6.0)).of(two_tones) == pytest.approx(100.0, rel=1e-4)


def test_only_the_section_of_the_lap_is_evaluated():
    series = run(x=np.where(TIME < 10.0, 1.0, 5.0))
    assert Measure("m", ("x",), "mean", section=(12.0, 15.0)).of(series) == 5.0
    assert Measure("m", ("x",), "mean", section=(2.0, 5.0)).of(series) == 1.0


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


def test_the_joint_rms_is_the_rms_of_the_channels_rms():
    series = run(front=sine(3.0, SLOW), rear=sine(4.0, FAST))
    assert Measure("aero", ("front", "rear"), "joint_rms").of(series) == pytest.approx(2.5, rel=1e-3)


def test_the_work_of_a_linear_damper_is_half_c_v_squared_t():
    velocity, damping = sine(0.2, SLOW), 3000.0
    series = TimeSeries.from_channels(TIME, {"F": ("N", damping * velocity), "v": ("m/s", velocity)})
    measure = Measure("energy", ("F", "v"), "work")
    assert measure.of(series) == pytest.approx(0.5 * damping * 0.2**2 * 20.0, rel=1e-3)
    assert measure.unit(series) == "J"


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


@pytest.mark.parametrize("weights", [(1.0,), (1.0, 2.0, 3.0)])
def test_each_channel_needs_its_weight(weights):
    with pytest.raises(InputError, match="2 channels need 2 weights"):
        Measure("m", ("x", "y"), weights=weights)


@pytest.mark.parametrize("entry", ["measures.py", "measures.py:no name", "name"])
def test_an_own_measure_needs_a_file_and_a_function(entry):
    with pytest.raises(InputError, match=r"must be written as FILE\.py:FUNCTION"):
        own_function(entry)
