"""Power spectral densities of a run after settling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from eightpost.signals import TimeSeries

Array = NDArray[np.float64]

#: Length of a block [s]: a resolution of 0.25 Hz, and 14 blocks, half overlapping, in 30 s.
BLOCK = 4.0

#: Maximum number of values over all channels of a page; blocks are shortened to stay below it.
CAPACITY = 1_000_000

#: Minimum number of samples for a spectrum.
_FEWEST = 16


@dataclass(frozen=True, slots=True, eq=False)
class Spectra:
    """One-sided power spectral densities.

    Args:
        frequency: Frequencies (K,) above zero [Hz].
        density: Densities (C, K) in the SI unit squared per Hz; the integral over frequency is the variance.
        block: Length of a block [s].
        duration: Length of the series [s].
    """

    frequency: Array
    density: Array
    block: float
    duration: float


def spectra(series: TimeSeries) -> Spectra | None:
    """Estimate densities by Welch's method: Hann blocks of 4 s, half overlapping, each without its mean.

    Blocks are shorter in a shorter series, and if there are so many channels that a page could not hold their
    densities. A series with uneven steps is interpolated to its median rate first.

    Returns:
        Densities; None if there are too few samples or no channels.
    """
    if len(series) < _FEWEST or not series.names:
        return None
    even = series if series.is_uniform else series.resample(series.sample_rate)
    rate = even.sample_rate
    length = min(len(even), round(BLOCK * rate), max(_FEWEST, 2 * CAPACITY // len(even.names)))
    if length < _FEWEST:
        return None
    frequency, density = scipy.signal.welch(
        even.values, fs=rate, window="hann", nperseg=length, detrend="constant", axis=-1
    )
    return Spectra(frequency[1:], density[:, 1:], block=length / rate, duration=even.duration)
