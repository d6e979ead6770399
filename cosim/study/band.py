"""Band-pass for response measures: "the signal may be bandpass filtered to the frequency range of interest" (2.1.4)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from eightpost.errors import InputError

Array = NDArray[np.float64]

#: Of the Butterworth filter, which is run forward and backward: no phase, half the amplitude at each edge.
_ORDER = 4


def band_pass(values: Array, rate: float, band: tuple[float, float], what: str) -> Array:
    """Return what lies within a band, without phase; the mean stays where the band begins at 0.

    Args:
        values: (..., N), time last.
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
    pad = 3 * (2 * len(sections) + 1)
    if values.shape[-1] <= pad:
        raise InputError(f"measure {what!r}: {values.shape[-1]} samples are too few for a band-pass filter")
    filtered: Array = np.asarray(sosfiltfilt(sections, values, axis=-1), dtype=np.float64)
    return filtered


@lru_cache(maxsize=64)
def _sections(low: float, high: float, rate: float) -> Array | None:
    """The filter's second-order sections; None where both sides are open."""
    if low > 0.0 and np.isfinite(high):
        return np.asarray(butter(_ORDER, (low, high), btype="bandpass", fs=rate, output="sos"))
    if low > 0.0:
        return np.asarray(butter(_ORDER, low, btype="highpass", fs=rate, output="sos"))
    if np.isfinite(high):
        return np.asarray(butter(_ORDER, high, btype="lowpass", fs=rate, output="sos"))
    return None
