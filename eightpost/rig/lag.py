"""Time lag between two channels of a record."""

from __future__ import annotations

import numpy as np
from scipy.signal import correlate, correlation_lags

from eightpost.array_types import Array

#: Maximum lag of the search [s].
LONGEST = 0.25


def lag_between(values: Array, reference: Array, rate: float) -> float:
    """Return the lag [s] of `values` (N,) behind `reference` (N,); negative if `values` lead.

    The maximum of the cross-correlation gives the lag to a sample. The phase of the cross-spectrum of the aligned
    samples, weighted with its size, gives the rest, so that a steady sine has no error of the record's ends. For a
    steady sine the lag is determined only up to whole periods, and the smallest lag is returned.

    Args:
        values: Samples (N,) of the channel.
        reference: Samples (N,) of the reference channel.
        rate: Sample rate [Hz].
    """
    first, second = (np.asarray(row - row.mean()) for row in (values, reference))
    lags = correlation_lags(first.size, second.size)
    # The sum over fewer samples at longer lags favours the smallest lag among those of a periodic signal.
    correlation = correlate(first, second, method="fft")
    near = np.abs(lags) <= min(LONGEST * rate, first.size / 4)
    coarse = int(lags[near][np.argmax(correlation[near])])
    return (coarse + _remainder(*_aligned(first, second, coarse))) / rate


def _aligned(first: Array, second: Array, lag: int) -> tuple[Array, Array]:
    """Return the samples that both channels share if `first` is moved forward by `lag` samples."""
    count = first.size - abs(lag)
    return (first[lag:], second[:count]) if lag >= 0 else (first[:count], second[-lag:])


def _remainder(first: Array, second: Array) -> float:
    """Return the lag [samples] of nearly aligned samples from the phase of their cross-spectrum."""
    window = np.hanning(first.size)
    cross = np.fft.rfft(window * (first - first.mean())) * np.conj(np.fft.rfft(window * (second - second.mean())))
    frequency = 2.0 * np.pi * np.arange(cross.size) / first.size  # [rad/sample]
    weight = np.abs(cross) * frequency
    used = np.abs(cross) > 1e-3 * np.abs(cross).max()
    total = float(np.sum(weight[used] * frequency[used]))
    return float(-np.sum(weight[used] * np.angle(cross[used]) / total)) if total > 0.0 else 0.0


def correlation_at(values: Array, reference: Array, lag: int) -> float:
    """Return the correlation of `values` (N,) with `reference` (N,) delayed by `lag` samples."""
    return float(np.corrcoef(*_aligned(values, reference, lag))[0, 1])
