"""Time traces small enough for a page, without loss of peaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eightpost.signals import TimeSeries

Array = NDArray[np.float64]

#: Values that a page holds over all channels: 40 channels of 60 s at 2 ms fit, in about 3 MB.
CAPACITY = 1_250_000


@dataclass(frozen=True, slots=True, eq=False)
class Traces:
    """What the page draws.

    Args:
        time: (M,) [s].
        values: (C, M) in SI.
        samples: Recorded samples that each pair of values stands for; 1 where all are kept.
        interval: Time that those samples take [s].
    """

    time: Array
    values: Array
    samples: int
    interval: float


def traces(series: TimeSeries, *, capacity: int = CAPACITY) -> Traces:
    """Keep all samples where they fit, else the least and the greatest of every few, in their order.

    With n samples to a pair, each pair stands at the first and the middle one of the n: no value is farther than n
    samples from its time.

    Args:
        series: What was recorded, C channels.
        capacity: Most values to keep, over all channels; at least two per channel are kept.
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
    """Return (C, 2 K): least and greatest of every `samples` values, the one that came first first."""
    channels, length = values.shape
    missing = -length % samples
    bins = np.pad(values, ((0, 0), (0, missing)), mode="edge").reshape(channels, -1, samples)
    ends = np.sort(np.stack([bins.argmin(axis=2), bins.argmax(axis=2)], axis=2), axis=2)
    pairs: Array = np.take_along_axis(bins, ends, axis=2).reshape(channels, -1)
    return pairs
