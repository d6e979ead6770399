"""Band-pass for response measures: "the signal may be bandpass filtered to the frequency range of interest" (2.1.4)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from eightpost.errors import InputError
from eightpost.signals import TimeSeries

Array = NDArray[np.float64]

#: Order of the Butterworth filter. It runs forward and backward: no phase shift, half the amplitude at each edge.
_ORDER = 4


@dataclass(frozen=True, slots=True, eq=False)
class _Sections:
    """A filter and its steady state for a unit step; both are cached because computing them is slow.

    Args:
        rows: Second-order sections (S, 6).
        rest: State of the filter in which a unit step gives its final value (S, 2).
    """

    rows: Array
    rest: Array

    def forward_and_backward(self, values: Array, pad: int) -> Array:
        """Return values (N,) filtered like scipy's sosfiltfilt, with `pad` samples of odd reflection at each end."""
        before = 2.0 * values[0] - values[pad:0:-1]
        after = 2.0 * values[-1] - values[-2 : -(pad + 2) : -1]
        forward = self._once(np.concatenate((before, values, after)))
        return self._once(forward[::-1])[::-1][pad:-pad]

    def _once(self, values: Array) -> Array:
        filtered, _ = scipy.signal.sosfilt(self.rows, values, zi=self.rest * values[0])
        return np.asarray(filtered, dtype=np.float64)


def band_pass(values: Array, rate: float, band: tuple[float, float], what: str) -> Array:
    """Return values filtered to a band without phase shift; the mean remains if the band begins at 0.

    Args:
        values: Samples (N,).
        rate: Samples per second [Hz].
        band: Lower and upper edge [Hz]; 0 and infinity leave a side open.
        what: Name of the measure, for messages.

    Raises:
        InputError: The band exceeds half the sample rate, or the record is too short for the filter.
    """
    low, high = band
    if low >= 0.5 * rate or (np.isfinite(high) and high >= 0.5 * rate):
        raise InputError(
            f"measure {what!r}: the band {low:g} to {high:g} Hz exceeds half the sample rate of {rate:g} Hz; use a "
            "smaller record_step, or inf as the upper edge"
        )
    sections = _sections(low, high, rate)
    if sections is None:
        return values
    pad = 3 * (2 * len(sections.rows) + 1)
    if values.shape[-1] <= pad:
        raise InputError(
            f"measure {what!r}: {values.shape[-1]} samples are too few for the band-pass filter; it needs {pad + 1}"
        )
    return sections.forward_and_backward(values, pad)


@lru_cache(maxsize=64)
def _sections(low: float, high: float, rate: float) -> _Sections | None:
    """Return the filter, or None if both sides are open."""
    if low > 0.0 and np.isfinite(high):
        rows = scipy.signal.butter(_ORDER, (low, high), btype="bandpass", fs=rate, output="sos")
    elif low > 0.0:
        rows = scipy.signal.butter(_ORDER, low, btype="highpass", fs=rate, output="sos")
    elif np.isfinite(high):
        rows = scipy.signal.butter(_ORDER, high, btype="lowpass", fs=rate, output="sos")
    else:
        return None
    return _Sections(np.asarray(rows), np.asarray(scipy.signal.sosfilt_zi(rows)))


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """A run with cached band-passed channels and windows, so that several measures share them.

    Args:
        series: The run.
    """

    series: TimeSeries
    _kept: dict[tuple[str, tuple[float, float]], Array] = field(init=False, repr=False, default_factory=dict)
    _windows: dict[tuple[float, float], slice] = field(init=False, repr=False, default_factory=dict)

    def samples(self, first: float, last: float) -> slice:
        """Return the slice of the samples from one time to another [s], including both."""
        if (first, last) not in self._windows:
            begin, end = np.searchsorted(self.series.time, (first - 1e-9, last + 1e-9)).tolist()
            self._windows[first, last] = slice(begin, end)
        return self._windows[first, last]

    def channel(self, name: str, band: tuple[float, float] | None, what: str) -> Array:
        """Return a channel (N,) in SI, unfiltered or filtered to a band [Hz]; `what` is the measure, for messages.

        Raises:
            MissingChannelError: There is no such channel.
            InputError: The band does not fit the sample rate.
        """
        if band is None:
            return self.series[name]
        if (name, band) not in self._kept:
            self._kept[name, band] = band_pass(self.series[name], self.series.sample_rate, band, what)
        return self._kept[name, band]
