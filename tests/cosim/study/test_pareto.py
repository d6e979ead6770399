"""Pareto fronts and hypervolumes compared with their definitions and with hand calculations."""

from __future__ import annotations

import numpy as np
import pytest

from cosim.study.choice.optimise import hypervolume, pareto_front


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


def test_the_hypervolume_in_two_dimensions_equals_the_area_of_the_staircase():
    staircase = np.array([[0.0, 2.0], [1.0, 1.0], [2.0, 0.0]])
    assert hypervolume(staircase, np.array([3.0, 3.0])) == pytest.approx(6.0)


def test_a_volume_agrees_with_counted_grid_points():
    values = np.random.default_rng(3).integers(0, 6, size=(12, 3)).astype(float)
    cells = np.stack(np.meshgrid(*[np.arange(6)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    reached = (values <= cells).all(axis=2).any(axis=1)
    assert hypervolume(values, np.full(3, 6.0)) == pytest.approx(reached.sum())


def test_a_box_reaches_to_the_reference_in_every_response():
    assert hypervolume(np.array([[1.0, 2.0, 3.0, 4.0]]), np.array([3.0, 5.0, 7.0, 9.0])) == pytest.approx(2 * 3 * 4 * 5)
    # Sum of two boxes minus their intersection.
    both = np.array([[0.0, 2.0, 3.0], [1.0, 1.0, 1.0]])
    assert hypervolume(both, np.array([3.0, 5.0, 7.0])) == pytest.approx(3 * 3 * 4 + 2 * 4 * 6 - 2 * 3 * 4)


def test_setups_that_do_not_dominate_the_reference_add_nothing():
    reference = np.array([1.0, 1.0])
    assert hypervolume(np.array([[2.0, 0.0], [1.0, 0.5]]), reference) == 0.0
    assert hypervolume(np.array([[2.0, -5.0], [0.5, 0.5]]), reference) == pytest.approx(0.25)
