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
