"""Filters of the dissertation's section 3.3: zero-phase low-pass and central differences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def lowpass(values: Array, rate: float, cutoff_hz: float, *, order: int = 8) -> Array:
    """Low-pass with a Butterworth filter run forward and backward: no phase, twice the attenuation.

    The gain is 1 / (1 + (f / cutoff)^(2 order)), one half at the cut-off.

    Args:
        values: (..., N), time last.
        rate: Samples per second [Hz].
        cutoff_hz: Cut-off [Hz], below half the rate.
        order: Order of the filter that is run twice; 8 in the dissertation's section 3.3.

    Returns:
        (..., N).

    Raises:
        ValueError: The cut-off is not between 0 and half the rate.
    """
    if not 0.0 < cutoff_hz < 0.5 * rate:
        raise ValueError(f"the cut-off must lie between 0 and {0.5 * rate:g} Hz (half the rate), not at {cutoff_hz:g}")
    sections = scipy.signal.butter(order, cutoff_hz, fs=rate, output="sos")
    pad = min(values.shape[-1] - 1, int(np.ceil(3.0 * order * rate / cutoff_hz)))
    return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=-1, padlen=pad), dtype=np.float64)


def derivative(values: Array, rate: float) -> Array:
    """Differentiate by central differences, one-sided at the ends, as MATLAB's gradient does (6.1.2).

    Args:
        values: (..., N), time last.
        rate: Samples per second [Hz].

    Returns:
        (..., N) per second.
    """
    return np.asarray(np.gradient(values, 1.0 / rate, axis=-1), dtype=np.float64)


def velocity_from_displacement(displacement: Array, rate: float, cutoff_hz: float) -> Array:
    """Return the velocity [m/s] of a displacement [m]: low-pass, then central differences (6.1.2)."""
    return derivative(lowpass(displacement, rate, cutoff_hz), rate)
