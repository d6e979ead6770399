"""Regression with real coefficients over the segments and frequencies of a record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.preparation.plausibility.spectra import Spectrum

#: Largest number of blocks that the jackknife leaves out in turn; a short record has one per segment.
BLOCKS = 16


class Regression(NamedTuple):
    """Coefficients of a linear law."""

    values: Array  #: Coefficients (P,).
    samples: Array  #: Coefficients (B, P) without each of B blocks of the record.
    explained: float  #: Explained share of the weighted variance [1].

    def deviation(self, numbers: Array) -> float:
        """Return the jackknife standard deviation of a figure from its values (B,) without each block."""
        count = len(numbers)
        return float(np.sqrt((count - 1) / count * np.sum((numbers - numbers.mean()) ** 2)))


def regress(output: Spectrum, inputs: Sequence[Spectrum], used: NDArray[np.bool_] | None = None) -> Regression | None:
    """Return the real coefficients c that minimise |w (y - sum_p c_p x_p)|^2, with 1 / w(f)^2 = S_y(f) + mean S_y.

    Frequencies at which y is weak get little weight, because noise dominates there.

    Args:
        output: Spectra y (S, F).
        inputs: Spectra x_p (S, F), P of them.
        used: Frequencies that are used (F,); None uses all.

    Returns:
        Coefficients; None if the output is zero or the inputs do not determine them.
    """
    chosen = slice(None) if used is None else used
    y = output[:, chosen]
    power = np.mean(np.abs(y) ** 2, axis=0)
    if not power.any():
        return None
    level = np.sqrt(power + power.mean())
    rows = np.stack([x[:, chosen] / level for x in inputs])
    scales = np.sqrt(np.mean(np.abs(rows) ** 2, axis=(1, 2)))
    if not scales.all():
        return None
    parts = [
        _normal_equations(rows[:, block] / scales[:, None, None], (y / level)[block])
        for block in np.array_split(np.arange(len(y)), min(BLOCKS, len(y)))
    ]
    gram, right, energy = (sum(part[i] for part in parts) for i in range(3))
    if np.linalg.cond(gram) > 1e10:
        return None
    values = np.linalg.solve(gram, right)
    try:
        samples = np.stack([np.linalg.solve(gram - part[0], right - part[1]) for part in parts])
    except np.linalg.LinAlgError:
        return None
    return Regression(values / scales, samples / scales, float(values @ right / energy))


def _normal_equations(rows: Spectrum, y: Spectrum) -> tuple[Array, Array, float]:
    flat, right = rows.reshape(len(rows), -1), y.ravel()
    conjugate = flat.conj()
    return (conjugate @ flat.T).real, (conjugate @ right).real, float(np.vdot(right, right).real)
