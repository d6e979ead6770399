"""The uncertainty of a measure separates what all setups share from what differs between them."""

import json
import math
from dataclasses import asdict

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import t as student

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.trust import OutputTrust, Trust
from eightpost.schema import checked
from eightpost.uncertainty import (
    DEGREES,
    LOCAL,
    REACH,
    MeasuredLevel,
    MeasureUncertainty,
    _drive_distance,
    band_shares,
    local_features,
    separation,
    setup_distance,
)
from eightpost.validity import ModelUncertainty

sizes = st.floats(1e-4, 0.3)
values = st.floats(1e-3, 1e3)


@given(common=sizes, own=sizes, predicted=values, distance=st.floats(0.0, 0.5))
def test_intervals_contain_the_prediction_and_grow_with_level_and_distance(common, own, predicted, distance):
    one = MeasureUncertainty(common, own)
    low, high = one.interval(predicted, 0.8, distance=distance)
    assert low < predicted < high
    assert low * high == pytest.approx(predicted**2)
    wider = one.interval(predicted, 0.95, distance=distance)
    farther = one.interval(predicted, 0.8, distance=distance + 0.1)
    assert one.interval(predicted, 0.8, distance=0.3, change=-0.4) == pytest.approx(
        MeasureUncertainty(common, own * separation(0.3, 0.4)).interval(predicted, 0.8, change=1.0)
    )
    assert wider[0] < low
    assert high < wider[1]
    assert farther[0] < low
    assert high < farther[1]


@pytest.mark.parametrize("level", [0.5, 0.8, 0.95])
def test_an_interval_contains_errors_of_its_distribution_as_often_as_it_says(level):
    generator, one = np.random.default_rng(1), MeasureUncertainty(0.03, 0.4)
    distance, count = 0.1, 20_000
    scale = math.hypot(one.common, one.own * separation(distance, 0.0))
    true = 5.0 / np.exp(scale * generator.standard_t(DEGREES, count))
    low, high = one.interval(5.0, level, distance=distance)
    assert np.mean((low <= true) & (true <= high)) == pytest.approx(level, abs=4.0 * math.sqrt(level / count))


@given(common=st.floats(0.0, 1.0), own=sizes, first=values, second=values, distance=st.floats(1e-3, 0.5))
def test_a_common_error_does_not_affect_which_setup_is_better(common, own, first, second, distance):
    one, free = MeasureUncertainty(common, own), MeasureUncertainty(0.0, own)
    below = one.probability_below(first, second, distance=distance)
    assert below == free.probability_below(first, second, distance=distance)
    assert below + one.probability_below(second, first, distance=distance) == pytest.approx(1.0)
    assert (below > 0.5) == (first < second) or below == pytest.approx(0.5)


def test_setups_with_equal_predictions_are_a_draw():
    one = MeasureUncertainty(0.01, 0.2)
    assert one.probability_below(3.0, 3.0, distance=0.1) == pytest.approx(0.5)
    assert one.probability_below(3.0, 3.0, distance=0.0) == 0.5
    assert MeasureUncertainty(0.01, 0.0).probability_below(2.0, 3.0, distance=0.0) == 1.0


@given(own=sizes, change=st.floats(0.001, 0.5), distance=st.floats(0.0, 0.5))
def test_the_order_of_setups_is_less_sure_if_other_measures_differ_but_never_sure_by_the_measures_own_change(
    own, change, distance
):
    """Without any other difference, the order is that of a slope error `own` against a slope of 1."""
    one = MeasureUncertainty(0.0, own)
    below = one.probability_below(1.0, math.exp(change), distance=distance)
    assert below <= student.cdf(1.0 / own, DEGREES) + 1e-12
    assert below == pytest.approx(student.cdf(change / (own * separation(distance, change)), DEGREES))


