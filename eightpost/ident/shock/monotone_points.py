"""A curve through given points: Fritsch and Carlson's monotone interpolant (PCHIP) as knots of a static curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator
from scipy.optimize import isotonic_regression

from eightpost.array_types import Array
from eightpost.shock import StaticCurve
from eightpost.shock.curve import KNOTS

#: Number of points on each side that a static curve can pass through.
MOST_POINTS = KNOTS // 2

#: Number of velocities in each cell between points at which a candidate cell is compared with the interpolant.
_PLACES = 8

#: Maximum number of points on a side among which the best are searched; of more, evenly spread ones are candidates.
_MOST_CANDIDATES = 120


def curve_through(velocity: Array, force: Array) -> tuple[StaticCurve, PchipInterpolator]:
    """Return the curve through points, and the monotone interpolant of all points that it represents.

    With up to 12 points on each side the curve is the interpolant. With more, it passes through the 12 points between
    which cubics with the interpolant's slopes follow it best.

    Args:
        velocity: Velocities (M,) [m/s], ascending, with 0 and points on both sides of it.
        force: Forces (M,) [N] that nowhere fall, 0 at zero velocity; `held` makes them so.
    """
    joined = PchipInterpolator(velocity, force)
    zero = int(np.searchsorted(velocity, 0.0))
    rebound = _kept(joined, -velocity[zero::-1], -1.0)
    compression = _kept(joined, velocity[zero:], 1.0)
    knots = np.concatenate([_filled(-rebound[::-1]), _filled(compression)[1:]])
    chosen = np.concatenate([-rebound[:0:-1], compression])
    slopes = np.maximum(joined(chosen, 1), 0.0)
    spline = CubicHermiteSpline(chosen, joined(chosen), slopes)
    forces = spline(knots)
    forces[KNOTS // 2] = 0.0
    rising = np.maximum(spline(knots, 1), 0.0)
    return StaticCurve.through_knots(*(tuple(values.tolist()) for values in (knots, forces, rising))), joined


def held(velocity: Array, force: Array) -> Array:
    """Return the forces (M,) [N] that nowhere fall and are closest to given ones by least squares; 0 at zero velocity.

    Means over neighbours that fall (pool adjacent violators), and none with the wrong sign for its stroke. They are
    rounded to 1e-9 N, because harmonic means of smaller differences overflow in the interpolant.
    """
    sides = velocity < 0.0, velocity > 0.0
    found = np.zeros_like(force)
    for side, low, high in zip(sides, (-np.inf, 0.0), (0.0, np.inf), strict=True):
        found[side] = np.clip(isotonic_regression(force[side]).x, low, high)
    return np.round(found, 9)


def _filled(knots: Array) -> Array:
    """Return the knots of a side (13,): its widest cells are halved, where the same cubic continues."""
    while knots.size <= MOST_POINTS:
        widest = int(np.argmax(np.diff(knots)))
        knots = np.insert(knots, widest + 1, 0.5 * (knots[widest] + knots[widest + 1]))
    return knots


def _kept(joined: PchipInterpolator, speeds: Array, side: float) -> Array:
    """Return zero and the speeds of a side (at most 13,) that become knots.

    Args:
        joined: Interpolant of all points.
        speeds: Zero and the speeds of the side's points, ascending [m/s].
        side: Sign of the velocities, 1 or -1.
    """
    if speeds.size <= MOST_POINTS + 1:
        return speeds
    if speeds.size > _MOST_CANDIDATES:
        speeds = speeds[np.unique(np.linspace(0, speeds.size - 1, _MOST_CANDIDATES).astype(int))]
    return speeds[_shortest_path(_cell_costs(joined, speeds, side), MOST_POINTS)]


def _cell_costs(joined: PchipInterpolator, speeds: Array, side: float) -> Array:
    """Return the error (K, K) of a cubic from each speed to each higher one: integral of its square [N2.m/s].

    A cubic that falls costs more than any other.
    """
    count = speeds.size
    force, slope = side * joined(side * speeds), np.maximum(joined(side * speeds, 1), 0.0)
    share = (np.arange(_PLACES) + 0.5) / _PLACES
    places = (speeds[:-1, None] + np.diff(speeds)[:, None] * share).ravel()
    weight = np.repeat(np.diff(speeds) / _PLACES, _PLACES)
    target = side * joined(side * places)
    costs = np.full((count, count), np.inf)
    for i in range(count - 1):
        for j in range(i + 1, count):
            here = slice(i * _PLACES, j * _PLACES)
            cubic = CubicHermiteSpline(speeds[[i, j]], force[[i, j]], slope[[i, j]])(places[here])
            costs[i, j] = float(np.sum(weight[here] * (cubic - target[here]) ** 2))
            if np.diff(cubic, prepend=force[i], append=force[j]).min() < 0.0:
                costs[i, j] += float(np.ptp(force) ** 2 * speeds[-1])
    return costs


def _shortest_path(costs: Array, cells: int) -> NDArray[np.intp]:
    """Return the indices (cells + 1,) from the first to the last point with the lowest sum of costs (K, K)."""
    count = costs.shape[0]
    total, before = costs[0].copy(), []
    for _ in range(cells - 1):
        sums = total[:, None] + costs
        before.append(np.argmin(sums, axis=0))
        total = sums[before[-1], np.arange(count)]
    path = [count - 1]
    for origin in reversed(before):
        path.append(int(origin[path[-1]]))
    return np.array([0, *reversed(path)], dtype=np.intp)
