"""Scaled linear regression over blocks, for all frequencies at once.

The columns are scaled to length 1 before the decomposition. With roads in metres and forces in newtons the condition
number of the normal equations is 1e11 and more; with scaled columns it is about ten.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

#: Condition number of the scaled columns above which the inputs are not independent.
WORST_CONDITION = 1e7


class Regression(NamedTuple):
    """Solution of `Y = U H^T + E` at every frequency.

    Attributes:
        H: Responses (p, m, K); 0 where an input was dropped.
        spread: Diagonal of (U* U)^-1 (m, K); infinite where an input was dropped.
        residual: Sum of |E|^2 (p, K).
        total: Sum of |Y|^2 (p, K).
        active: Mask of the inputs that were kept (m, K).
    """

    H: Complex
    spread: Array
    residual: Array
    total: Array
    active: NDArray[np.bool_]


def regress(U: Complex, Y: Complex, *, power_floor: float, names: Sequence[str]) -> Regression:
    """Solve for H; inputs are dropped at frequencies where they have no power.

    Args:
        U: Inputs (K, R, m).
        Y: Outputs (K, R, p).
        power_floor: Amplitude of an input, relative to its largest over frequency, below which it is dropped [1].
        names: Names of the inputs, for messages.

    Raises:
        InputError: There are not more blocks than inputs, an input is zero, or inputs depend on each other.
    """
    if U.shape[1] <= U.shape[2]:
        raise InputError(f"{U.shape[1]} blocks are too few for {U.shape[2]} inputs; use shorter blocks or more data")
    size = np.linalg.norm(U, axis=1)
    active = powered(size, power_floor, names)
    scale = np.where(active, size, 1.0)
    left, singular, right = np.linalg.svd(U * (active / scale)[:, None, :], full_matrices=False)
    inverse = _inverted(singular, active, names)
    coordinates = left.conj().transpose(0, 2, 1) @ Y
    V = right.conj().transpose(0, 2, 1) * inverse[:, None, :]
    H = (V @ coordinates) / scale[:, :, None]
    residual = np.sum(np.abs(Y - U @ H) ** 2, axis=1)
    spread = np.where(active, np.sum(np.abs(V) ** 2, axis=2) / scale**2, np.inf)
    total = np.sum(np.abs(Y) ** 2, axis=1)
    return Regression(np.ascontiguousarray(H.transpose(2, 1, 0)), spread.T, residual.T, total.T, active.T)


def powered(size: Array, power_floor: float, names: Sequence[str]) -> NDArray[np.bool_]:
    """Return the mask of frequencies at which an input has power (K, m), from its amplitudes `size` (K, m)."""
    largest = size.max(axis=0)
    for name, value in zip(names, largest, strict=True):
        if not value > 0.0:
            raise InputError(f"the input {name!r} is zero in all records; remove it from the inputs")
    return np.asarray(size > power_floor * largest, dtype=np.bool_)


def _inverted(singular: Array, active: NDArray[np.bool_], names: Sequence[str]) -> Array:
    """Invert the singular values (K, m) of the active columns; the zeros of dropped columns remain 0."""
    rank = active.sum(axis=1)
    kept = np.arange(singular.shape[1])[None, :] < rank[:, None]
    smallest = np.min(np.where(kept, singular, np.inf), axis=1, initial=np.inf)
    dependent = (rank > 0) & (smallest * WORST_CONDITION < singular[:, 0])
    if dependent.mean() > 0.5:
        raise InputError(
            f"the inputs {', '.join(names)} depend linearly on each other (condition above {WORST_CONDITION:g} at most "
            "frequencies): with linear shocks the rig's inputs determine the forces (Eq 5.34); add records with "
            "another shock at each corner"
        )
    safe = np.where(kept & (singular * WORST_CONDITION >= singular[:, :1]), singular, np.inf)
    return np.asarray(1.0 / safe, dtype=np.float64)
