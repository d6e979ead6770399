"""Spectra of a prediction's error, and the part of the error that is linear in another signal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSpectrum:
    """Spectra of an error e = measured minus predicted, and its coherence with a signal v.

        coherence(f) = |S_ev|^2 / (S_ee S_vv)

    Where the coherence is near 1, a linear filter of the signal would predict the error. A coherence below `threshold`
    is not significant.
    """

    frequency: Array  #: Frequencies (K,) [Hz].
    coherence: Array  #: Coherence (K,) [1].
    error: Array  #: One-sided power spectral density of the error (K,) [unit^2/Hz].
    measured: Array  #: One-sided power spectral density of the measured signal (K,) [unit^2/Hz].
    threshold: float  #: Value that the coherence of unrelated signals exceeds at 5 % of the frequencies [1].
    share: float  #: Share of the error's power that is coherent, corrected for the bias of the estimate [1].


def error_spectrum(
    measured: Array, predicted: Array, signal: Array, *, rate: float, band: float, block: float, fewest: int,
    overlap: float = 0.0,
) -> ErrorSpectrum | None:  # fmt: skip
    """Return the spectra of an error by Welch's method; None if the record is too short for them.

    Args:
        measured: Measured values (N,).
        predicted: Predicted values (N,).
        signal: Signal (N,) that the error may be coherent with.
        rate: Sample rate [Hz].
        band: Highest frequency [Hz].
        block: Length of the blocks [s], which overlap by half.
        fewest: Minimum number of blocks for a meaningful coherence.
        overlap: Correlation of the periodograms of overlapping blocks [1].
    """
    from scipy.signal import coherence, welch  # noqa: PLC0415 -- takes half a second to load, which no fit needs

    size = round(block * rate)
    count = 2 * measured.size // size - 1
    if count < fewest:
        return None
    error = measured - predicted
    frequency, coherent = coherence(error, signal, fs=rate, nperseg=size)
    _, density = welch(error, fs=rate, nperseg=size)
    _, whole = welch(measured, fs=rate, nperseg=size)
    kept = (frequency > 0.0) & (frequency <= band)
    averages = count / (1.0 + 2.0 * overlap * (count - 1) / count)
    # For n averages, unrelated signals have a coherence of 1 / n.
    unbiased = np.clip((averages * coherent[kept] - 1.0) / (averages - 1.0), 0.0, 1.0)
    total = float(density[kept].sum())
    return ErrorSpectrum(
        frequency=frequency[kept],
        coherence=coherent[kept],
        error=density[kept],
        measured=whole[kept],
        threshold=1.0 - 0.05 ** (1.0 / (averages - 1.0)),
        share=float(unbiased @ density[kept]) / total if total > 0.0 else 0.0,
    )
