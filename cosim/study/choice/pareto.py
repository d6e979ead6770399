"""Pareto front of setups and its hypervolume."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def pareto_front(values: Array) -> Flags:
    """Return whether each row is on the Pareto front: no other row is as low in every column and lower in one.

    Args:
        values: Responses (N, M); lower is better; a row with NaN is never on the front.

    Returns:
        Flags (N,); equal rows have equal flags.
    """
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    left = known[np.lexsort(values[known].T[::-1])]  # a row that dominates another one precedes it
    front = np.zeros(values.shape[0], dtype=bool)
    while left.size:
        best = values[left[0]]
        equal = (values[left] == best).all(axis=1)
        front[left[equal]] = True
        left = left[(values[left] < best).any(axis=1)]
    return front


def hypervolume(values: Array, reference: Array) -> float:
    """Return the hypervolume that a set of setups dominates, up to a reference point.

    The volume is sliced along the last response, recursively; this is suitable for fronts of up to some hundred setups.

    Args:
        values: Responses (N, M); lower is better.
        reference: Reference point (M,); setups that do not dominate it are ignored.

    Returns:
        Hypervolume, in the product of the M units.
    """
    front = values[(values < reference).all(axis=1)]
    front = np.unique(front[pareto_front(front)], axis=0)
    if front.shape[0] == 0:
        return 0.0
    if front.shape[1] == 1:
        return float(reference[0] - front.min())
    front = front[np.argsort(front[:, -1], kind="stable")]
    heights = np.diff(front[:, -1], append=reference[-1])
    slices = (hypervolume(front[: n + 1, :-1], reference[:-1]) for n in range(front.shape[0]))
    return float(sum(area * height for area, height in zip(slices, heights, strict=True)))
