"""Time lag between two channels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import correlate, correlation_lags

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Maximum lag of the search [s].
LONGEST = 0.25


def lag_between(values: Array, reference: Array, rate: float, *, longest: float = LONGEST) -> float:
    """Return the lag [s] of `values` (N,) behind `reference` (N,); negative if `values` lead.

    The lag is the maximum of the cross-correlation, refined by a parabola through its neighbours. For a steady sine it
    is determined only up to whole periods, and the smallest lag is returned.

    Args:
        values: Samples (N,) of the channel.
        reference: Samples (N,) of the reference channel.
        rate: Sample rate [Hz].
        longest: Maximum lag of the search [s].
    """
    first, second = (row - row.mean() for row in (values, reference))
    lags = correlation_lags(first.size, second.size)
    correlation = correlate(first, second, method="fft") / (first.size - np.abs(lags))
    near = np.abs(lags) <= min(longest * rate, first.size / 4)
    lags, correlation = lags[near], correlation[near]
    peaks = np.flatnonzero(correlation >= correlation.max() * (1.0 - 1e-3))
    best = int(peaks[np.argmin(np.abs(lags[peaks]))]) if _separate(peaks) else int(np.argmax(correlation))
    return float(lags[best] + _vertex(correlation, best)) / rate


def _separate(peaks: NDArray[np.intp]) -> bool:
    """Return whether samples near a maximum belong to more than one peak."""
    return bool((np.diff(peaks) > 1).any())


def _vertex(values: Array, peak: int) -> float:
    """Return the vertex of the parabola through a maximum and its neighbours, in samples from the maximum."""
    if not 0 < peak < values.size - 1:
        return 0.0
    before, here, after = values[peak - 1 : peak + 2]
    bend = before - 2.0 * here + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0
