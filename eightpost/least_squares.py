"""Fits by least squares: parameters and their bounds, one search, weights of outliers, the covariance of the result.

A problem has a few parameters in a box; all that its error is linear in may follow from them (variable projection). Its
`at` returns a point with the cost and the normal equations of a step, and `minimum_from` searches:

    class Line:                                       # y = exp(a x) in 0 <= a <= 1, one parameter a
        def bounds(self): return np.zeros(1), np.ones(1)
        def at(self, a): return Residual(a, np.exp(a * x) - y, lambda: (x * np.exp(a * x))[:, None])

    found = minimum_from(Line(), np.array([0.5]), tolerance=1e-6, evaluations=50)

Residuals of a model are not white noise: they are what it does not describe, and their correlation lasts as long as
that of the motion. So the covariance follows from the change of the solution when a block of rows is left out
(`Directions`): the delete-a-block jackknife to first order, which is a sandwich covariance corrected for leverage.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import nnls

from eightpost.array_types import Array
from eightpost.progress import beats

# ---- Linear problems ------------------------------------------------------------------------------------------------

#: Share of the diagonal that is added to normal equations, for directions that no row determines.
REGULAR = 1e-12


def linear_solution(columns: Array, target: Array, *, weakest: float = 1e-12) -> Array:
    """Return the weights (n,) of columns (N, n) that fit a target (N,) by least squares.

    Singular values of the scaled columns below the share `weakest` of the largest one are directions without weight.
    """
    size = _sizes(columns)
    weights, *_ = np.linalg.lstsq(columns / size, target, rcond=weakest)
    return np.asarray(weights / size, dtype=np.float64)


def non_negative(gram: Array, towards: Array, is_free: NDArray[np.bool_]) -> Array:
    """Return x (n,) that minimises x' gram x - 2 towards' x; only free elements of x may be negative."""
    # Free elements are eliminated first: x_free = inverse (towards_free - across x).
    inverse = np.linalg.pinv(gram[np.ix_(is_free, is_free)], hermitian=True)
    across = gram[np.ix_(is_free, ~is_free)]
    rest = gram[np.ix_(~is_free, ~is_free)] - across.T @ inverse @ across
    right = towards[~is_free] - across.T @ (inverse @ towards[is_free])
    size = np.sqrt(np.maximum(np.diag(rest), np.finfo(float).tiny))
    factor = cholesky(rest / np.outer(size, size) + REGULAR * np.eye(size.size), lower=True)
    found = np.empty(towards.size)
    found[~is_free] = nnls(factor.T, solve_triangular(factor, right / size, lower=True))[0] / size
    found[is_free] = inverse @ (towards[is_free] - across @ found[~is_free])
    return found


def _sizes(columns: Array) -> Array:
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    return np.asarray(size)


# ---- Parameters: their bounds, and their coordinates in a box -------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Parameters:
    """Parameters (k,) and theta (k,), their coordinates in a box.

    theta is the parameter itself, or its logarithm if the scale is logarithmic. If a parameter must stay above another
    one by a gap, its coordinate is its share u of the remaining range: value = low + u (high - low) with
    low = max(declared low, other + gap), so that 0 <= u <= 1 ensures all conditions.

    Raises:
        ValueError: A parameter is above one that is not declared before it.
    """

    declared: tuple[Any, ...]  #: Declarations, with the attributes of `eightpost.shock.FitParameter`.

    def __post_init__(self) -> None:
        for i, parameter in enumerate(self.declared):
            before = [p.name for p in self.declared[:i]]
            if parameter.above and parameter.above not in before:
                what = f"{parameter.name} is above {parameter.above!r}, which must be declared before it"
                raise ValueError(f"FIT_PARAMETERS: {what}; declared before it: {', '.join(before) or 'none'}")

    @property
    def logarithmic(self) -> NDArray[np.bool_]:
        """Whether each theta (k,) is a logarithm."""
        return np.array([p.scale == "logarithmic" and not p.above for p in self.declared], dtype=bool)

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest theta (k,)."""
        pairs = [(0.0, 1.0) if p.above else (p.low, self._highest(i)) for i, p in enumerate(self.declared)]
        low, high = np.array(pairs, dtype=np.float64).reshape(-1, 2).T
        return self._logarithms(low), self._logarithms(high)

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the lowest and the highest value of each parameter."""
        return tuple((p.low, self._highest(i)) for i, p in enumerate(self.declared))

    def start(self) -> Array:
        """Return theta (k,) of the declared starts, moved inside the box."""
        return self.theta(np.array([p.start for p in self.declared], dtype=np.float64))

    def theta(self, values: Array) -> Array:
        """Return theta (k,) of values (k,), moved inside the box."""
        low, high = self.bounds()
        theta = np.clip(self._logarithms(np.where(self.logarithmic, np.maximum(values, 1e-300), values)), low, high)
        for i in self._dependent:
            least, most, _ = self._room(i, self.values(theta))
            theta[i] = np.clip((values[i] - least) / max(most - least, 1e-300), 0.0, 1.0)
        return theta

    def values(self, theta: Array) -> Array:
        """Return the parameters (k,)."""
        values = np.where(self.logarithmic, np.exp(np.where(self.logarithmic, theta, 0.0)), theta)
        for i in self._dependent:
            low, high, _ = self._room(i, values)
            values[i] = low + theta[i] * (high - low)
        return np.asarray(values)

    def jacobian(self, theta: Array) -> Array:
        """Return dvalues/dtheta (k, k)."""
        values = self.values(theta)
        jacobian = np.diag(np.where(self.logarithmic, values, 1.0))
        for i in self._dependent:
            low, high, moves = self._room(i, values)
            jacobian[i] = (1.0 - theta[i]) * jacobian[self._below(i)] if moves else 0.0
            jacobian[i, i] = high - low
        return jacobian

    @property
    def _dependent(self) -> list[int]:
        return [i for i, p in enumerate(self.declared) if p.above]

    def _below(self, i: int) -> int:
        return [p.name for p in self.declared].index(self.declared[i].above)

    def _room(self, i: int, values: Array) -> tuple[float, float, bool]:
        """Return the range left to a parameter that is above another one, and whether its lower end depends on that."""
        parameter, below = self.declared[i], float(values[self._below(i)]) + self.declared[i].gap
        return max(parameter.low, below), max(self._highest(i), below), below >= parameter.low

    def _highest(self, i: int) -> float:
        """Return the highest value that leaves enough range for the parameters above."""
        name = self.declared[i].name
        rooms = [self._highest(j) - p.gap for j, p in enumerate(self.declared) if p.above == name]
        return float(min([self.declared[i].high, *rooms]))

    def _logarithms(self, values: Array) -> Array:
        return np.where(self.logarithmic, np.log(np.where(self.logarithmic, values, 1.0)), values)


# ---- The search: damped Gauss-Newton steps within the bounds --------------------------------------------------------


class _SearchPoint(Protocol):
    """Parameters of a problem, at which everything else has its best value."""

    @property
    def parameters(self) -> Array:
        """Parameters of the search (s,)."""

    @property
    def cost(self) -> float:
        """Sum of squares."""

    @property
    def normal_equations(self) -> tuple[Array, Array]:
        """Matrix (s, s) = J' J and right side (s,) = -J' r of a step of the parameters."""


PointType = TypeVar("PointType", bound=_SearchPoint)
_Reached_co = TypeVar("_Reached_co", bound=_SearchPoint, covariant=True)


class _SearchProblem(Protocol[_Reached_co]):
    """A problem that `minimum_from` solves."""

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters; infinite without a bound."""

    def at(self, parameters: Array, /) -> _Reached_co:
        """Return the point of parameters."""


