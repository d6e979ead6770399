"""What the prediction leaves out: spectra of the error, and how much of it is linear in the prediction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import coherence, welch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.vehicle_validation.comparison import Comparison

    Array = NDArray[np.float64]

#: Length of Welch's blocks [s] and fewest of them (half overlapping) that say anything.
_BLOCK, _FEWEST = 4.0, 6


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSpectrum:
    """Spectra of an output and of the error of its prediction, one-sided.

    Attributes:
        frequency: (K,) [Hz].
        measured: Density (K,) [unit^2/Hz].
        error: Density (K,) [unit^2/Hz].
        coherence: Of error and prediction (K,) [1]: near 1 where another gain or phase would have predicted it.
        linear: Share of the error's power that is coherent with the prediction, the estimate's bias taken off [1].
    """

    frequency: Array
    measured: Array
    error: Array
    coherence: Array
    linear: float


def error_spectrum(found: Comparison, rate: float, band: float) -> ErrorSpectrum | None:
    """Return the spectra of an output's error; None where the record is too short for them.

    Args:
        found: The output.
        rate: Samples per second [Hz].
        band: Highest frequency [Hz].
    """
    block = round(_BLOCK * rate)
    count = 2 * found.measured.size // block - 1
    if count < _FEWEST or not found.predicted.any():
        return None
    error = found.measured - found.predicted
    frequency, measured = welch(found.measured, fs=rate, nperseg=block)
    density = welch(error, fs=rate, nperseg=block)[1]
    coherent = coherence(error, found.predicted, fs=rate, nperseg=block)[1]
    kept = (frequency > 0.0) & (frequency <= band)
    unbiased = np.clip((count * coherent[kept] - 1.0) / (count - 1.0), 0.0, 1.0)
    share = float(unbiased @ density[kept] / density[kept].sum()) if density[kept].any() else 0.0
    return ErrorSpectrum(frequency[kept], measured[kept], density[kept], coherent[kept], share)
