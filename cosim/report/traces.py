"""Decimation of time traces for a page, without loss of peaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eightpost.signals import TimeSeries

Array = NDArray[np.float64]

#: Maximum number of values over all channels of a page: 40 channels of 60 s at 2 ms fit, in about 3 MB.
CAPACITY = 1_250_000


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """Traces that the page draws.

    Args:
        time: Times (M,) [s].
        values: Values (C, M) in SI.
        samples: Number of recorded samples per pair of values; 1 if all are kept.
        interval: Time span of these samples [s].
    """

    time: Array
    values: Array
    samples: int
    interval: float


def traces(series: TimeSeries, *, capacity: int = CAPACITY) -> Traces:
    """Keep all samples if they fit, else the minimum and the maximum of every few, in their order.

    With n samples per pair, the times of each pair are those of the first and the middle of the n samples, so the time
    of a value is wrong by less than n samples.

    Args:
        series: Recorded series with C channels.
        capacity: Maximum number of values to keep, over all channels; at least two per channel are kept.
    """
    length, channels = len(series), max(1, len(series.names))
    pairs = max(1, capacity // (2 * channels))
    if length <= 2 * pairs:
        return Traces(series.time, series.values, samples=1, interval=series.duration / max(1, length - 1))
    samples = -(-length // pairs)
    starts = np.arange(0, length, samples)
    middles = np.minimum(starts + samples // 2, length - 1)
    time = series.time[np.column_stack([starts, middles]).ravel()]
    return Traces(time, _pairs(series.values, samples), samples, interval=samples * series.duration / (length - 1))


def _pairs(values: Array, samples: int) -> Array:
    """Return (C, 2 K): minimum and maximum of every `samples` values, in the order in which they occurred."""
    channels, length = values.shape
    missing = -length % samples
    bins = np.pad(values, ((0, 0), (0, missing)), mode="edge").reshape(channels, -1, samples)
    ends = np.sort(np.stack([bins.argmin(axis=2), bins.argmax(axis=2)], axis=2), axis=2)
    pairs: Array = np.take_along_axis(bins, ends, axis=2).reshape(channels, -1)
    return pairs
