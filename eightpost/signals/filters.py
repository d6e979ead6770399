"""Filters of section 3.3 of the dissertation: zero-phase low-pass and central differences."""

from __future__ import annotations

import numpy as np
import scipy

from eightpost.array_types import Array


def lowpass(values: Array, rate: float, cutoff_hz: float, *, order: int = 8) -> Array:
    """Apply a low-pass Butterworth filter forward and backward, with zero phase and twice the attenuation.

    The gain is 1 / (1 + (f / cutoff)^(2 order)), one half at the cut-off.

    Args:
        values: Samples (..., N) with time as the last axis.
        rate: Sample rate [Hz].
        cutoff_hz: Cut-off frequency [Hz], below half the sample rate.
        order: Order of the filter, which is applied twice; 8 in section 3.3 of the dissertation.

    Returns:
        Filtered samples (..., N).

    Raises:
        ValueError: The cut-off is not between 0 and half the rate.
    """
    if not 0.0 < cutoff_hz < 0.5 * rate:
        limit = f"{0.5 * rate:g} Hz (half the sample rate)"
        raise ValueError(f"the cut-off must be between 0 and {limit}, not {cutoff_hz:g} Hz")
    sections = scipy.signal.butter(order, cutoff_hz, fs=rate, output="sos")
    pad = min(values.shape[-1] - 1, int(np.ceil(3.0 * order * rate / cutoff_hz)))
    return np.asarray(scipy.signal.sosfiltfilt(sections, values, axis=-1, padlen=pad), dtype=np.float64)


def derivative(values: Array, rate: float) -> Array:
    """Differentiate with central differences, one-sided at the ends, like MATLAB's gradient (6.1.2).

    Args:
        values: Samples (..., N) with time as the last axis.
        rate: Sample rate [Hz].

    Returns:
        Derivative (..., N), in units of the samples per second.
    """
    return np.asarray(np.gradient(values, 1.0 / rate, axis=-1), dtype=np.float64)


def velocity_from_displacement(displacement: Array, rate: float, cutoff_hz: float) -> Array:
    """Return the velocity (..., N) [m/s] of a displacement by a low-pass and central differences (6.1.2).

    Args:
        displacement: Displacement (..., N) [m] with time as the last axis.
        rate: Sample rate [Hz].
        cutoff_hz: Cut-off frequency of the low-pass [Hz], below half the sample rate.

    Raises:
        ValueError: The cut-off is not between 0 and half the rate.
    """
    return derivative(lowpass(displacement, rate, cutoff_hz), rate)


def white_noise(values: Array) -> float:
    """Return the standard deviation of the white noise in `values` (N,), from their third differences; 0 if N < 4."""
    changes = np.abs(np.diff(values, 3))
    return float(np.median(changes) / (0.6745 * np.sqrt(20.0))) if changes.size else 0.0