@given(change=st.floats(0.0, 0.5), distance=st.floats(0.0, 0.5))
def test_the_separation_grows_faster_near_by_than_far_away(change, distance):
    apart = separation(distance, change)
    assert math.hypot(distance, change) <= apart <= math.sqrt(distance**2 + change**2 + 2.0 * LOCAL**2) + 1e-12
    assert separation(1e-4, 0.0) == pytest.approx(1e-4 * math.hypot(1.0, LOCAL / REACH), rel=1e-4)


@pytest.mark.parametrize("measures", [1, 4, 15, 40])
def test_products_of_local_features_are_the_covariance_of_the_local_part(measures):
    """The separation without distance and change is that of the features."""
    generator = np.random.default_rng(measures)
    positions = 0.05 * generator.standard_normal((30, measures)) / math.sqrt(measures)
    features = local_features(positions)
    apart2 = np.sum((positions[:, None] - positions) ** 2, axis=2)
    np.testing.assert_allclose(features @ features.T, LOCAL**2 * np.exp(-0.5 * apart2 / REACH**2), atol=0.4 * LOCAL**2)
    near = positions + 1e-3 / math.sqrt(measures)
    moved = np.linalg.norm(local_features(near) - features, axis=1)
    np.testing.assert_allclose(moved, 1e-3 * LOCAL / REACH, rtol=0.25 if measures < 32 else 0.5)


def test_the_distance_of_two_setups_is_the_rms_of_their_logarithmic_differences():
    first, second = {"a": 1.0, "b": 2.0}, {"a": math.exp(0.3), "b": 2.0 * math.exp(-0.4)}
    assert setup_distance(first, second) == pytest.approx(math.sqrt((0.09 + 0.16) / 2.0))
    assert setup_distance(first, first) == 0.0
    with pytest.raises(ParameterError, match="b"):
        setup_distance(first, {"a": 1.0})


@pytest.mark.parametrize("level", [0.0, 1.0, 95.0])
def test_a_level_that_is_not_a_probability_is_refused(level):
    with pytest.raises(ParameterError, match="between 0 and 1"):
        MeasureUncertainty(0.01, 0.1).interval(1.0, level)


def test_a_fit_stores_the_uncertainty_of_its_measures():
    stated = MeasureUncertainty.of_levels([level(error=0.05)], 0.4)
    trust = Trust({"velocity": OutputTrust(0.01, 0.02, 1.0)}, measures={"velocity": stated})
    assert checked(Trust, json.loads(json.dumps(asdict(trust)))) == trust
    assert ModelUncertainty.from_json(ModelUncertainty(measures=trust.measures).to_json()).measures == trust.measures


def test_the_uncertainty_of_earlier_versions_is_that_of_their_tests():
    older = {"common": 0.03, "own": 0.4, "common_above": 0.1, "own_above": 0.2, "share_above": 0.01}
    expected = {"a": MeasureUncertainty(0.03, 0.4)}
    assert checked(Trust, {"outputs": {}, "measures": {"a": older}}).measures == expected
    found = ModelUncertainty.from_json({"measures": {"a": older}})
    assert found.measures == expected
    assert found.to_json()["measures"] == {"a": older}, "the digest of the file stays right"
    assert checked(Trust, {"outputs": {}}).measures == {}


# ---- Measured errors and other drives -------------------------------------------------------------------------------

TESTS = (0.0, 0.5, 0.5, *(0.0,) * 8)
LAP = (0.0, 0.9, 0.1, *(0.0,) * 8)


def level(error=0.0, deviation=0.01, spread=0.02, shares=TESTS):
    return MeasuredLevel(error, deviation, spread, shares)


def test_the_bands_share_the_power_of_the_lines_by_their_frequencies():
    frequency = np.array([0.0, 0.4, 0.5, 2.5, 29.0, 30.0, 60.0])
    shares = band_shares(np.array([[1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0]]), frequency)
    assert shares.tolist() == [[3.0, 4.0, 0.0, 8.0, 0.0, 0.0, 0.0, 0.0, 0.0, 16.0, 96.0]]


