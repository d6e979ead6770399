"""Least squares under inequality constraints ends where the Karush-Kuhn-Tucker conditions are satisfied."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear, minimize

from eightpost.ident.shock.problem import Inequalities, constrained_least_squares

NO_INEQUALITIES = Inequalities(np.empty((0, 4)), np.empty(0))


def linear(columns, target, inequalities, start):
    return constrained_least_squares(
        lambda x: columns @ x - target, lambda _: columns, start, inequalities, tolerance=1e-10, evaluations=60
    )


@pytest.mark.nightly
@given(st.integers(0, 10_000))
def test_bounds_alone_give_what_bounded_linear_least_squares_gives(seed):
    random = np.random.default_rng(seed)
    columns, target = random.standard_normal((30, 4)), random.standard_normal(30)
    low, high = np.full(4, -0.1), np.array([0.05, 0.1, np.inf, np.inf])
    found = linear(columns, target, NO_INEQUALITIES.and_bounds(low, high), np.zeros(4))
    expected = lsq_linear(columns, target, (low, high), tol=1e-12).x
    assert found.converged
    np.testing.assert_allclose(found.x, expected, atol=1e-5)


@given(st.integers(0, 10_000))
def test_no_feasible_direction_lowers_the_sum_of_squares(seed):
    random = np.random.default_rng(seed)
    columns, target = random.standard_normal((40, 5)), 3.0 * random.standard_normal(40)
    inequalities = Inequalities(random.standard_normal((12, 5)), -np.abs(random.standard_normal(12)))
    found = linear(columns, target, inequalities, np.zeros(5))
    assert found.converged
    assert inequalities.room(found.x).min() >= -1e-9
    touched = inequalities.matrix[inequalities.room(found.x) < 1e-6]
    gradient = columns.T @ (columns @ found.x - target)
    push = lsq_linear(touched.T, gradient, (0.0, np.inf)).x if len(touched) else np.empty(0)
    np.testing.assert_allclose(touched.T @ push, gradient, atol=1e-3 * np.linalg.norm(columns.T @ target))


def test_a_start_that_violates_the_constraints_becomes_feasible():
    columns, target = np.eye(2), np.array([1.0, 1.0])
    inequalities = Inequalities(np.array([[-1.0, -1.0]]), np.array([-1.0]))
    found = linear(columns, target, inequalities, np.array([5.0, 5.0]))
    np.testing.assert_allclose(found.x, [0.5, 0.5], atol=1e-6)


def test_a_nonlinear_problem_ends_where_a_general_solver_ends():
    def residual(x):
        return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])

    def jacobian(x):
        return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])

    inequalities = Inequalities(np.array([[-1.0, -1.0]]), np.array([-1.0]))
    found = constrained_least_squares(
        residual, jacobian, np.array([-1.2, 1.0]), inequalities, tolerance=1e-10, evaluations=200
    )
    expected = minimize(
        lambda x: residual(x) @ residual(x), (-1.2, 1.0), method="SLSQP", tol=1e-12,
        constraints={"type": "ineq", "fun": inequalities.room},
    )  # fmt: skip
    assert found.converged
    np.testing.assert_allclose(found.x, expected.x, atol=1e-4)


def test_too_few_evaluations_are_reported():
    found = constrained_least_squares(
        lambda x: np.array([np.exp(x[0]) - 5.0]), lambda x: np.array([[np.exp(x[0])]]), np.array([-4.0]),
        Inequalities(np.empty((0, 1)), np.empty(0)), tolerance=1e-12, evaluations=2,
    )  # fmt: skip
    assert not found.converged
    assert "after 2 evaluations" in found.status


@pytest.mark.parametrize("height", [0.5, 2.0])
def test_the_nearest_point_to_a_constraint_is_on_its_boundary(height):
    inequalities = Inequalities(np.array([[0.0, 1.0]]), np.array([height]))
    found = linear(np.eye(2), np.zeros(2), inequalities, np.zeros(2))
    np.testing.assert_allclose(found.x, [0.0, height], atol=1e-6)