@dataclass(frozen=True, eq=False)
class Residual:
    """A point that is given by its residual and its Jacobian, real or complex."""

    parameters: Array  #: Parameters (s,).
    residual: NDArray[Any]  #: Residual (R,).
    slopes: Callable[[], NDArray[Any]]  #: Function that returns the Jacobian (R, s).

    @cached_property
    def cost(self) -> float:
        """Sum of squares."""
        return float(np.real(np.vdot(self.residual, self.residual)))

    @cached_property
    def jacobian(self) -> NDArray[Any]:
        """Jacobian (R, s), computed once."""
        return self.slopes()

    @cached_property
    def normal_equations(self) -> tuple[Array, Array]:
        """Matrix (s, s) and right side (s,) for a step."""
        transposed = self.jacobian.conj().T
        return np.real(transposed @ self.jacobian), -np.real(transposed @ self.residual)


@dataclass(frozen=True, slots=True, eq=False)
class Minimum(Generic[PointType]):
    """The end of a search."""

    end: PointType  #: Last point.
    converged: bool  #: Whether it is a minimum.
    status: str  #: Description of how the search ended.

    @property
    def cost(self) -> float:
        """Sum of squares at the end."""
        return self.end.cost


#: Levenberg's damping of scaled parameters: its initial value, its factor of change, and its lower bound. In a series
#: of rejected steps the first raises it by the factor, the second by its square, and so on.
_DAMPING, _CHANGE, _LEAST_DAMPING = 1e-3, 10.0, 1e-9

