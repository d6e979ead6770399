"""Statistics of a few samples, compared with hand calculations."""

from itertools import pairwise

import numpy as np
import pytest

from cosim.study.measures import STATISTICS, Response, options_for, statistic
from eightpost.errors import InputError

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


def test_neighbouring_shares_count_every_sample_once():
    edges = (-np.inf, -3.0, 1.0, 5.0, 9.0, np.inf)
    parts = [of("share", **{"from": low, "to": high}) for low, high in pairwise(edges)]
    assert parts == [0.0, 0.25, 0.25, 0.25, 0.25]


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


def test_missing_options_get_defaults_and_unknown_ones_are_reported():
    assert options_for("share", {"to": 2}) == {"from": -np.inf, "to": 2.0}
    with pytest.raises(InputError, match=r"rms has no option 'to'; its options: none"):
        options_for("rms", {"to": 1.0})
    with pytest.raises(InputError, match=r"share has no option 'percent'; its options: from, to"):
        options_for("share", {"percent": 1.0})
