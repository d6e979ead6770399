"""Nonlinear least squares between walls: linear inequalities that the parameters keep, as a curve that must not fall.

Gauss-Newton steps with Levenberg's damping, each the exact solution of its linear problem between the walls. A price
on violations would need a margin and many more evaluations: it is a kink that moves.
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

#: Levenberg's damping of scaled columns: at first, its change, and where it is no longer lowered. Of steps in a row
#: that are no better the first raises it by the change, the second by its square, and so on: a little does nothing.
_DAMPING, _CHANGE, _LEAST_DAMPING = 1e-6, 10.0, 1e-9

#: A step that is no better was the last if it promised no more than so many tolerances: a kink, or slopes that are not
#: known better.
_NO_MORE = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Walls:
    """matrix @ x >= floor.

    Attributes:
        matrix: (J, n).
        floor: (J,).
    """

    matrix: Array
    floor: Array

    def room(self, x: Array) -> Array:
        """Return how far (J,) x is inside."""
        return np.asarray(self.matrix @ x - self.floor)

    def and_bounds(self, low: Array, high: Array) -> Walls:
        """Return these walls and low <= x <= high as more of them."""
        unit, below, above = np.eye(low.size), np.isfinite(low), np.isfinite(high)
        return Walls(
            np.vstack([self.matrix, unit[below], -unit[above]]),
            np.concatenate([self.floor, low[below], -high[above]]),
        )


class Walled(NamedTuple):
    """Where the steps ended: x (n,), whether it is a minimum, and that in words."""

    x: Array
    converged: bool
    status: str


def least_squares_between(
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    start: Array,
    walls: Walls,
    *,
    tolerance: float,
    evaluations: int,
) -> Walled:
    """Minimise the sum of squares between walls.

    Args:
        residual: (n,) to (R,).
        jacobian: (n,) to (R, n).
        start: (n,); may be outside.
        walls: They must leave room.
        tolerance: Share of the sum of squares that a step must win for another one.
        evaluations: Of the residual, at most.
    """
    x, error, slopes = start, residual(start), jacobian(start)
    cost = float(error @ error) if (walls.room(x) >= 0.0).all() else np.inf
    damping, rise = _DAMPING, _CHANGE
    for count in range(2, evaluations + 1):
        step = _step(slopes, error, Walls(walls.matrix, -walls.room(x)), damping)
        tried = residual(x + step)
        gain = cost - float(tried @ tried)
        if gain < 0.0:
            promised = cost - float(np.sum((error + slopes @ step) ** 2))
            if promised <= _NO_MORE * tolerance * cost:
                return Walled(x, True, f"No step between the walls is better. {count} evaluations.")
            damping, rise = damping * rise, rise * _CHANGE
            continue
        x, error, cost = x + step, tried, cost - gain if np.isfinite(cost) else float(tried @ tried)
        if gain <= tolerance * cost:
            return Walled(x, True, f"Steps between the walls win no more. {count} evaluations.")
        slopes, damping, rise = jacobian(x), max(damping / _CHANGE, _LEAST_DAMPING), _CHANGE
    return Walled(x, False, f"No minimum between the walls within {evaluations} evaluations.")


def _step(slopes: Array, error: Array, walls: Walls, damping: float) -> Array:
    """Return the d (n,) of least |error + slopes d|^2 + damping |d|^2 (columns scaled) with matrix d >= floor."""
    size = np.linalg.norm(slopes, axis=0)
    size[size == 0.0] = 1.0
    zeros = np.zeros(size.size)
    q, r = np.linalg.qr(np.vstack([slopes / size, np.sqrt(damping) * np.eye(size.size)]))
    towards = q.T @ np.append(error, zeros)
    across = solve_triangular(r, (walls.matrix / size).T, trans="T").T
    moved = _least_distance(across, walls.floor + across @ towards)
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
