"""The uncertainty of a measure separates what all setups share from what differs between them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eightpost.errors import ParameterError
from eightpost.ident.vehicle.trust import OutputTrust, Trust
from eightpost.measure_uncertainty import DEGREES, MeasureUncertainty, setup_distance

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
    assert wider[0] < low
    assert high < wider[1]
    assert farther[0] < low
    assert high < farther[1]


@pytest.mark.parametrize("level", [0.5, 0.8, 0.95])
def test_an_interval_contains_errors_of_its_distribution_as_often_as_it_says(level):
    generator, one = np.random.default_rng(1), MeasureUncertainty(0.03, 0.4)
    distance, count = 0.1, 20_000
    scale = math.hypot(one.common, one.own * distance)
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
    assert one.probability_below(2.0, 3.0, distance=0.0) == 1.0


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