#: A rejected step ends the search if its predicted gain was at most this many tolerances: the cost then has a kink, or
#: the derivatives are not accurate enough.
_NO_MORE = 10.0


def minimum_from(
    problem: _SearchProblem[PointType], start: Array, *, tolerance: float, evaluations: int, longest: float = np.inf
) -> Minimum[PointType]:
    """Search for the minimum of a problem by damped Gauss-Newton steps within its bounds.

    Args:
        problem: Problem to minimise.
        start: Starting point (s,), moved inside the bounds.
        tolerance: Relative decrease of the cost below which the search stops.
        evaluations: Maximum number of evaluations.
        longest: Largest change of a parameter in a step.
    """
    low, high = problem.bounds()
    here, damping, rise = problem.at(np.clip(start, low, high)), _DAMPING, _CHANGE
    for count in beats(range(2, evaluations + 1)):
        room = np.maximum(low - here.parameters, -longest), np.minimum(high - here.parameters, longest)
        step = _bounded_step(*here.normal_equations, *room, damping)
        there = problem.at(np.clip(here.parameters + step, low, high))
        gain = here.cost - there.cost
        if gain < 0.0:
            matrix, right = here.normal_equations
            if float(step @ (2.0 * right - matrix @ step)) <= _NO_MORE * tolerance * here.cost:
                return Minimum(here, True, f"No step within the bounds is better. {count} evaluations.")
            damping, rise = damping * rise, rise * _CHANGE
            continue
        here, damping, rise = there, max(damping / _CHANGE, _LEAST_DAMPING), _CHANGE
        if gain <= tolerance * here.cost:
            return Minimum(here, True, f"The sum of squares no longer decreases. {count} evaluations.")
    return Minimum(here, False, f"No minimum within the bounds after {evaluations} evaluations.")


def _bounded_step(matrix: Array, right: Array, low: Array, high: Array, damping: float) -> Array:
    """Return the step d (n,) in low <= d <= high with the smallest d' matrix d - 2 right' d + damping |d|^2, d scaled.

    The unconstrained step is the end if it is inside; otherwise the distance from it is the smallest, in the metric of
    the damped matrix, that leads into the box (Lawson and Hanson 1974, chapter 23).
    """
    size = np.sqrt(np.diag(matrix))
    size[size == 0.0] = 1.0
    factor = cholesky(matrix / np.outer(size, size) + damping * np.eye(size.size))
    towards = solve_triangular(factor, right / size, trans="T")
    step = solve_triangular(factor, towards) / size
    if ((step >= low) & (step <= high)).all():
        return np.asarray(step)
    unit, below, above = np.eye(size.size) / size, np.isfinite(low), np.isfinite(high)
    bounds = np.vstack([unit[below], -unit[above]])
    across = solve_triangular(factor, bounds.T, trans="T").T
    moved = _least_distance(across, np.concatenate([low[below], -high[above]]) - across @ towards)
    return np.clip(solve_triangular(factor, moved + towards) / size, low, high)


