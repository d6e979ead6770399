"""A drive file is linear between its samples, constant outside, and its means are exact."""

import itertools
from contextlib import nullcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.errors import TimeGapError
from eightpost.signals import Drivefile, TimeSeries

RAMP = Drivefile(
    TimeSeries.from_channels([0.0, 1.0, 3.0], {"road": ("m", [0.0, 2.0, 0.0]), "force": ("N", [1.0, 1.0, 5.0])})
)


def test_a_drive_file_is_linear_between_samples_and_constant_beyond_its_ends():
    np.testing.assert_allclose(RAMP.at(0.5), [1.0, 1.0])
    np.testing.assert_allclose(RAMP.at(2.0), [1.0, 3.0])
    np.testing.assert_allclose(RAMP.at(-7.0), [0.0, 1.0])
    np.testing.assert_allclose(RAMP.at(9.0), [0.0, 5.0])
    assert (RAMP.names, RAMP.units, RAMP.duration) == (("road", "force"), ("m", "N"), 3.0)


@pytest.mark.parametrize(
    ("start", "stop", "road", "force"),
    [
        (0.0, 1.0, 1.0, 1.0),  # a triangle
        (0.0, 3.0, 1.0, 7.0 / 3.0),
        (0.5, 2.0, (0.75 + 1.5) / 1.5, 2.5 / 1.5),  # two trapezia: 0.5 * 1.5 + 1 * 1.5
        (-1.0, 1.0, 0.5, 1.0),  # held at 0 and 1 before the start
        (1.0, 5.0, 0.5, 4.0),  # held at 0 and 5 after the end
        (4.0, 5.0, 0.0, 5.0),
        (-3.0, -2.0, 0.0, 1.0),
        (0.25, 0.25, 0.5, 1.0),
    ],
)
def test_a_mean_equals_the_area_computed_by_hand(start, stop, road, force):
    assert RAMP.mean(start, stop) == pytest.approx([road, force], abs=1e-14)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.floats(-10.0, 10.0), min_size=2, max_size=12),
    st.lists(st.floats(0.01, 1.0), min_size=1, max_size=12),
    st.floats(-2.0, 6.0),
)
def test_means_equal_an_integral_over_every_kink(samples, widths, start):
    grid = np.arange(len(samples)) * 0.37
    drivefile = Drivefile(TimeSeries.from_channels(grid, {"x": ("m", samples)}))
    times = start + np.concatenate([[0.0], np.cumsum(widths)])
    expected = []
    for left, right in itertools.pairwise(times):
        knots = np.unique(np.concatenate([[left, right], grid[(grid > left) & (grid < right)]]))
        expected.append(np.trapezoid(np.interp(knots, grid, samples), knots) / (right - left))
    np.testing.assert_allclose(drivefile.means(times)[0], expected, atol=1e-11)


def test_times_of_means_must_increase():
    with pytest.raises(ValueError, match="increase"):
        RAMP.means(np.array([0.0, 1.0, 1.0]))


def test_a_drive_file_is_read_back_from_its_file(tmp_path):
    RAMP.write(tmp_path / "drive.parquet")
    np.testing.assert_array_equal(Drivefile.read(tmp_path / "drive.parquet").series.values, RAMP.series.values)


def test_only_an_even_grid_of_times_has_gaps(tmp_path):
    even = np.delete(np.arange(50.0) * 0.01, [20, 21, 22])
    for time, is_refused in ((even, True), (np.cumsum(np.linspace(0.01, 0.1, 50)), False), (np.array([0.0]), False)):
        path = tmp_path / "drive.csv"
        path.write_text("time [s],road [m]\n" + "".join(f"{t:.6f},{t:.6f}\n" for t in time))
        with pytest.raises(TimeGapError) if is_refused else nullcontext():
            assert len(Drivefile.read(path).series) == time.size
