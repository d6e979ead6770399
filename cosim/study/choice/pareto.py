"""Trade-offs: the setups that no other beats in everything, and how much of the space of responses they cover."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def pareto_front(values: Array) -> Flags:
    """Return which rows no other row beats: none is as low in every column and lower in one.

    Args:
        values: (N, M) responses, the lower the better; a row with NaN is never on the front.

    Returns:
        (N,) flags; of rows that are equal, all or none.
    """
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    left = known[np.lexsort(values[known].T[::-1])]  # whoever beats a row stands before it
    front = np.zeros(values.shape[0], dtype=bool)
    while left.size:
        best = values[left[0]]
        equal = (values[left] == best).all(axis=1)
        front[left[equal]] = True
        left = left[(values[left] < best).any(axis=1)]
    return front


def hypervolume(values: Array, reference: Array) -> float:
    """Return the volume of responses that a set of setups reaches or beats, up to a reference point.

    Sliced along the last response, each slice's area by the same rule: meant for fronts of up to some hundred setups.

    Args:
        values: (N, M) responses, the lower the better.
        reference: (M,) responses that a setup must beat to count.

    Returns:
        The volume, the product of the M units.
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