def _least_distance(matrix: Array, floor: Array) -> Array:
    """Return the shortest z (n,) with matrix z >= floor."""
    length = _sizes(matrix.T)
    rows, reach = matrix / length[:, None], floor / length
    unit = float(np.abs(reach).max())
    columns, target = np.vstack([rows.T, reach / unit]), np.append(np.zeros(rows.shape[1]), 1.0)
    left = columns @ nnls(columns, target)[0] - target
    return np.asarray(-unit * left[:-1] / left[-1])


# ---- Weights of outliers --------------------------------------------------------------------------------------------

#: `auto`: only if there are outliers; `none`; `_huber` and `_tukey`: these weights in any case.
Robust = Literal["auto", "none", "huber", "tukey"]

#: Ratio of the standard deviation to the median absolute deviation of a normal distribution.
NORMAL = 1.4826

#: Tuning constants of Huber and Tukey, in standard deviations; wide, because the residual is not normal noise.
_HUBER, _TUKEY = 2.5, 9.0

#: `auto` weights rows if one exceeds this many standard deviations, and this share of the signal's standard deviation.
_FAR, _FAR_SHARE = 8.0, 0.5

#: Above this share the model does not fit, rather than samples being outliers; `auto` then changes nothing.
_MOST_OUTLIERS = 0.05

#: A row counts as down-weighted below this weight; weights that differ by less than this give the same fit.
_DOWN, _EQUAL = 0.5, 0.05

Weigh = Callable[[Array, float], Array]


def weights_for(robust: Robust) -> Weigh | None:
    """Return the function of residuals (R,) and the signal's standard deviation that gives weights (R,), or None."""
    kinds: dict[str, Weigh | None] = {
        "none": None,
        "huber": lambda residual, _: huber(residual),
        "tukey": lambda residual, _: tukey(residual),
        "auto": _only_where_far,
    }
    return kinds[robust]


def huber(residual: Array) -> Array:
    """Return Huber's weights (R,): 1 up to a number of standard deviations, then falling as 1 / |r|."""
    size = np.abs(residual) / (_HUBER * _scale(residual))
    return np.asarray(1.0 / np.maximum(size, 1.0))


def tukey(residual: Array) -> Array:
    """Return Tukey's bisquare weights (R,): 0 beyond a number of standard deviations."""
    size = np.minimum(np.abs(residual) / (_TUKEY * _scale(residual)), 1.0)
    return np.asarray((1.0 - size**2) ** 2)


def _only_where_far(residual: Array, deviation: float) -> Array:
    far = np.abs(residual) > max(_FAR * _scale(residual), _FAR_SHARE * deviation)
    weights = tukey(residual)
    few = downweighted_rows(weights) <= _MOST_OUTLIERS * weights.size
    return weights if far.any() and few else np.ones_like(residual)


def _scale(residual: Array) -> float:
    middle = float(np.median(residual))
    return max(NORMAL * float(np.median(np.abs(residual - middle))), 1e-12)


def downweighted_rows(weights: Array) -> int:
    """Return the number of rows with a weight below one half."""
    return int(np.sum(weights < _DOWN))


class _WeightedFit(Protocol):
    """A fit whose rows have weights."""

    @property
    def weights(self) -> Array:
        """Weights (R,) of the rows."""


Fit = TypeVar("Fit", bound=_WeightedFit)


def reweighted(first: Fit, weigh: Callable[[Fit], Array], again: Callable[[Fit, Array], Fit], times: int) -> Fit:
    """Return a fit whose weights follow its own residuals.

    Args:
        first: Fit from which it starts.
        weigh: Function that returns the weights (R,) that the residuals of a fit give.
        again: Function that fits again with weights (R,), from a fit.
        times: Maximum number of reweightings.
    """
    fit = first
    for _ in range(times):
        weights = weigh(fit)
        if np.abs(weights - fit.weights).max() < _EQUAL:
            break
        if (weights == first.weights).all():
            return first  # no outliers after all; further reweighting would alternate between two results
        fit = again(fit, weights)
    return fit


