"""Least-squares problem of a fit, with bounds and constraints."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

from eightpost.array_types import Array
from eightpost.ident.shock.force import ForceModel
from eightpost.ident.shock.uncertainty import block_changes, covariances
from eightpost.progress import beat

# ---- The solution that a recipe returns -----------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Parameters of a force model found by a recipe."""

    model: ForceModel  #: Force model, with the gas columns that were kept.
    parameters: Array  #: Parameters (n + g + k,) of curve, gas, theta.
    #: Covariances (3, n + g + k, n + g + k), see `covariances`; NaN rows for parameters that are undetermined or were
    #: fixed.
    covariance: Array
    converged: bool  #: Whether the optimiser ended at a minimum.
    status: str  #: Description of how the optimiser ended.
    notes: tuple[str, ...] = ()  #: Changes that the recipe made, one sentence each.
    #: Changes of the parameters (B, n + g + k) when each block is left out, see `block_changes`; (0, 0) if they are not
    #: known.
    left_out: Array = field(default_factory=lambda: np.empty((0, 0)))


# ---- Nonlinear least squares with linear inequality constraints, such as a curve that must not fall -----------------

#: Levenberg's damping of scaled columns: its initial value, its factor of change, and its lower bound. In a series of
#: rejected steps the first raises it by the factor, the second by its square, and so on, as small changes do nothing.
_DAMPING, _CHANGE, _LEAST_DAMPING = 1e-6, 10.0, 1e-9

#: A rejected step ends the search if its predicted gain was at most this many tolerances: the cost then has a kink, or
#: the derivatives are not accurate enough.
_NO_MORE = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Inequalities:
    """Linear inequalities matrix @ x >= floor."""

    matrix: Array  #: Matrix (J, n).
    floor: Array  #: Lower bounds (J,).

    def room(self, x: Array) -> Array:
        """Return the distance (J,) of x from each bound, positive inside."""
        return np.asarray(self.matrix @ x - self.floor)

    def and_bounds(self, low: Array, high: Array) -> Inequalities:
        """Return these inequalities together with low <= x <= high."""
        unit, below, above = np.eye(low.size), np.isfinite(low), np.isfinite(high)
        return Inequalities(
            np.vstack([self.matrix, unit[below], -unit[above]]),
            np.concatenate([self.floor, low[below], -high[above]]),
        )


class _SearchResult(NamedTuple):
    """The end of a search: x (n,), whether it is a minimum, and a description of how the search ended."""

    x: Array
    converged: bool
    status: str


def constrained_least_squares(
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    start: Array,
    inequalities: Inequalities,
    *,
    tolerance: float,
    evaluations: int,
) -> _SearchResult:
    """Minimise the sum of squares under linear inequality constraints.

    Args:
        residual: Function from (n,) to (R,).
        jacobian: Function from (n,) to (R, n).
        start: Starting point (n,); it may violate the constraints.
        inequalities: Constraints; there must be points that satisfy all of them.
        tolerance: Relative decrease of the sum of squares below which the search stops.
        evaluations: Maximum number of evaluations of the residual.
    """
    x, error, slopes = start, residual(start), jacobian(start)
    cost = float(error @ error) if (inequalities.room(x) >= 0.0).all() else np.inf
    damping, rise = _DAMPING, _CHANGE
    for count in range(2, evaluations + 1):
        step = _step(slopes, error, Inequalities(inequalities.matrix, -inequalities.room(x)), damping)
        tried = residual(x + step)
        gain = cost - float(tried @ tried)
        if gain < 0.0:
            promised = cost - float(np.sum((error + slopes @ step) ** 2))
            if promised <= _NO_MORE * tolerance * cost:
                return _SearchResult(x, True, f"No step within the constraints is better. {count} evaluations.")
            damping, rise = damping * rise, rise * _CHANGE
            continue
        x, error, cost = x + step, tried, cost - gain if np.isfinite(cost) else float(tried @ tried)
        if gain <= tolerance * cost:
            return _SearchResult(x, True, f"The sum of squares no longer decreases. {count} evaluations.")
        slopes, damping, rise = jacobian(x), max(damping / _CHANGE, _LEAST_DAMPING), _CHANGE
    return _SearchResult(x, False, f"No minimum within the constraints after {evaluations} evaluations.")


def _step(slopes: Array, error: Array, inequalities: Inequalities, damping: float) -> Array:
    """Return the step d (n,) that minimises |error + slopes d|^2 + damping |d|^2, d scaled, with matrix d >= floor."""
    size = np.linalg.norm(slopes, axis=0)
    size[size == 0.0] = 1.0
    zeros = np.zeros(size.size)
    q, r = np.linalg.qr(np.vstack([slopes / size, np.sqrt(damping) * np.eye(size.size)]))
    towards = q.T @ np.append(error, zeros)
    across = solve_triangular(r, (inequalities.matrix / size).T, trans="T").T
    moved = _least_distance(across, inequalities.floor + across @ towards)
    return np.asarray(solve_triangular(r, moved - towards) / size)


