"""Static points from the loops of a continuous-velocity plot (CVP) without time."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from eightpost.array_types import Array

#: Number of classes of speed on each side.
CLASSES = 25
#: A table with more rows than this, or whose velocity turns back, is a loop and not a list of peaks.
MOST_PEAKS = 200


def is_loop(velocity: Array) -> bool:
    """Return whether velocities (N,) are samples around a loop, not peaks from the lowest to the highest."""
    signs = np.sign(np.diff(velocity))
    return velocity.size > MOST_PEAKS and bool(np.diff(signs[signs != 0.0]).any())


def loop_means(velocity: Array, force: Array) -> tuple[Array, Array]:
    """Return mean velocities (K,) and mean forces (K,) in classes of velocity, in which both branches count equally.

    The difference between the branches, which is caused by lag and gas stiffness, is not used: without time it does not
    determine a lag.
    """
    rising = np.gradient(velocity) > 0.0
    found = []
    for side in (-1.0, 1.0):
        edges = np.linspace(0.0, float((side * velocity).max()), CLASSES + 1)
        for low, high in pairwise(edges.tolist()):
            inside = (side * velocity > low) & (side * velocity <= high)
            branches = [inside & rising, inside & ~rising]
            if all(branch.any() for branch in branches):
                found.append([np.mean([row[b].mean() for b in branches]) for row in (velocity, force)])
    means = np.array(found, dtype=np.float64).reshape(-1, 2)
    return means[:, 0], means[:, 1]
