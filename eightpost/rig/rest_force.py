"""Force of a shock at standstill: gas force, and an error of the load cell's zero."""

from __future__ import annotations

import numpy as np

from eightpost.array_types import Array

#: Speeds below this share of the peak count as standstill.
SLOW = 0.05


def rest_force(velocity: Array, force: Array) -> tuple[float, float] | None:
    """Return the force at standstill [N] and its standard error; None without samples on both sides of standstill.

    It is the mean of the forces just above and just below zero velocity, so that friction cancels.
    """
    limit = SLOW * float(np.abs(velocity).max())
    sides = [force[(velocity > 0.0) & (velocity <= limit)], force[(velocity < 0.0) & (velocity >= -limit)]]
    if min(side.size for side in sides) < 5:
        return None
    error = np.sqrt(sum(float(side.var()) / side.size for side in sides)) / 2.0
    return float(np.mean([side.mean() for side in sides])), float(error)


def pulls_at_standstill(velocity: Array, force: Array, limit: float) -> bool:
    """Return whether the force is below -limit [N] both when a compression and when a rebound stroke ends.

    A lag keeps part of a stroke's force at its end. If rebound is stiffer than compression, the mean of the two ends is
    therefore negative without any gas force, but the end of compression is positive.

    Args:
        velocity: Velocity (N,) [m/s].
        force: Force (N,) [N].
        limit: Force above which a negative force counts [N].
    """
    near = np.abs(velocity) <= SLOW * float(np.abs(velocity).max())
    slope = np.gradient(velocity)
    for side in (1.0, -1.0):  # compression, rebound; each has its own slope at standstill
        chosen = near & (side * velocity > 0.0) & (side * slope < 0.0)
        if np.count_nonzero(chosen) < 5 or not np.ptp(velocity[chosen]) > 0.0:
            return False
        if np.polynomial.polynomial.polyfit(velocity[chosen], force[chosen], 1)[0] >= -limit:
            return False
    return True