def test_the_distance_of_two_drives_counts_power_where_the_records_have_none_most():
    assert _drive_distance(TESTS, TESTS) == 0.0
    assert _drive_distance(LAP, TESTS) == pytest.approx(math.sqrt(2.0 * 0.16 / 0.505))
    beyond = (*(0.0,) * 10, 1.0)
    assert _drive_distance(beyond, TESTS) == pytest.approx(math.sqrt(1.0 / 0.005 + 2.0 * 0.25 / 0.505))


def test_on_the_tests_own_drive_the_error_is_as_sure_as_the_tests_show():
    one = MeasureUncertainty.of_levels([level(error=0.015)], 0.2)
    assert (one.common, one.own, one.bias) == pytest.approx((math.hypot(0.01, 0.015), 0.2, 0.0))
    assert one.levels == (level(error=0.015),)


@given(error=st.floats(-0.1, 0.1), deviation=st.floats(1e-3, 0.05))
def test_an_error_above_two_standard_deviations_is_a_bias_and_any_other_one_is_uncertainty(error, deviation):
    assume(not math.isclose(abs(error), 2.0 * deviation))
    one = MeasureUncertainty.of_levels([level(error=error, deviation=deviation)], 0.2)
    assert math.hypot(one.common, one.bias) == pytest.approx(math.hypot(error, deviation))
    assert (one.bias != 0.0) == (abs(error) > 2.0 * deviation)


def test_predictions_are_corrected_by_the_bias():
    low, high = MeasureUncertainty(0.01, 0.0, bias=0.05).interval(100.0, 0.95)
    assert math.sqrt(low * high) == pytest.approx(100.0 * math.exp(-0.05))


def test_another_drive_is_less_certain_by_the_spread_over_the_bands():
    one, apart = MeasureUncertainty.of_levels([level()], 0.03), _drive_distance(LAP, TESTS)
    moved = one.on_drive(LAP)
    assert moved.common == pytest.approx(math.hypot(0.01, 4.0 * 0.02 * apart))
    assert moved.own == pytest.approx(math.hypot(0.03, 1.5 * 0.02 * apart))
    assert moved.levels == ()


def test_power_above_that_of_the_records_is_as_uncertain_as_the_output_there():
    low = (0.5, 0.25, 0.25, *(0.0,) * 8)
    apart = _drive_distance(low, TESTS)
    assert MeasureUncertainty.of_levels([level()], 0.03).on_drive(low).common == pytest.approx(
        math.hypot(0.01, 4.0 * 0.02 * apart)
    )
    half = (0.0, 0.25, 0.25, *(0.0,) * 7, 0.5)
    moved, apart = MeasureUncertainty.of_levels([level()], 0.03).on_drive(half), _drive_distance(half, TESTS)
    assert moved.common == pytest.approx(math.hypot(0.01, 4.0 * 0.02 * apart, 0.35))
    assert moved.own == pytest.approx(math.hypot(0.03, 1.5 * 0.02 * apart, 0.35))


def test_a_record_counts_the_more_the_nearer_its_drive_is():
    lap = level(error=0.04, shares=LAP)
    one = MeasureUncertainty.of_levels([level(), lap], 0.03)
    there, here = one.on_drive(LAP), one.on_drive(TESTS)
    far = math.hypot(0.01, 4.0 * 0.02 * _drive_distance(LAP, TESTS))
    weight = 0.01**-2 / (0.01**-2 + far**-2)
    assert there.bias == pytest.approx(0.04 * weight)
    assert there.common == pytest.approx((0.01**-2 + far**-2) ** -0.5)
    assert abs(here.bias) < 0.5 * there.bias


def test_without_measured_errors_or_a_known_spectrum_the_stated_scales_remain():
    older = MeasureUncertainty(0.02, 0.3)
    assert older.on_drive(LAP) == older
    one = MeasureUncertainty.of_levels([level()], 0.03)
    assert one.on_drive(()) == one
