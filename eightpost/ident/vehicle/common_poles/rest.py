"""Velocities that end at zero under constant inputs, exactly.

The fit holds the responses of shock velocities at 0 Hz near zero; what is left would let a coupled car creep at rest,
and a displacement would not be the integral of its velocity. The inputs of the slow states are moved by the least that
brings `C_v A^-1 B` to zero, least in the weighted response:

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

#: Frequencies at which responses are weighed; part of the largest curvature that keeps it regular [1].
_FREQUENCIES, _REGULAR = 100, 1e-12


def brought_to_rest(model: StateSpace, slow: int, s: Complex, weight: Array) -> StateSpace:
    """Return a model whose velocities have no response to constant inputs.

    Args:
        model: Stable and continuous; velocities have no direct term.
        slow: How many of its first states may be reached otherwise; lags of the roads behind them stay.
        s: Where responses are weighed (K,) [1/s].
        weight: Of the outputs' responses (p, K), 0 where they are not known.
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
    """Return what moving the inputs of the slow states costs (slow, slow)."""
    A, C = model.A[:slow, :slow], model.C[:, :slow]
    total = np.zeros((slow, slow))
    for frequency, size in zip(s, weight.T, strict=True):
        answers = size[:, None] * (C @ np.linalg.inv(frequency * np.eye(slow) - A))
        total += np.real(answers.conj().T @ answers)
    return np.asarray(total + _REGULAR * np.trace(total) * np.eye(slow))