def _least_distance(matrix: Array, floor: Array) -> Array:
    """Return the shortest z (n,) with matrix z >= floor (Lawson and Hanson 1974, chapter 23)."""
    if (floor <= 0.0).all():
        return np.zeros(matrix.shape[1])
    length = np.linalg.norm(matrix, axis=1)
    length[length == 0.0] = 1.0
    rows, reach = matrix / length[:, None], floor / length
    unit = float(np.abs(reach).max())
    target = np.append(np.zeros(rows.shape[1]), 1.0)
    weights, _ = nnls(np.vstack([rows.T, reach / unit]), target)
    left = np.vstack([rows.T, reach / unit]) @ weights - target
    return np.asarray(-unit * left[:-1] / left[-1])


# ---- The nonlinear least-squares problem of the joint recipe, and its minimum ---------------------------------------

#: Maximum number of evaluations of the residual; a curve at its constraint needs many.
_EVALUATIONS = 200

#: Relative decrease of the sum of squares below which the search stops.
TOLERANCE = 1e-6

#: Lowest slope of a curve times the highest speed [N]; it covers rounding.
CLEAR_SLOPE = 1e-6

#: In the covariance, a violation of an active constraint by 1 N counts like a force error of this many N everywhere.
_STIFF = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Weighted force error of a model at the rows, followed by the penalties of its curve, which must not fall."""

    model: ForceModel  #: Model of the force.
    tolerance: float = TOLERANCE  #: Relative decrease of the sum of squares below which the search stops.

    def residual(self, parameters: Array) -> Array:
        """Return the weighted force error and the penalties (R + P,) [N] of parameters (n + g + k,)."""
        beat()
        runs, penalty = self.model.runs, self.model.penalty
        error = np.sqrt(runs.weights) * (self.model.rows(parameters) - runs.target)
        return np.concatenate([error, penalty @ parameters[: self.model.curve_count]])

    def jacobian(self, parameters: Array) -> Array:
        """Return the derivative (R + P, n + g + k) of `residual` at parameters (n + g + k,)."""
        penalty, slopes = self.model.penalty, self.model.rows_jacobian(parameters)
        rest = np.zeros((len(penalty), slopes.shape[1] - penalty.shape[1]))
        return np.vstack([np.sqrt(self.model.runs.weights)[:, None] * slopes, np.hstack([penalty, rest])])

    def at(self, parameters: Array, status: str) -> Minimum:
        """Return given parameters (n + g + k,) as a minimum, without a search."""
        return Minimum(self, parameters, self.residual(parameters), self.jacobian(parameters), True, status)

    def minimum_from(self, start: Array) -> Minimum:
        """Optimise all parameters from a start (n + g + k,)."""
        low, high = self.model.bounds()
        matrix = np.eye(self.model.curve_count, low.size)
        ended = constrained_least_squares(
            self.residual,
            self.jacobian,
            np.clip(start, low, high),
            Inequalities(matrix, np.full(len(matrix), CLEAR_SLOPE)).and_bounds(low, high),
            tolerance=self.tolerance,
            evaluations=_EVALUATIONS,
        )
        return replace(self.at(np.clip(ended.x, low, high), ended.status), converged=ended.converged)


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """The end of a search."""

    problem: Problem  #: Problem that was minimised.
    parameters: Array  #: Parameters (n + g + k,) at the minimum.
    residual: Array  #: Residual (R + P,) at the minimum, with penalties [N].
    jacobian: Array  #: Jacobian of the residual at the minimum.
    converged: bool  #: Whether it is a minimum.
    status: str  #: Description of how the search ended.

    @property
    def cost(self) -> float:
        """Sum of squares of the force error at the rows and of the penalties [N2]."""
        return float(self.residual @ self.residual)

    @property
    def curve(self) -> Array:
        """The curve's coefficients b (n,)."""
        return self.parameters[: self.problem.model.curve_count]

    def solution(self) -> Solution:
        """Return the solution with its covariance."""
        model = self.problem.model
        error = self.residual[: model.runs.target.size]
        jacobian = np.vstack([self.jacobian, self._stiff()])
        spread, left_out = covariances(jacobian, error, model.runs), block_changes(jacobian, error, model.runs)
        return Solution(model, self.parameters, spread, self.converged, self.status, left_out=left_out)

    def _stiff(self) -> Array:
        """Return rows (T, n + g + k) that fix the slopes that are at their bound."""
        touched = np.flatnonzero(self.curve < 2.0 * CLEAR_SLOPE)
        return np.asarray(_STIFF * np.sqrt(self.residual.size) * np.eye(self.parameters.size)[touched])
