"""Nonlinear least squares with linear inequality constraints, such as a curve that must not fall.

Gauss-Newton steps with Levenberg's damping, each the exact solution of its linear problem under the constraints. A
penalty on violations would need a margin and many more evaluations, because its kink moves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Levenberg's damping of scaled columns: its initial value, its factor of change, and its lower bound. In a series of
#: rejected steps the first raises it by the factor, the second by its square, and so on, as small changes do nothing.
_DAMPING, _CHANGE, _LEAST_DAMPING = 1e-6, 10.0, 1e-9

#: A rejected step ends the search if its predicted gain was at most this many tolerances: the cost then has a kink, or
#: the derivatives are not accurate enough.
_NO_MORE = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Inequalities:
    """Linear inequalities matrix @ x >= floor.

    Attributes:
        matrix: Matrix (J, n).
        floor: Lower bounds (J,).
    """

    matrix: Array
    floor: Array

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


class SearchResult(NamedTuple):
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
) -> SearchResult:
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
                return SearchResult(x, True, f"No step within the constraints is better. {count} evaluations.")
            damping, rise = damping * rise, rise * _CHANGE
            continue
        x, error, cost = x + step, tried, cost - gain if np.isfinite(cost) else float(tried @ tried)
        if gain <= tolerance * cost:
            return SearchResult(x, True, f"The sum of squares no longer decreases. {count} evaluations.")
        slopes, damping, rise = jacobian(x), max(damping / _CHANGE, _LEAST_DAMPING), _CHANGE
    return SearchResult(x, False, f"No minimum within the constraints after {evaluations} evaluations.")


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
