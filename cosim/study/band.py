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

#: Of the Butterworth filter, which is run forward and backward: no phase, half the amplitude at each edge.
_ORDER = 4


@dataclass(frozen=True, slots=True, eq=False)
class _Sections:
    """A filter and the state in which it answers a unit step with its final value: it is long to find anew.

    Args:
        rows: Second-order sections (S, 6).
        rest: State (S, 2).
    """

    rows: Array
    rest: Array

    def forward_and_backward(self, values: Array, pad: int) -> Array:
        """Return what scipy's sosfiltfilt does, values (N,) continued by `pad` samples turned about their ends."""
        before = 2.0 * values[0] - values[pad:0:-1]
        after = 2.0 * values[-1] - values[-2 : -(pad + 2) : -1]
        forward = self._once(np.concatenate((before, values, after)))
        return self._once(forward[::-1])[::-1][pad:-pad]

    def _once(self, values: Array) -> Array:
        filtered, _ = scipy.signal.sosfilt(self.rows, values, zi=self.rest * values[0])
        return np.asarray(filtered, dtype=np.float64)


def band_pass(values: Array, rate: float, band: tuple[float, float], what: str) -> Array:
    """Return what lies within a band, without phase; the mean stays where the band begins at 0.

    Args:
        values: (N,).
        rate: Samples per second [Hz].
        band: Lower and upper edge [Hz]; 0 and infinity leave a side open.
        what: The measure, for the message.

    Raises:
        InputError: The band lies beyond half the sample rate, or the record is too short for its filter.
    """
    low, high = band
    if low >= 0.5 * rate or (np.isfinite(high) and high >= 0.5 * rate):
        raise InputError(
            f"measure {what!r}: the band {low:g} to {high:g} Hz needs more than {rate:g} samples a second: take a "
            "smaller record_step, or inf as its upper edge"
        )
    sections = _sections(low, high, rate)
    if sections is None:
        return values
    pad = 3 * (2 * len(sections.rows) + 1)
    if values.shape[-1] <= pad:
        raise InputError(f"measure {what!r}: {values.shape[-1]} samples are too few for a band-pass filter")
    return sections.forward_and_backward(values, pad)


@lru_cache(maxsize=64)
def _sections(low: float, high: float, rate: float) -> _Sections | None:
    """The filter; None where both sides are open."""
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
    """A run and what bands and windows leave of it: found once, whatever number of measures asks.

    Args:
        series: The run.
    """

    series: TimeSeries
    _kept: dict[tuple[str, tuple[float, float]], Array] = field(init=False, repr=False, default_factory=dict)
    _windows: dict[tuple[float, float], slice] = field(init=False, repr=False, default_factory=dict)

    def samples(self, first: float, last: float) -> slice:
        """Return the samples from one time to another [s], both among them."""
        if (first, last) not in self._windows:
            begin, end = np.searchsorted(self.series.time, (first - 1e-9, last + 1e-9)).tolist()
            self._windows[first, last] = slice(begin, end)
        return self._windows[first, last]

    def channel(self, name: str, band: tuple[float, float] | None, what: str) -> Array:
        """Return a channel (N,) in SI, as it is or within a band [Hz]; `what` is the measure, for the message.

        Raises:
            MissingChannelError: There is no such channel.
            InputError: The band does not fit the sample rate.
        """
        if band is None:
            return self.series[name]
        if (name, band) not in self._kept:
            self._kept[name, band] = band_pass(self.series[name], self.series.sample_rate, band, what)
        return self._kept[name, band]
