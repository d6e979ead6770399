"""Pareto fronts compared with their definition."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.study.choice.optimise import pareto_front


def by_definition(values: np.ndarray) -> np.ndarray:
    beaten = [any((other <= row).all() and (other < row).any() for other in values) for row in values]
    return ~np.array(beaten)


@pytest.mark.parametrize("responses", [1, 2, 3, 5])
def test_the_front_agrees_with_its_definition(responses):
    values = np.random.default_rng(responses).integers(0, 6, size=(150, responses)).astype(float)
    np.testing.assert_array_equal(pareto_front(values), by_definition(values))


def test_equal_setups_are_on_the_front_together():
    assert pareto_front(np.array([[1.0, 2.0], [1.0, 2.0], [2.0, 2.0]])).tolist() == [True, True, False]


def test_a_failed_setup_is_never_on_the_front():
    assert pareto_front(np.array([[np.nan, 0.0], [1.0, 1.0]])).tolist() == [False, True]
