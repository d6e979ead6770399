"""The uncertainty of a measure separates what all setups share from what differs between them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.trust import OutputTrust, Trust
from eightpost.measure_uncertainty import (
    DEGREES,
    LOCAL,
    REACH,
    MeasureUncertainty,
    SetupErrors,
    local_features,
    separation,
    setup_distance,
    student_probability,
    student_quantile,
)

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
    assert below <= student_probability(1.0 / own) + 1e-12
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
    trust = Trust({"velocity": OutputTrust(0.01, 0.02, 1.0)}, measures={"velocity": MeasureUncertainty(0.03, 0.4)})
    assert Trust.of_json(trust.as_json()) == trust
    older = trust.as_json()
    del older["measures"]
    assert Trust.of_json(older).measures == {}


@given(probability=st.floats(1e-6, 1.0 - 1e-6))
def test_the_closed_forms_are_students_distribution(probability):
    value = student_quantile(probability)
    assert value == pytest.approx(student.ppf(probability, DEGREES), rel=1e-6, abs=1e-7)
    assert student_probability(value) == pytest.approx(probability, abs=1e-9)


@given(common=sizes, own=sizes, above=sizes, share=st.floats(0.0, 1.0), other=st.floats(0.0, 1.0))
def test_a_measure_with_more_power_above_the_band_is_less_certain(common, own, above, share, other):
    stated = MeasureUncertainty(math.hypot(common, above * math.sqrt(share)), own, above, 0.0, share)
    moved = stated.at_share(other)
    assert moved.common == pytest.approx(math.hypot(common, above * math.sqrt(other)))
    assert moved.own == stated.own
    assert moved.at_share(share).common == pytest.approx(stated.common)
    assert (moved.common > stated.common) == (other > share) or moved.common == pytest.approx(stated.common)


def test_a_share_that_is_none_is_refused():
    with pytest.raises(ParameterError, match="share of power"):
        MeasureUncertainty(0.01, 0.1).at_share(12.0)


# ---- Drawn errors ---------------------------------------------------------------------------------------------------

TABLE = {"a": np.array([1.0, 1.2, 1.21, np.nan]), "b": np.array([3.0, 2.5, 2.52, np.nan])}
STATED = {"a": MeasureUncertainty(0.02, 0.3), "b": MeasureUncertainty(0.0, 0.1)}


def interquartile(values):
    """Half of the interquartile range relative to that of Student's distribution: the scale of the values."""
    return float(np.subtract(*np.quantile(values, (0.75, 0.25)))) / 2.0 / student_quantile(0.75)


def row(number):
    return {name: float(values[number]) for name, values in TABLE.items()}


@pytest.mark.parametrize("pair", [(0, 1), (1, 2), (0, 2)])
def test_drawn_errors_of_two_setups_differ_as_much_as_every_pair_states(pair):
    drawn = SetupErrors.of(TABLE, STATED).draw("a", 40_000, np.random.default_rng(3))
    change = drawn[:, pair[0]] - drawn[:, pair[1]]
    distance = setup_distance(row(pair[0]), row(pair[1]))
    apart = separation(distance, math.log(TABLE["a"][pair[0]] / TABLE["a"][pair[1]]))
    assert interquartile(change) == pytest.approx(0.3 * apart, rel=0.03)
    below = np.mean(np.log(TABLE["a"][pair[0]]) - drawn[:, pair[0]] < np.log(TABLE["a"][pair[1]]) - drawn[:, pair[1]])
    stated = STATED["a"].probability_below(TABLE["a"][pair[0]], TABLE["a"][pair[1]], distance=distance)
    assert below == pytest.approx(stated, abs=0.01)


def test_a_common_error_shifts_all_setups_of_a_draw_together():
    errors = SetupErrors.of(TABLE, STATED | {"a": MeasureUncertainty(0.02, 0.0)})
    drawn = errors.draw("a", 20_000, np.random.default_rng(4))[:, :3]
    assert np.ptp(drawn, axis=1).max() == 0.0
    assert interquartile(drawn[:, 0]) == pytest.approx(0.02, rel=0.03)


def test_a_setup_without_measures_has_no_errors_and_does_not_affect_the_others():
    errors = SetupErrors.of(TABLE, STATED)
    assert np.isnan(errors.draw("b", 5, np.random.default_rng(1))[:, 3]).all()
    done = SetupErrors.of({name: values[:3] for name, values in TABLE.items()}, STATED)
    drawn = (one.draw("b", 5, np.random.default_rng(1))[:, :3] for one in (errors, done))
    assert np.array_equal(*drawn)


def test_draws_that_cannot_be_made_are_refused():
    with pytest.raises(ParameterError, match="'c' is not known; it is known for: a, b"):
        SetupErrors.of(TABLE, STATED).draw("c", 5, np.random.default_rng(1))
    with pytest.raises(ParameterError, match="'b' is 0 for a setup"):
        SetupErrors.of(TABLE | {"b": np.zeros(4)}, STATED)
    with pytest.raises(ParameterError, match="one value of each per setup"):
        SetupErrors.of(TABLE | {"b": np.ones(2)}, STATED)