# ---- Covariance, valid for correlated residuals ---------------------------------------------------------------------

#: Singular values of the scaled Jacobian below this share of the largest are directions without information.
_NO_INFORMATION = 1e-7

#: Size of the rows that fix parameters, relative to that of a column of the Jacobian.
_STIFF = 100.0

#: Upper bound of a block's leverage in a direction, so that a block that alone determines it is not left out entirely.
_MOST_LEVERAGE = 0.98


@dataclass(frozen=True, slots=True, eq=False)
class Directions:
    """Directions of the parameters (n,) that K singular vectors of a Jacobian (M, n) determine."""

    left: Array  #: Left singular vectors (M, K).
    strength: Array  #: Singular values (K,) of the Jacobian with columns of size 1.
    right: Array  #: Right singular vectors (K, n).
    size: Array  #: Sizes of the columns (n,).
    unknown: NDArray[np.bool_]  #: Whether each parameter (n,) is not determined.

    @classmethod
    def of(cls, jacobian: Array) -> Directions:
        """Return the directions of a Jacobian."""
        size = _sizes(jacobian)
        left, strength, directions = np.linalg.svd(jacobian / size, full_matrices=False)
        known = strength > _NO_INFORMATION * strength[0]
        unknown = 1.0 - np.sum(directions[known] ** 2, axis=0) > 1e-6
        return cls(left[:, known], strength[known], directions[known], size, unknown)

    def moves(self, residual: Array, blocks: Sequence[slice]) -> Array:
        """Return the changes of the parameters (B, n) when each of B blocks of rows of a residual is left out.

        Without block b, in orthogonal coordinates: (I - Q_b' Q_b)^-1 Q_b' r_b.
        """
        moves = []
        for block in blocks:
            q = self.left[block]
            if len(q) < q.shape[1]:  # a block of many settings' records determines few directions
                _, size, rows = np.linalg.svd(q, full_matrices=False)
                share, axes = size**2, rows.T
            else:
                share, axes = np.linalg.eigh(q.T @ q)
            rest = 1.0 - np.minimum(share, _MOST_LEVERAGE)
            moves.append(axes @ ((axes.T @ (q.T @ residual[block])) / rest))
        return self.parameters(np.array(moves))

    def parameters(self, orthogonal: Array) -> Array:
        """Return changes of the parameters (..., n) for those of the orthogonal coordinates (..., K)."""
        return np.asarray((orthogonal / self.strength) @ self.right / self.size)

    def covariance(self, residual: Array, blocks: Sequence[slice]) -> Array:
        """Return the covariance (n, n) of the parameters, given the residual (R,) of B independent blocks of rows.

        Rows of the Jacobian beyond the R rows are not data: they add stiffness but no scatter. Parameters that are not
        determined are NaN.
        """
        moves = self.moves(residual, blocks)
        count = moves.shape[0]
        moves = moves - moves.mean(axis=0)
        covariance = (count - 1) / count * moves.T @ moves
        covariance[self.unknown], covariance[:, self.unknown] = np.nan, np.nan
        return np.asarray(covariance, dtype=np.float64)


def with_fixed(jacobian: Array, fixed: Array) -> Array:
    """Return a Jacobian (M, n) with further rows that fix linear functions (T, n) of the parameters."""
    size = np.linalg.norm(fixed / _sizes(jacobian), axis=1)
    return np.vstack([jacobian, _STIFF * fixed / size[:, None]])


def standard_error(rows: Array, covariances: Array) -> Array:
    """Return the standard errors (M,) of linear functions of parameters: rows (M, n), covariances (..., n, n)."""
    variances = np.einsum("mi,...ij,mj->...m", rows, covariances, rows).reshape(-1, rows.shape[0])
    return np.asarray(np.sqrt(np.maximum(variances.max(axis=0), 0.0)))
