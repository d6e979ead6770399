"""Analysis of the residual: its spectrum, and the part that the velocity explains linearly."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import coherence, welch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.validation.evaluation import Validation

    Array = NDArray[np.float64]

#: Length of Welch's blocks [s]: 1 Hz of resolution, and 17 half-overlapping blocks in 9 s.
BLOCK = 1.0

#: Minimum number of blocks for a meaningful coherence.
_FEWEST = 4

#: Correlation of half-overlapping Hann blocks' periodograms (Welch 1967): 1 / 36.
_OVERLAP = 1.0 / 36.0


@dataclass(frozen=True, slots=True, eq=False)
class Residual:
    """Spectra of a residual e = measured minus predicted force, and its coherence with the velocity v.

        coherence(f) = |S_ev|^2 / (S_ee S_vv)

    Where the coherence is near 1, a linear filter of the velocity would predict the residual: the law misses dynamics,
    a lag for example. A coherence below `threshold` is not significant.

    Attributes:
        frequency: Frequencies (K,) [Hz], up to the record's low-pass.
        coherence: Coherence (K,) [1].
        density: One-sided spectral density of the residual (K,) [N2/Hz].
        force_density: One-sided spectral density of the measured force (K,) [N2/Hz].
        threshold: Value that the coherence of unrelated signals exceeds at 5 % of the frequencies [1].
        share: Share of the residual's power that is coherent, corrected for the bias of the estimate [1].
    """

    frequency: Array
    coherence: Array
    density: Array
    force_density: Array
    threshold: float
    share: float


def residual_of(validation: Validation) -> Residual | None:
    """Return the residual's spectra; None if the record is shorter than four half-overlapping blocks.

    Args:
        validation: Validation on a record that moves at many frequencies.
    """
    rate = validation.measured.sample_rate
    block = round(BLOCK * rate)
    count = 2 * len(validation.measured) // block - 1
    if count < _FEWEST:
        return None
    error, velocity = validation.error, validation.measured["velocity"]
    frequency, coherent = coherence(error, velocity, fs=rate, nperseg=block)
    _, density = welch(error, fs=rate, nperseg=block)
    _, force_density = welch(validation.measured["force"], fs=rate, nperseg=block)
    kept = (frequency > 0.0) & (frequency <= validation.cutoff)
    averages = count / (1.0 + 2.0 * _OVERLAP * (count - 1) / count)
    return Residual(
        frequency=frequency[kept],
        coherence=coherent[kept],
        density=density[kept],
        force_density=force_density[kept],
        threshold=1.0 - 0.05 ** (1.0 / (averages - 1.0)),
        share=_share(coherent[kept], density[kept], averages),
    )


def _share(coherent: Array, density: Array, averages: float) -> float:
    """Return the coherent share of a density; for n averages, unrelated signals have a coherence of 1 / n."""
    unbiased = np.clip((averages * coherent - 1.0) / (averages - 1.0), 0.0, 1.0)
    total = float(density.sum())
    return float(unbiased @ density) / total if total > 0.0 else 0.0
