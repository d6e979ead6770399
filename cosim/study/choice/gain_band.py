"""Band around the optimum of a continuous search in which a share of its gain is kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from cosim.study.choice.continuous import Optimum, Problem
from eightpost.array_types import Array, Flags
from eightpost.errors import InputError

#: Share of the random points in a band that must keep the gain, and their number.
_KEPT, _POINTS = 0.95, 60

#: Sizes of boxes, as shares of the range, the largest first; they are bisected, as a smaller box keeps more.
_SIZES = (0.5, 0.35, 0.25, 0.18, 0.12, 0.08, 0.05, 0.03, 0.02, 0.01)


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """Points around an optimum that keep a share of its gain."""

    share: float  #: Share of the gain that is kept [1].
    size: float  #: Half-width of the box around the optimum, as a share of each range; 0: no box was large enough.
    kept: float  #: Share of the random points in the box that keep the gain and meet the constraints [1].
    points: Array  #: Random points in the box (P, n).
    alone: Array  #: Lower and upper place (n, 2) of each number within which the gain is kept while the others stay.


def band(problem: Problem, optimum: Optimum, reference: float, *, share: float = 0.8, seed: int = 1) -> Band:
    """Return the largest box around an optimum in which a share of the assured gain over a reference is kept.

    The assured gain is exceeded with a probability of 95 % over the draws of the problem, such as the cars that the
    true one may be. A box counts if 95 % of 60 random points in it keep the share of it, assured likewise, and meet the
    constraints.

    Args:
        problem: Objective and constraints, without draws of the shocks: the band shows itself what deviations cost.
        optimum: Result of `search`.
        reference: Nominal objective of the setup that the gain is counted from, such as the best of the bank.
        share: Share of the gain to keep [1].
        seed: Seed of the random points.

    Raises:
        InputError: The assured objective of the optimum is not below the reference.
    """
    gain = reference - optimum.assured
    if not gain > 0.0:
        raise InputError(
            f"the assured objective {optimum.assured:g} is not below the reference {reference:g}: there is no gain"
        )
    limit = reference - share * gain
    uniform = qmc.Sobol(problem.space.size, rng=seed).random(64)[:_POINTS]
    size, kept, points = 0.0, 0.0, np.empty((0, problem.space.size))
    first, last = 0, len(_SIZES)  # the largest box that keeps it is in _SIZES[first:last], or no box keeps it
    while first < last:
        middle = (first + last) // 2
        tried = np.clip(optimum.point + _SIZES[middle] * (2.0 * uniform - 1.0), 0.0, 1.0)
        good = float(np.mean(_keeps(problem, tried, limit)))
        if good >= _KEPT:
            size, kept, points, last = _SIZES[middle], good, tried, middle
        else:
            first = middle + 1
    return Band(share, size, kept, points, _alone(problem, optimum.point, limit))


def _keeps(problem: Problem, points: Array, limit: float) -> Flags:
    found = problem.evaluate(points)
    return np.asarray(found.allowed & (found.assured <= limit), dtype=np.bool_)


def _alone(problem: Problem, point: Array, limit: float) -> Array:
    """Return the interval (n, 2) of each coordinate, on a grid, that is connected with the point and keeps the gain."""
    steps = np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0])
    ends = np.repeat(point[:, None], 2, axis=1)
    for side, sign in enumerate((-1.0, 1.0)):
        moved = np.clip(point[:, None] + sign * steps, 0.0, 1.0)  # (n, steps)
        tried = np.repeat(point[None], moved.size, axis=0)
        rows = np.arange(moved.size)
        tried[rows, rows // steps.size] = moved.ravel()
        good = _keeps(problem, tried, limit).reshape(moved.shape)
        reached = np.cumprod(good, axis=1).sum(axis=1)
        ends[:, side] = np.where(reached > 0, moved[np.arange(point.size), np.maximum(reached - 1, 0)], point)
    return ends
