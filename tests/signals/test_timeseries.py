"""Time series are checked when they are created, and their methods return valid series."""

import numpy as np
import pytest

from eightpost.errors import BackwardTimeError, DuplicateTimeError, MissingChannelError, NotANumberError
from eightpost.signals import TimeSeries

TIME = np.arange(5) / 10.0


def two_channels() -> TimeSeries:
    return TimeSeries.from_channels(TIME, {"velocity": ("m/s", TIME**2), "force": ("N", 3.0 * TIME)})


def test_a_channel_is_found_by_its_name():
    series = two_channels()
    assert series.names == ("velocity", "force")
    assert series.units == ("m/s", "N")
    np.testing.assert_array_equal(series["force"], 3.0 * TIME)
    assert "force" in series
    assert "load" not in series
    assert series.unit("velocity") == "m/s"
    assert len(series) == 5


def test_a_missing_channel_is_reported_with_the_existing_ones():
    with pytest.raises(MissingChannelError, match=r"'load'.*velocity, force"):
        two_channels()["load"]


@pytest.mark.parametrize(
    ("time", "error", "message"),
    [
        ([0.0, 0.1, 0.1], DuplicateTimeError, "sample 3.*0.1 s is repeated"),
        ([0.0, 0.2, 0.1], BackwardTimeError, "sample 3.*decreases from 0.2 s to 0.1 s"),
        ([0.0, np.nan, 0.1], NotANumberError, "sample 2.*'time'"),
    ],
)
def test_time_must_increase(time, error, message):
    with pytest.raises(error, match=message):
        TimeSeries.from_channels(time, {"x": ("m", [1.0, 2.0, 3.0])})


def test_a_sample_that_is_not_finite_is_refused():
    with pytest.raises(NotANumberError, match=r"sample 2, channel 'x'.*inf"):
        TimeSeries.from_channels([0.0, 1.0], {"x": ("m", [0.0, np.inf])})


@pytest.mark.parametrize(
    ("values", "names", "units", "message"),
    [
        (np.zeros((1, 4)), ("x",), ("m",), r"\(1, 5\)"),
        (np.zeros((2, 5)), ("x", "x"), ("m", "m"), "unique; repeated: x"),
        (np.zeros((1, 5)), ("x",), ("m", "m"), "1 channels but 2 units"),
        (np.zeros((1, 5)), ("x",), ("mm",), "'x' must be in the SI unit 'm', not in 'mm'"),
    ],
)
def test_inconsistent_shapes_and_units_are_refused(values, names, units, message):
    with pytest.raises(ValueError, match=message):
        TimeSeries(TIME, values, names, units)


def test_time_rounded_by_a_logger_is_uniform():
    exact = np.arange(20_000) / 300.0
    series = TimeSeries.from_channels([float(f"{t:.6g}") for t in exact], {"x": ("m", exact)})
    assert series.is_uniform
    assert series.sample_rate == pytest.approx(300.0, rel=1e-5)


def test_a_gap_is_not_uniform_and_the_rate_is_that_of_the_usual_step():
    time = np.delete(np.arange(100) / 50.0, slice(40, 60))
    series = TimeSeries.from_channels(time, {"x": ("m", time)})
    assert not series.is_uniform
    assert series.sample_rate == pytest.approx(50.0)


def test_a_window_keeps_both_ends_and_its_time():
    part = two_channels().window(0.1, 0.3)
    np.testing.assert_allclose(part.time, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(part["force"], [0.3, 0.6, 0.9])
    assert part.duration == pytest.approx(0.2)
    with pytest.raises(ValueError, match=r"covers 0 to 0\.4 s"):
        two_channels().window(5.0, 6.0)


def test_channels_are_selected_added_and_replaced():
    series = two_channels()
    assert series.select(["force"]).names == ("force",)
    assert series.with_channel("x", "m", TIME).names == ("velocity", "force", "x")
    np.testing.assert_array_equal(series.with_channel("force", "N", TIME)["force"], TIME)


def test_resampling_is_linear_and_keeps_the_ends():
    fine = two_channels().resample(20.0)
    np.testing.assert_allclose(fine.time, np.arange(9) / 20.0)
    np.testing.assert_allclose(fine["force"], 3.0 * fine.time)


@pytest.mark.parametrize("start", [0.1, 3.3])
def test_a_record_resampled_to_its_own_rate_keeps_its_last_sample_whatever_its_times_round_to(start):
    for rate in (10.0, 30.0, 49.0, 1000.0):
        time = start + np.arange(30) / rate
        for count in range(2, 31):
            series = TimeSeries.from_channels(time[:count], {"x": ("m", time[:count])})
            assert len(series.resample(rate)) == count
            assert len(series.resample(rate * (1.0 - 1e-9))) == count - 1  # the next sample is after the end


def test_writable_arrays_are_copied_and_read_only_arrays_are_not():
    own = np.arange(6.0).reshape(2, 3)
    view = own.view()
    view.setflags(write=False)
    for values in (own, view):
        series = TimeSeries([0.0, 1.0, 2.0], values, ("a", "b"), ("m", "m"))
        own[0, 0] += 1.0
        assert series["a"][0] == own[0, 0] - 1.0
        with pytest.raises(ValueError, match="read-only"):
            series.values[0, 0] = 0.0
    assert TimeSeries(series.time, series.values, series.names, series.units).values is series.values
