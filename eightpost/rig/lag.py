"""Time lag between two channels of a record."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate, correlation_lags

from eightpost.array_types import Array

#: Maximum lag of the search [s].
LONGEST = 0.25
#: Share of the highest correlation from which another peak counts as equally high: those of a periodic signal differ by
#: noise only.
EQUAL = 0.97
#: Share of the largest cross-spectrum below which a frequency is taken as noise.
NOISE = 1e-2


def lag_between(values: Array, reference: Array, rate: float) -> float:
    """Return the lag [s] of `values` (N,) behind `reference` (N,); negative if `values` lead.

    The maximum of the cross-correlation gives the lag to a sample. The phase of the cross-spectrum of the aligned
    samples, weighted with its size, gives the rest, so that a steady sine has no error of the record's ends. For a
    periodic signal the lag is determined only up to whole periods, and the smallest lag is returned: the peak closest
    to zero among those that are equally high.

    Args:
        values: Samples (N,) of the channel.
        reference: Samples (N,) of the reference channel.
        rate: Sample rate [Hz].
    """
    first, second = (np.asarray(row - row.mean()) for row in (values, reference))
    lags = correlation_lags(first.size, second.size)
    near = np.abs(lags) <= min(LONGEST * rate, first.size / 4)
    lags = lags[near]
    correlation = correlate(first, second, method="fft")[near] / _sizes(first, second, lags)
    coarse = int(lags[_nearest_peak(lags, correlation)])
    return (coarse + _remainder(*_aligned(first, second, coarse))) / rate


def _sizes(first: Array, second: Array, lags: NDArray[np.intp]) -> Array:
    """Return the product of the norms of the samples that both channels share at each lag (L,)."""
    energies = [np.concatenate(([0.0], np.cumsum(row**2))) for row in (first, second)]
    late, early = np.maximum(lags, 0), np.maximum(-lags, 0)
    own, other = (
        energy[first.size - before] - energy[after]
        for energy, before, after in ((energies[0], early, late), (energies[1], late, early))
    )
    return np.asarray(np.sqrt(np.maximum(own * other, 1e-300)))


def _nearest_peak(lags: NDArray[np.intp], correlation: Array) -> int:
    """Return the index of the peak closest to zero lag among those that are as high as the highest one."""
    inside = correlation[1:-1]
    tops = 1 + np.flatnonzero((inside >= correlation[:-2]) & (inside > correlation[2:]) & (inside > 0.0))
    if not tops.size:
        return int(np.argmax(correlation))
    heights = _peak_heights(correlation, tops)
    equal = tops[heights >= EQUAL * heights.max()]
    return int(equal[np.argmin(np.abs(lags[equal]))])


def _peak_heights(correlation: Array, tops: NDArray[np.intp]) -> Array:
    """Return the heights of peaks between samples: of the cosine through three samples, exact for a sine."""
    before, at, after = correlation[tops - 1], correlation[tops], correlation[tops + 1]
    sine = np.sqrt(np.maximum(1.0 - np.clip((before + after) / (2.0 * at), -1.0, 1.0) ** 2, 1e-12))
    return np.asarray(np.hypot(at, (after - before) / (2.0 * sine)))


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
    used = np.abs(cross) > NOISE * np.abs(cross).max()
    total = float(np.sum(weight[used] * frequency[used]))
    return float(-np.sum(weight[used] * np.angle(cross[used]) / total)) if total > 0.0 else 0.0


def correlation_at(values: Array, reference: Array, lag: int) -> float:
    """Return the correlation of `values` (N,) with `reference` (N,) delayed by `lag` samples."""
    return float(np.corrcoef(*_aligned(values, reference, lag))[0, 1])
