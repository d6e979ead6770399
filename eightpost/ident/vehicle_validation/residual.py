"""Spectra of the prediction error, and the part of it that is linear in the prediction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import coherence, welch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.vehicle_validation.comparison import Comparison

    Array = NDArray[np.float64]

#: Length of Welch's blocks [s] and the minimum number of them (overlapping by half).
_BLOCK, _FEWEST = 4.0, 6


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSpectrum:
    """Spectra of an output and of the error of its prediction, one-sided.

    Attributes:
        frequency: Frequencies (K,) [Hz].
        measured: Power spectral density of the measured output (K,) [unit^2/Hz].
        error: Power spectral density of the error (K,) [unit^2/Hz].
        coherence: Coherence of error and prediction (K,) [1]; near 1 if another gain or phase would have predicted it.
        linear: Fraction of the error's power that is coherent with the prediction, corrected for bias [1].
    """

    frequency: Array
    measured: Array
    error: Array
    coherence: Array
    linear: float


def error_spectrum(output: Comparison, rate: float, band: float) -> ErrorSpectrum | None:
    """Return the spectra of an output's error; None if the record is too short for them.

    Args:
        output: Measured and predicted output.
        rate: Sample rate [Hz].
        band: Highest frequency [Hz].
    """
    block = round(_BLOCK * rate)
    count = 2 * output.measured.size // block - 1
    if count < _FEWEST or not output.predicted.any():
        return None
    error = output.measured - output.predicted
    frequency, measured = welch(output.measured, fs=rate, nperseg=block)
    density = welch(error, fs=rate, nperseg=block)[1]
    coherent = coherence(error, output.predicted, fs=rate, nperseg=block)[1]
    kept = (frequency > 0.0) & (frequency <= band)
    unbiased = np.clip((count * coherent[kept] - 1.0) / (count - 1.0), 0.0, 1.0)
    share = float(unbiased @ density[kept] / density[kept].sum()) if density[kept].any() else 0.0
    return ErrorSpectrum(frequency[kept], measured[kept], density[kept], coherent[kept], share)
