"""Exact discretisation of models whose states form many independent parts, such as parallel sections."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from eightpost.vehicle import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def discretise_by_parts(A: Array, B: Array, step: float) -> kernel.Discrete:
    """Return `kernel.discretise(A, B, step)`, computed part by part, as one for 1200 states takes minutes."""
    count, part = connected_components(csr_array(A != 0.0), directed=False)
    Ad, B0, B1 = np.zeros_like(A), np.zeros_like(B), np.zeros_like(B)
    for number in range(count):
        states = np.flatnonzero(part == number)
        driven = np.flatnonzero(B[states].any(axis=0))
        found = kernel.discretise(A[np.ix_(states, states)], B[np.ix_(states, driven)], step)
        Ad[np.ix_(states, states)] = found.Ad
        B0[np.ix_(states, driven)], B1[np.ix_(states, driven)] = found.B0, found.B1
    return kernel.Discrete(Ad, B0, B1)
