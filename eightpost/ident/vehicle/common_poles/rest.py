"""Correction of a model so that its velocities have exactly no response to constant inputs.

The fit keeps the responses of shock velocities at 0 Hz only near zero. With the remainder a coupled car would creep at
rest, and a displacement would not be the integral of its velocity. The input matrix of the slow states is therefore
changed so that `C_v A^-1 B` is zero, with the minimum change of the weighted response:

    min over dB of  sum_k |weight_ik C_i (s_k I - A)^-1 dB|^2   with   C_v A^-1 (B + dB) = 0
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.vehicle.statespace import StateSpace

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

#: Number of frequencies at which the change is evaluated, and relative regularisation of its curvature [1].
_FREQUENCIES, _REGULAR = 100, 1e-12


def bring_to_rest(model: StateSpace, slow: int, s: Complex, weight: Array) -> StateSpace:
    """Return the model with velocities that have no response to constant inputs.

    Args:
        model: Stable continuous model; velocities have no direct term.
        slow: Number of leading states whose inputs may change; the road lags after them stay unchanged.
        s: Values of s at which the change is evaluated [1/s] (K,).
        weight: Weight of the outputs' responses (p, K); 0 where they are unknown.
    """
    velocities = [i for i, name in enumerate(model.output_names) if name.rpartition(".")[2] == "velocity"]
    if not velocities:
        return model
    held = np.linalg.solve(model.A.T, model.C[velocities].T).T
    chosen = slice(None, None, max(1, s.size // _FREQUENCIES))
    inverse = np.linalg.inv(_curvature(model, slow, s[chosen], weight[:, chosen]))
    moved, left = held[:, :slow], held @ model.B
    B = model.B.copy()
    B[:slow] -= inverse @ moved.T @ np.linalg.solve(moved @ inverse @ moved.T, left)
    return replace(model, B=B)


def _curvature(model: StateSpace, slow: int, s: Complex, weight: Array) -> Array:
    """Return the cost matrix of changes of the slow states' inputs (slow, slow)."""
    A, C = model.A[:slow, :slow], model.C[:, :slow]
    total = np.zeros((slow, slow))
    for frequency, size in zip(s, weight.T, strict=True):
        answers = size[:, None] * (C @ np.linalg.inv(frequency * np.eye(slow) - A))
        total += np.real(answers.conj().T @ answers)
    return np.asarray(total + _REGULAR * np.trace(total) * np.eye(slow))
