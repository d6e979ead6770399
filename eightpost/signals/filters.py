"""Filters of section 3.3 of the dissertation: zero-phase low-pass and central differences.

They agree with those of scipy.signal to rounding, which takes half a second to load because it loads scipy.stats.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eightpost.array_types import Array


def lowpass(values: Array, rate: float, cutoff_hz: float, *, order: int = 8) -> Array:
    """Apply a low-pass Butterworth filter forward and backward, with zero phase and twice the attenuation.

    The gain is 1 / (1 + (f / cutoff)^(2 order)), one half at the cut-off.

    Args:
        values: Samples (..., N) with time as the last axis.
        rate: Sample rate [Hz].
        cutoff_hz: Cut-off frequency [Hz], below half the sample rate.
        order: Order of the filter, an even number, which is applied twice; 8 in section 3.3 of the dissertation.

    Returns:
        Filtered samples (..., N).

    Raises:
        ValueError: The cut-off is not between 0 and half the rate.
    """
    if not 0.0 < cutoff_hz < 0.5 * rate:
        limit = f"{0.5 * rate:g} Hz (half the sample rate)"
        raise ValueError(f"the cut-off must be between 0 and {limit}, not {cutoff_hz:g} Hz")
    count = values.shape[-1]
    pad = min(count - 1, int(np.ceil(3.0 * order * rate / cutoff_hz)))
    left, right = values[..., pad:0:-1], values[..., -2 : -2 - pad : -1]
    extended = np.concatenate([2.0 * values[..., :1] - left, values, 2.0 * values[..., -1:] - right], axis=-1)
    sections = _sections(order, np.tan(np.pi * cutoff_hz / rate))
    backward = _filtered(_filtered(extended, sections)[..., ::-1], sections)
    return backward[..., ::-1][..., pad : pad + count]


def _sections(order: int, corner: float) -> list[tuple[float, float, float]]:
    """Return gain and two feedback coefficients of each second-order section of a Butterworth low-pass."""
    damping = np.sin(np.pi * (np.arange(order // 2) + 0.5) / order)
    found = []
    for each in (2.0 * damping * corner).tolist():
        size = 1.0 + each + corner**2
        found.append((corner**2 / size, 2.0 * (corner**2 - 1.0) / size, (1.0 - each + corner**2) / size))
    return found


def _filtered(values: Array, sections: Sequence[tuple[float, float, float]]) -> Array:
    """Return values (..., N) behind sections with a double zero at half the rate; they start in equilibrium."""
    start = values[..., :1]
    found = values - start
    for gain, *feedback in sections:
        driven = found.copy()
        driven[..., 1:] += 2.0 * found[..., :-1]
        driven[..., 2:] += found[..., :-2]
        driven *= gain
        found = recursion(driven, feedback)
    found += start
    return found


def recursion(values: Array, feedback: Sequence[float]) -> Array:
    """Return y (..., N) of y[n] + a_1 y[n-1] + a_2 y[n-2] + ... = values[n], zero before the first sample.

    Args:
        values: Right side (..., N) with time as the last axis.
        feedback: Coefficients a_1, a_2, ...
    """
    from scipy.linalg.lapack import dtbtrs  # noqa: PLC0415 -- slow to import, and a coupled run filters nothing

    count = values.shape[-1]
    band = np.empty((1 + len(feedback), count), order="F")  # as LAPACK reads it, without a copy
    band[:] = [[1.0], *([a] for a in feedback)]
    found, _ = dtbtrs(band, values.reshape(-1, count).T, uplo="L", diag="U")
    return np.asarray(found.T.reshape(values.shape), dtype=np.float64)


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
