"""Motion of a shock: its path, the turning points of half cycles, and where a steady sine ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from eightpost.array_types import Array
from eightpost.signals.filters import lowpass
from eightpost.signals.timeseries import TimeSeries

#: Half cycles are alike if stroke and duration are within this share of their medians.
ALIKE = 0.1
#: Minimum share of half cycles that are alike in a steady sine.
STEADY = 0.6
#: Minimum number of half cycles of a steady sine.
FEWEST = 6
#: Minimum number of half cycles of another steady sine that follows.
FEWEST_OTHER = 3
#: Minimum stroke of a half cycle, as a share of the stroke of the record; smaller motions are noise.
SMALLEST = 0.02
#: The motion runs down if its RMS velocity after the last steady half cycle is below this share of that before.
SLOWED = 0.7


def displacement_of(series: TimeSeries) -> Array:
    """Return the displacement (N,) [m]; if it was not measured, the integral of the velocity minus its mean."""
    if "displacement" in series:
        return series["displacement"]
    velocity = series["velocity"]
    return np.asarray(cumulative_trapezoid(velocity - velocity.mean(), series.time, initial=0))


def path_of(series: TimeSeries) -> Array:
    """Return the displacement (N,) [m], low-passed at a tenth of the sample rate or 50 Hz."""
    rate = series.sample_rate
    return lowpass(displacement_of(series), rate, min(50.0, 0.1 * rate), order=2)


def turning_points(path: Array, *, threshold: float) -> list[int]:
    """Return the samples of alternating maxima and minima of a path (N,) that are more than `threshold` apart."""
    extrema = np.flatnonzero(np.diff(np.sign(np.diff(path))) != 0.0) + 1
    turns: list[int] = []
    for i in map(int, extrema):
        if not turns:
            turns.append(i)
        elif len(turns) > 1 and (path[i] - path[turns[-1]]) * (path[turns[-1]] - path[turns[-2]]) >= 0.0:
            turns[-1] = i
        elif abs(path[i] - path[turns[-1]]) > threshold:
            turns.append(i)
    return turns


def run_down(time: Array, path: Array, velocity: Array) -> float | None:
    """Return the time [s] from which a steady sine runs down until the end of a record; None if it does not.

    Args:
        time: Times (N,) [s].
        path: Displacement (N,) [m], without noise that has a stroke of 2 %.
        velocity: Velocity (N,) [m/s].
    """
    turns = np.array(turning_points(path, threshold=SMALLEST * float(np.ptp(path))), dtype=np.intp)
    if turns.size < FEWEST + 1:
        return None
    stroke, duration = np.abs(np.diff(path[turns])), np.diff(time[turns])
    alike = _is_usual(stroke) & _is_usual(duration)
    if np.count_nonzero(alike) < max(FEWEST, STEADY * alike.size):
        return None
    last = int(np.flatnonzero(alike)[-1]) + 1
    end = int(turns[last])
    rest = velocity[end:]
    if time[-1] - time[end] < 0.9 * float(np.median(duration)):
        return None
    if _is_steady(stroke[last:], duration[last:]):
        return None
    slowed = float(np.sqrt(np.mean(rest**2))) < SLOWED * float(np.sqrt(np.mean(velocity[:end] ** 2)))
    return float(time[end]) if slowed else None


def _is_steady(stroke: Array, duration: Array) -> bool:
    """Return whether half cycles (K,) are another steady sine, apart from the transition to it."""
    if stroke.size < FEWEST_OTHER:
        return False
    alike = _is_usual(stroke) & _is_usual(duration)
    return bool(np.count_nonzero(alike) >= max(FEWEST_OTHER, STEADY * alike.size))


def _is_usual(values: Array) -> NDArray[np.bool_]:
    """Return whether each value (K,) is within a share of the median."""
    return np.asarray(np.abs(values / np.median(values) - 1.0) <= ALIKE)
