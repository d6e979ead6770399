"""Cycles of a run: peaks of velocity with their forces, force at zero velocity, hysteresis and energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from eightpost.array_types import Array
from eightpost.ident.dyno_report.found import Found, Unknown
from eightpost.signals import TimeSeries

#: A half cycle reaches this share of the highest speed; smaller motions belong to the crossing of zero.
REACHED = 0.05
#: A peak is the mean of the samples above this share of a half cycle's highest speed.
PEAK = 0.99
#: Cycles are alike if their strokes are within this share of the median; minimum share of cycles that are alike.
ALIKE, STEADY = 0.1, 0.8
#: Minimum number of cycles for a mean.
FEWEST_CYCLES = 2

NO_CYCLE = Unknown("the record has fewer than two whole cycles")
UNLIKE = Unknown("the cycles have different strokes; split the record into runs (--split)")


@dataclass(frozen=True, slots=True)
class Crossing:
    """A change of direction.

    Attributes:
        time: Time at which the velocity is zero [s].
        force: Force at that time [N].
        start: Last sample before it beyond the threshold of velocity.
        stop: First sample after it beyond the threshold.
        upward: Whether compression follows.
    """

    time: float
    force: float
    start: int
    stop: int
    upward: bool


@dataclass(frozen=True, slots=True, eq=False)
class Cycles:
    """Cycles of a run.

    Attributes:
        peak_velocity: Velocity at the peak of each half cycle (H,) [m/s], positive in compression.
        peak_force: Force there (H,) [N].
        count: Number of whole cycles.
        is_steady: Whether the cycles have the same stroke.
        frequency: Mean frequency [Hz].
        stroke: Mean stroke from one end to the other [m].
        offset: Mean of the forces at zero velocity at both ends of the stroke [N].
        width: Force at zero velocity at the compressed end minus that at the extended end [N].
        energy: Energy dissipated per cycle [J].
        energy_scatter: Standard deviation of the energy between cycles [J].
    """

    peak_velocity: Array
    peak_force: Array
    count: int
    is_steady: bool
    frequency: Found
    stroke: Found
    offset: Found
    width: Found
    energy: Found
    energy_scatter: Found

    def peaks(self, sign: float) -> tuple[Array, Array]:
        """Return peak speeds (J,) [m/s] and force magnitudes (J,) [N], gas included, of one direction."""
        chosen = sign * self.peak_velocity > 0.0
        return sign * self.peak_velocity[chosen], sign * self.peak_force[chosen]


def cycles_of(series: TimeSeries) -> Cycles:
    """Return the cycles of a record with `velocity` [m/s] and `force` [N]."""
    crossings = crossings_of(series)
    peaks = np.array(
        [_peak(series, a.stop, b.start) for a, b in zip(crossings, crossings[1:], strict=False)]
    ).reshape(-1, 2)  # fmt: skip
    offset, width = _at_zero(crossings)
    starts = np.array([crossing.time for crossing in crossings if crossing.upward])
    if starts.size < FEWEST_CYCLES + 1:
        return Cycles(peaks[:, 0], peaks[:, 1], max(starts.size - 1, 0), False, NO_CYCLE, NO_CYCLE, offset, width,
                      NO_CYCLE, NO_CYCLE)  # fmt: skip
    stroke = _strokes(series, crossings)
    alike = np.abs(stroke / np.median(stroke) - 1.0) <= ALIKE
    steady = bool(np.mean(alike) >= STEADY)
    energy = np.diff(np.interp(starts, series.time, energy_over_time(series)))
    return Cycles(
        peaks[:, 0], peaks[:, 1], starts.size - 1, steady,
        float((starts.size - 1) / (starts[-1] - starts[0])),
        float(stroke[alike].mean()) if steady else UNLIKE,
        offset,
        width if steady else UNLIKE,
        float(energy.mean()) if steady else UNLIKE,
        float(energy.std(ddof=1)) if steady else UNLIKE,
    )  # fmt: skip


def energy_over_time(series: TimeSeries) -> Array:
    """Return the integral of force times velocity (N,) [J] from the first sample."""
    return np.asarray(cumulative_trapezoid(series["force"] * series["velocity"], series.time, initial=0))


def crossings_of(series: TimeSeries) -> list[Crossing]:
    """Return the changes of direction between half cycles that reach 5 % of the highest speed."""
    velocity = series["velocity"]
    beyond = np.flatnonzero(np.abs(velocity) >= REACHED * float(np.abs(velocity).max()))
    signs = np.sign(velocity[beyond])
    changes = np.flatnonzero(np.diff(signs) != 0.0)
    return [_crossing(series, int(beyond[k]), int(beyond[k + 1])) for k in changes]


def _crossing(series: TimeSeries, start: int, stop: int) -> Crossing:
    """Return the crossing of zero between two samples: lines of time and force over velocity through all between."""
    part = slice(start, stop + 1)
    velocity = series["velocity"][part]
    middle = velocity - velocity.mean()
    zero = -float(velocity.mean())
    at_zero = [
        float(row.mean() + zero * (middle @ (row - row.mean())) / (middle @ middle))
        for row in (series.time[part], series["force"][part])
    ]
    return Crossing(at_zero[0], at_zero[1], start, stop, bool(velocity[-1] > 0.0))


def _peak(series: TimeSeries, start: int, stop: int) -> tuple[float, float]:
    part = slice(start, stop + 1)
    velocity, force = series["velocity"][part], series["force"][part]
    top = np.abs(velocity) >= PEAK * float(np.abs(velocity).max())
    return float(velocity[top].mean()), float(force[top].mean())


def _at_zero(crossings: list[Crossing]) -> tuple[Found, Found]:
    """Return the offset and the width of the loop at zero velocity [N]."""
    extended = [crossing.force for crossing in crossings if crossing.upward]
    compressed = [crossing.force for crossing in crossings if not crossing.upward]
    if not (extended and compressed):
        none = Unknown("the velocity does not change its sign in both directions")
        return none, none
    low, high = float(np.mean(extended)), float(np.mean(compressed))
    return 0.5 * (low + high), high - low


def _strokes(series: TimeSeries, crossings: list[Crossing]) -> Array:
    """Return the stroke of each half cycle (H,) [m] from the integral of velocity."""
    path = cumulative_trapezoid(series["velocity"], series.time, initial=0)
    ends = np.interp([crossing.time for crossing in crossings], series.time, path)
    return np.asarray(np.abs(np.diff(ends)))
