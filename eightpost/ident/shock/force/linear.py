"""Linear least squares by singular values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def linear_solution(columns: Array, target: Array) -> Array:
    """Return the weights (n,) of columns (N, n) that fit a target (N,) by least squares, using singular values."""
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    weights, *_ = np.linalg.lstsq(columns / size, target, rcond=1e-12)
    return np.asarray(weights / size, dtype=np.float64)


def solved(columns: Array, target: Array, weights: Array) -> Array:
    """Return the weighted least-squares solution (n,) of columns (R, n) for a target (R,)."""
    root = np.sqrt(weights)
    return linear_solution(root[:, None] * columns, root * target)
