"""Multiple and partial coherence from a regression."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.response.regression import Regression

    Array = NDArray[np.float64]


def multiple_coherence(solved: Regression) -> Array:
    """Return the fraction of each output's power that all inputs explain (p, K), 1 - |E|^2 / |Y|^2; 0 without power."""
    unexplained = np.divide(solved.residual, solved.total, out=np.ones_like(solved.total), where=solved.total > 0.0)
    return np.asarray(np.clip(1.0 - unexplained, 0.0, 1.0))


def partial_coherence(solved: Regression) -> Array:
    """Return the coherence of each output and input after removal of the part that the other inputs explain (p, m, K).

    Without input j the residual increases by `|H_ij|^2 / ((U* U)^-1)_jj`. The coherence of the two conditioned signals
    is this increase over the residual without j. It is 0 where the input was dropped.
    """
    spread = np.where(solved.active, solved.spread, np.inf)[None]
    growth = np.abs(solved.H) ** 2 / spread
    without = growth + solved.residual[:, None, :]
    return np.asarray(np.divide(growth, without, out=np.zeros_like(growth), where=without > 0.0))


def response_variance(solved: Regression, blocks: int, independent: float) -> Array:
    """Return the variance of H (p, m, K) for noise on the outputs.

    Args:
        solved: Solution of the regression.
        blocks: Number of overlapping blocks R.
        independent: Equivalent number of independent blocks.
    """
    freedom = np.maximum(blocks - solved.active.sum(axis=0), 1)
    noise = solved.residual / freedom * (blocks / independent)
    return np.asarray(noise[:, None, :] * solved.spread[None], dtype=np.float64)
