"""Analysis of a record's motion: where it stands still, where it moves, and the frequency of a sine."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import label, uniform_filter1d
from scipy.optimize import minimize_scalar

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]
    Mask = NDArray[np.bool_]

#: A record stands still where its displacement changes by less than this share of its stroke within a window.
_STANDS = 0.01

#: Length of the window as a share of the record, and its minimum [s].
_WINDOW, _SHORTEST_WINDOW = 1.0 / 200.0, 0.05


def displacement_of(series: TimeSeries) -> Array:
    """Return the displacement (N,) [m]; if it was not measured, the integral of the velocity minus its mean."""
    if "displacement" in series:
        return series["displacement"]
    velocity = series["velocity"]
    return np.asarray(cumulative_trapezoid(velocity - velocity.mean(), series.time, initial=0))


def standing(series: TimeSeries) -> Mask:
    """Return where a record stands still (N,): within 1/200 of its length it moves less than 1 % of its stroke.

    Args:
        series: `displacement` [m], or `velocity` [m/s] to integrate.
    """
    half = _half_window(series)
    # Means over a quarter of the window keep the sensor's noise from being taken for motion.
    smooth = uniform_filter1d(displacement_of(series), max(1, half // 2), mode="nearest")
    padded = np.pad(smooth, half, mode="edge")
    return np.asarray(np.abs(padded[2 * half :] - padded[: -2 * half]) < _STANDS * np.ptp(smooth))


def _half_window(series: TimeSeries) -> int:
    window = max(_WINDOW * series.duration, _SHORTEST_WINDOW)
    return max(1, round(0.5 * window * series.sample_rate))


def stretches(mask: Mask) -> list[tuple[int, int]]:
    """Return the first and last sample of every run of true values of a mask (N,)."""
    labels, count = label(mask)
    starts = np.flatnonzero(np.diff(labels, prepend=0) > 0) if count else np.empty(0, int)
    ends = np.flatnonzero(np.diff(labels, append=0) < 0) if count else np.empty(0, int)
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]


def moving_part(series: TimeSeries) -> TimeSeries:
    """Return a record without standstill at its beginning and end."""
    moves, half = np.flatnonzero(~standing(series)), _half_window(series)
    if moves.size < 3:
        return series
    first, last = int(moves[0]), int(moves[-1])
    # Anything within half a window of a motion counts as moving.
    first, last = first + half * (first > half), last - half * (last < len(series) - 1 - half)
    return series if last - first < half else series.window(float(series.time[first]), float(series.time[last]))


def refined_frequency(values: Array, time: Array, near: float) -> float:
    """Return the frequency [Hz] of the sine that fits values (N,) best, within 15 % of a first estimate [Hz]."""

    def misfit(frequency: float) -> float:
        phase = 2.0 * np.pi * frequency * (time - time[0])
        columns = np.stack([np.cos(phase), np.sin(phase), np.ones_like(phase)], axis=1)
        return float(np.linalg.lstsq(columns, values, rcond=None)[1].sum())

    # The misfit has local minima one period over the whole record apart, so a grid is searched first.
    grid = np.linspace(0.85 * near, 1.15 * near, 61)
    best = int(np.argmin([misfit(frequency) for frequency in grid]))
    step = float(grid[1] - grid[0])
    found = minimize_scalar(misfit, bounds=(float(grid[best]) - step, float(grid[best]) + step), method="bounded")
    return float(found.x)
