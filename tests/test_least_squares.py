"""Parameters stay in their box, a search ends where no step inside is better, a covariance is that of refits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear, minimize

from eightpost.least_squares import (
    Directions,
    Parameters,
    Residual,
    _bounded_step,
    downweighted_rows,
    huber,
    minimum_from,
    non_negative,
    reweighted,
    standard_error,
    tukey,
    weights_for,
    with_fixed,
)
from eightpost.shock import FitParameter, Lpnl2, fit_parameters

# ---- Parameters -----------------------------------------------------------------------------------------------------

CHAIN = (
    FitParameter("first", "N", low=1.0, start=2.0, high=90.0, scale="logarithmic"),
    FitParameter("second", "N", low=20.0, start=1.0, high=100.0, scale="logarithmic", above="first", gap=5.0),
    FitParameter("third", "N", low=0.0, start=300.0, high=100.0, scale="linear", above="second", gap=2.0),
)


@pytest.fixture(params=[CHAIN, fit_parameters(Lpnl2)])
def own(request):
    return Parameters(request.param)


def inside(own, count, seed):
    low, high = own.bounds()
    return [*np.random.default_rng(seed).uniform(low, high, (count, low.size)), low, high]


def test_every_theta_of_the_box_keeps_bounds_and_gaps(own):
    for theta in inside(own, 200, 1):
        values = dict(zip([p.name for p in own.declared], own.values(theta).tolist(), strict=True))
        for p, (low, high) in zip(own.declared, own.value_bounds(), strict=True):
            assert p.low == low and high <= p.high
            assert low * (1.0 - 1e-12) <= values[p.name] <= high * (1.0 + 1e-12)
            assert not p.above or values[p.name] - values[p.above] >= p.gap * (1.0 - 1e-9)


def test_values_come_back_from_theta(own):
    for theta in inside(own, 50, 2)[:50]:
        np.testing.assert_allclose(own.theta(own.values(theta)), theta, rtol=1e-9, atol=1e-9)


def test_the_jacobian_of_the_values_is_the_central_difference(own):
    low, high = own.bounds()
    for theta in inside(own, 20, 3)[:20]:
        found = own.jacobian(theta)
        for i, small in enumerate(1e-6 * (high - low)):
            step = small * np.eye(theta.size)[i]
            expected = (own.values(theta + step) - own.values(theta - step)) / (2.0 * small)
            np.testing.assert_allclose(found[:, i], expected, rtol=1e-5, atol=1e-6 * np.abs(found).max())


def test_a_start_that_breaks_a_bound_or_a_gap_is_moved_inside():
    own = Parameters(CHAIN)
    assert own.values(own.start()) == pytest.approx([2.0, 20.0, 100.0])
    assert own.values(own.theta(np.array([1e4, 50.0, 1.0]))) == pytest.approx([90.0, 95.0, 97.0])


def test_a_parameter_above_an_undeclared_one_is_rejected():
    with pytest.raises(ValueError, match="second is above 'first', which must be declared before it"):
        Parameters(CHAIN[1:])


# ---- The search -----------------------------------------------------------------------------------------------------


@dataclass
class Case:
    """A problem of a residual with its Jacobian, within bounds."""

    residual: object
    slopes: object
    low: object
    high: object

    def bounds(self):
        return np.array(self.low, dtype=float), np.array(self.high, dtype=float)

    def at(self, x):
        return Residual(x, self.residual(x), lambda: self.slopes(x))


def linear(columns, target, low, high):
    return Case(lambda x: columns @ x - target, lambda _: columns, low, high)


def search(case, start, tolerance=1e-10, evaluations=60, **options):
    return minimum_from(case, np.array(start, dtype=float), tolerance=tolerance, evaluations=evaluations, **options)


@given(st.integers(0, 10_000))
def test_bounds_alone_give_what_bounded_linear_least_squares_gives(seed):
    random = np.random.default_rng(seed)
    columns, target = random.standard_normal((30, 4)), random.standard_normal(30)
    low, high = np.array([-0.1, -0.1, -np.inf, -0.1]), np.array([0.05, 0.1, np.inf, np.inf])
    found = search(linear(columns, target, low, high), 0.3 * random.standard_normal(4))
    expected = lsq_linear(columns, target, (low, high), tol=1e-12).x
    assert found.converged
    np.testing.assert_allclose(found.end.parameters, expected, atol=1e-5)


@given(st.integers(0, 10_000))
def test_a_step_is_the_best_one_in_its_box(seed):
    """The damping adds rows to the linear problem."""
    random = np.random.default_rng(seed)
    columns, error = random.standard_normal((20, 5)) * 10.0 ** random.uniform(-3, 3, 5), random.standard_normal(20)
    low, high = -np.abs(random.standard_normal(5)) * 0.05, np.full(5, np.inf)
    step = _bounded_step(columns.T @ columns, -columns.T @ error, low, high, 0.1)
    rows = np.vstack([columns, np.sqrt(0.1) * np.diag(np.linalg.norm(columns, axis=0))])
    best = lsq_linear(rows, -np.append(error, np.zeros(5)), (low, high), tol=1e-14).x
    size = [np.linalg.norm(rows @ d + np.append(error, np.zeros(5))) for d in (step, best)]
    assert (step >= low).all()
    assert size[0] <= size[1] * (1.0 + 1e-6)
    free = _bounded_step(columns.T @ columns, -columns.T @ error, -high, high, 0.1)
    np.testing.assert_allclose(rows.T @ rows @ free, -columns.T @ error, rtol=1e-9)


def valley(x):
    return np.array([10.0 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def valley_slopes(x):
    return np.array([[-20.0 * x[0], 10.0], [-1.0, 0.0]])


@pytest.mark.parametrize("high", [0.6, 3.0])
def test_a_nonlinear_problem_ends_where_a_general_solver_ends(high):
    found = search(Case(valley, valley_slopes, [-2.0, -2.0], [high, 3.0]), (-1.2, 1.0), evaluations=200)
    bounds = [(-2.0, high), (-2.0, 3.0)]
    expected = minimize(lambda x: valley(x) @ valley(x), (-1.2, 1.0), method="L-BFGS-B", bounds=bounds, tol=1e-14)
    assert found.converged
    np.testing.assert_allclose(found.end.parameters, expected.x, atol=1e-3)


def test_a_start_outside_is_moved_inside_and_no_step_is_longer_than_allowed():
    tried = []
    case = linear(np.eye(2), np.array([9.0, 9.0]), [0.0, 0.0], [5.0, np.inf])
    case.at = lambda x: (tried.append(x), Residual(x, x - 9.0, lambda: np.eye(2)))[1]
    found = search(case, (-3.0, -3.0), longest=2.0)
    assert found.end.parameters == pytest.approx([5.0, 9.0], abs=1e-4)
    assert tried[0].tolist() == [0.0, 0.0]
    assert max(np.abs(np.diff(tried, axis=0)).max(axis=1)) <= 2.0 + 1e-12


def test_too_few_evaluations_and_slopes_that_promise_too_much_are_reported():
    growth = Case(lambda x: np.exp(x) - 5.0, lambda x: np.exp(x)[:, None], [-np.inf], [np.inf])
    found = search(growth, [-4.0], evaluations=2)
    assert not found.converged
    assert "after 2 evaluations" in found.status
    kink = Case(lambda x: np.array([1.0 + abs(x[0])]), lambda x: np.array([[1e-7]]), [-np.inf], [np.inf])
    found = search(kink, [0.0], tolerance=1e-6)
    assert found.converged and found.end.parameters == [0.0]
    assert found.status.startswith("No step within the bounds is better")


def test_a_complex_residual_has_the_normal_equations_of_its_real_and_imaginary_parts():
    random = np.random.default_rng(3)
    columns, error = (random.standard_normal(s) + 1j * random.standard_normal(s) for s in ((9, 3), 9))
    point = Residual(np.zeros(3), error, lambda: columns)
    both, parts = (np.concatenate([values.real, values.imag]) for values in (columns, error))
    matrix, right = point.normal_equations
    np.testing.assert_allclose(matrix, both.T @ both)
    np.testing.assert_allclose(right, -both.T @ parts)
    assert point.cost == pytest.approx(parts @ parts)


def test_a_free_element_may_be_negative_and_others_may_not():
    columns = np.random.default_rng(0).standard_normal((50, 4))
    target = columns @ np.array([2.0, -3.0, -1.0, 1.0])
    found = non_negative(columns.T @ columns, columns.T @ target, np.array([False, False, True, False]))
    best = lsq_linear(columns, target, bounds=([0.0, 0.0, -np.inf, 0.0], np.inf)).x
    assert found == pytest.approx(best, abs=1e-6)
    assert found[1] == 0.0
    assert found[2] < 0.0


# ---- Weights --------------------------------------------------------------------------------------------------------


def test_half_way_to_the_limit_of_tukey_a_weight_is_nine_sixteenths():
    """The median absolute deviation of these residuals is 1: one standard deviation of normal noise is 1.4826."""
    residual = np.append(np.repeat([-1.0, 0.0, 1.0], 50), [4.5 * 1.4826, 9.0 * 1.4826])
    assert tukey(residual)[-2:] == pytest.approx([9.0 / 16.0, 0.0])
    assert huber(residual)[-2:] == pytest.approx([2.5 / 4.5, 2.5 / 9.0])
    assert downweighted_rows(tukey(residual)) == 1


@pytest.mark.parametrize(("size", "count", "changed"), [(30.0, 5, True), (11.0, 5, False), (30.0, 60, False)])
def test_weights_change_on_request_only_where_few_rows_are_far(size, count, changed):
    """The standard deviation of the signal is 30; the noise has 1."""
    residual = np.random.default_rng(1).standard_normal(1000)
    residual[:count] = size
    weights = weights_for("auto")(residual, 30.0)
    assert (weights < 1.0).any() == changed
    assert weights_for("none") is None


@dataclass
class Mean:
    """The weighted mean of values."""

    values: object
    weights: object

    @property
    def error(self):
        return self.values - np.average(self.values, weights=self.weights)


def test_weights_follow_the_residuals_until_they_no_longer_change():
    first = Mean(np.append(np.linspace(-1.0, 1.0, 21), 8.0), np.ones(22))
    asked = []

    def again(fit, weights):
        asked.append(weights)
        return Mean(fit.values, weights)

    found = reweighted(first, lambda fit: tukey(fit.error), again, 9)
    assert 1 <= len(asked) < 9
    assert found.weights[-1] == 0.0
    assert np.average(found.values, weights=found.weights) == pytest.approx(0.0, abs=1e-2)
    assert reweighted(first, lambda fit: tukey(fit.error), again, 0) is first


def test_weights_that_return_to_the_first_ones_leave_the_first_fit():
    first, other = Mean(np.zeros(2), np.ones(2)), np.array([0.0, 1.0])
    found = reweighted(first, lambda fit: other if fit is first else np.ones(2), lambda fit, w: Mean(fit.values, w), 9)
    assert found is first


# ---- Covariance -----------------------------------------------------------------------------------------------------

BLOCKS = [slice(k, k + 30) for k in range(0, 600, 30)]


@pytest.fixture
def line():
    """600 rows of a line fit with a correlated residual, and two rows that only stiffen it; and the residual."""
    rng = np.random.default_rng(1)
    jacobian = rng.normal(size=(602, 3)) * [1.0, 30.0, 1e-3]
    y = jacobian @ [1.0, -2.0, 500.0] + np.convolve(rng.normal(size=616), np.ones(15), "valid")
    return jacobian, y, (y - jacobian @ np.linalg.lstsq(jacobian, y, rcond=None)[0])[:600]


@pytest.mark.parametrize("size", [30, 2])
def test_the_covariance_is_that_of_fits_without_one_block_each(line, size):
    """Every fit is repeated without one block: the delete-a-block jackknife, also with blocks of fewer rows than n."""
    jacobian, y, residual = line
    blocks = [slice(k, k + size) for k in range(0, 600, size)]
    without = [np.setdiff1d(np.arange(602), np.arange(602)[block]) for block in blocks]
    fits = [np.linalg.lstsq(jacobian[rows], y[rows], rcond=None)[0] for rows in without]
    apart = np.array(fits) - np.mean(fits, axis=0)
    expected = (len(fits) - 1) / len(fits) * apart.T @ apart
    found = Directions.of(jacobian).covariance(residual, blocks)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


def test_what_the_rows_do_not_determine_has_no_covariance_and_the_rest_keeps_its_own(line):
    jacobian, _, residual = line
    alone = Directions.of(jacobian).covariance(residual, BLOCKS)
    found = Directions.of(np.column_stack([jacobian, np.zeros(602)])).covariance(residual, BLOCKS)
    assert np.isnan(found[3]).all() and np.isnan(found[:, 3]).all()
    np.testing.assert_allclose(found[:3, :3], alone, rtol=1e-9)
    twins = Directions.of(np.column_stack([jacobian, jacobian[:, 0]])).covariance(residual, BLOCKS)
    assert np.isnan(twins[[0, 3]]).all()
    np.testing.assert_allclose(twins[1:3, 1:3], alone[1:, 1:], rtol=1e-9)


def test_a_fixed_combination_of_parameters_has_no_scatter_and_the_others_that_of_a_fit_without_it(line):
    jacobian, _, residual = line
    fixed = np.array([[1.0, 10.0, 0.0]])
    spread = Directions.of(with_fixed(jacobian, fixed)).covariance(residual, BLOCKS)
    free = np.column_stack([10.0 * jacobian[:, 0] - jacobian[:, 1], jacobian[:, 2]])  # moves that keep it
    expected = Directions.of(free).covariance(residual, BLOCKS)
    assert standard_error(fixed, spread)[0] < 1e-3 * standard_error(fixed * [1.0, -1.0, 0.0], spread)[0]
    assert np.sqrt(np.diag(spread))[1:] == pytest.approx(np.sqrt(np.diag(expected)), rel=1e-3)


def test_the_largest_of_several_covariances_counts_and_rounding_gives_no_negative_variance():
    rows = np.array([[1.0, 0.0], [1.0, 2.0]])
    both = np.array([[[4.0, -1.0], [-1.0, 9.0]], [[5.0, 0.0], [0.0, 0.0]]])
    assert standard_error(rows, both) == pytest.approx([5.0**0.5, 6.0])
    assert standard_error(rows, -1e-20 * np.eye(2)).tolist() == [0.0, 0.0]


# ---- Kept numbers ---------------------------------------------------------------------------------------------------


def test_weights_of_residuals_of_all_sizes(unchanged):
    base = np.random.default_rng(3).standard_normal(400)
    shown = {}
    for name, share, size in (("few", 0.01, 30.0), ("some", 0.04, 12.0), ("many", 0.07, 12.0), ("near", 0.01, 6.0)):
        residual = base.copy()
        residual[: round(share * base.size)] += size
        for kind in ("auto", "huber", "tukey"):
            for deviation in (1.0, 15.0, 100.0):
                weights = weights_for(kind)(residual, deviation)
                shown[f"{name} {kind} {deviation}"] = [weights, downweighted_rows(weights)]
    unchanged(shown)


def test_searches_of_all_endings(unchanged):
    found = {}
    for evaluations in (3, 40):
        for tolerance in (1e-2, 1e-12):
            for longest in (0.05, np.inf):
                case = Case(valley, valley_slopes, [-1.5, -0.5], [0.8, 2.0])
                minimum = search(case, [-1.2, 1.9], tolerance, evaluations, longest=longest)
                kept = [minimum.end.parameters, minimum.cost, minimum.converged, minimum.status]
                found[f"{evaluations} {tolerance} {longest}"] = kept
    unchanged(found)


def test_covariances_of_blocks(unchanged):
    random = np.random.default_rng(5)
    jacobian, residual = random.standard_normal((60, 3)), random.standard_normal(60)
    directions, blocks = Directions.of(jacobian), [slice(k, k + 10) for k in range(0, 60, 10)]
    covariance = directions.covariance(residual, blocks)
    unchanged([covariance, directions.moves(residual, blocks), with_fixed(jacobian, np.array([[1.0, 0.0, 2.0]])),
               standard_error(jacobian[:4], np.stack([covariance, 2.0 * covariance]))])  # fmt: skip
