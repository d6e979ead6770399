"""Figures of a record without its loop: cycles with their peaks and energy, gas and friction of slow parts."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.rig.motion import SMALLEST, grouped, path_of, turning_points
from eightpost.signals import TimeSeries
from eightpost.signals.filters import derivative, lowpass

# ---- A figure, or the reason why it is unknown ----------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Unknown:
    """A figure that a record does not support."""

    reason: str  #: Reason why it is unknown, a clause without a full stop.


Found = float | Unknown  #: A value in SI, or the reason why it is unknown.


Result = TypeVar("Result")


def of_known(function: Callable[..., Result], *values: Found) -> Result | Unknown:
    """Return a function of values; the first reason if a value is unknown."""
    return next((value for value in values if isinstance(value, Unknown)), None) or function(*values)


def known(values: Iterable[Found]) -> list[float]:
    """Return the values that are known."""
    return [value for value in values if not isinstance(value, Unknown)]


def mean_of(values: Iterable[Found]) -> Found:
    """Return the mean of the known values; the first reason if no value is known."""
    values = list(values)
    found = known(values)
    if found:
        return sum(found) / len(found)
    return next((value for value in values if isinstance(value, Unknown)), Unknown("there is no run"))


# ---- Cycles: peaks of velocity with their forces, force at zero velocity, hysteresis and energy ---------------------

REACHED = 0.03  #: Force and time at zero velocity are interpolated between samples at this share of the highest speed.
PEAK = 0.99  #: A peak is the mean of the samples above this share of a half cycle's highest speed.
#: Cycles are alike if stroke and duration are within this share of the median; minimum share of cycles that are alike.
ALIKE, STEADY = 0.1, 0.6
FEWEST_CYCLES = 2  #: Minimum number of cycles for a mean.
#: Minimum number of changes of direction at each end, and minimum spread of their accelerations over their mean.
FEWEST_TURNS, SPREAD = 20, 0.3

NO_CYCLE = Unknown("the record has fewer than two whole cycles")
UNLIKE = Unknown("the motion is not one steady cycle; split a record of several sines into runs (--split)")


@dataclass(frozen=True, slots=True)
class Crossing:
    """A change of direction."""

    time: float  #: Time at which the velocity is zero [s].
    force: float  #: Force at that time [N].
    #: Last sample before it, and first sample after it, beyond the threshold of velocity.
    start: int
    stop: int
    upward: bool  #: Whether compression follows.
    acceleration: float  #: Acceleration at that time [m/s2].
    displacement: float  #: Displacement at that time [m]; 0 if it was not measured.


@dataclass(frozen=True, slots=True)
class Peaks:
    """Peaks of successive half cycles with the same speed: force at the centre of the stroke (PVP)."""

    #: Mean speed [m/s] and mean force magnitude [N], gas included.
    speed: float
    force: float
    scatter: float | None  #: Standard deviation of the forces [N]; None of a single one.
    count: int  #: Number of half cycles.


@dataclass(frozen=True, slots=True, eq=False)
class Cycles:
    """Cycles of a run."""

    peak_velocity: Array  #: Velocity at the peak of each half cycle (H,) [m/s], positive in compression.
    peak_force: Array  #: Force there (H,) [N].
    count: int  #: Number of whole cycles; of steady ones, those that are alike.
    is_steady: bool  #: Whether the cycles have the same stroke and duration.
    frequency: Found  #: Mean frequency [Hz].
    width: Found  #: Force at zero velocity at the compressed end minus that at the extended end [N].
    #: Energy dissipated per cycle [J], and its standard deviation between cycles [J].
    energy: Found
    energy_scatter: Found
    span: tuple[float, float] | None = None  #: Start and end of the chosen cycle [s]; None if all cycles count.

    def peaks(self, sign: float) -> tuple[Peaks, ...]:
        """Return the peaks of one direction at each speed that is repeated; nothing for a random motion."""
        chosen = sign * self.peak_velocity > 0.0
        speeds, forces = sign * self.peak_velocity[chosen], sign * self.peak_force[chosen]
        groups = grouped(range(speeds.size), lambda k, group: bool(abs(speeds[k] / speeds[group[0]] - 1.0) <= ALIKE))
        repeated = [k for group in groups if len(group) >= FEWEST_CYCLES or self.span for k in group]
        if len(repeated) < STEADY * speeds.size:
            return ()
        ascending = sorted(repeated, key=lambda k: float(speeds[k]))
        same = grouped(ascending, lambda k, group: bool(speeds[k] <= (1.0 + ALIKE) * speeds[group[0]]))
        return tuple(
            Peaks(float(speeds[group].mean()), float(forces[group].mean()),
                  float(forces[group].std(ddof=1)) if len(group) > 1 else None, len(group))
            for group in same
        )  # fmt: skip


def cycles_of(series: TimeSeries, cycle: str | int = "mean") -> Cycles:
    """Return the cycles of a record.

    Args:
        series: Record with `velocity` [m/s] and `force` [N].
        cycle: `mean` of all cycles that are alike, the `last` of them, or its number from 1; of a steady sine only.

    Raises:
        InputError: There are fewer cycles than this number.
    """
    crossings = crossings_of(series)
    peaks = np.array([_peak(series, a.stop, b.start) for a, b in pairwise(crossings)]).reshape(-1, 2)
    times = np.array([crossing.time for crossing in crossings if crossing.upward])
    none = NO_CYCLE if times.size < FEWEST_CYCLES + 1 else UNLIKE
    path = cumulative_trapezoid(series["velocity"], series.time, initial=0)
    bounds = pairwise(np.searchsorted(series.time, times).tolist())
    duration, stroke = np.diff(times), np.array([np.ptp(path[a : b + 1]) for a, b in bounds])
    alike = np.zeros(0, dtype=bool)
    if none is UNLIKE:
        usual = (np.median(stroke), np.median(duration))
        alike = (np.abs(stroke / usual[0] - 1.0) <= ALIKE) & (np.abs(duration / usual[1] - 1.0) <= ALIKE)
    if np.count_nonzero(alike) < max(FEWEST_CYCLES, STEADY * alike.size):
        return Cycles(peaks[:, 0], peaks[:, 1], max(times.size - 1, 0), False, none,
                      none if none is UNLIKE else _width(crossings), none, none)  # fmt: skip
    energy = np.diff(np.interp(times, series.time, energy_over_time(series)))
    used, span = np.flatnonzero(alike), None
    if cycle != "mean":
        number = used.size if cycle == "last" else int(cycle)
        if not 1 <= number <= used.size:
            raise InputError(f"--set cycle={cycle}: the run has {used.size} whole cycles that are alike")
        used = used[number - 1 : number]
        span = (float(times[used[0]]), float(times[used[0] + 1]))
        middles = np.array([0.5 * (a.time + b.time) for a, b in pairwise(crossings)])
        peaks = peaks[(middles > span[0]) & (middles < span[1])]
    scatter: Found = float(energy[used].std(ddof=1)) if used.size > 1 else Unknown("one cycle has no scatter")
    return Cycles(
        peaks[:, 0], peaks[:, 1], int(np.count_nonzero(alike)), True, float(1.0 / duration[used].mean()),
        _width(crossings), float(energy[used].mean()), scatter, span,
    )  # fmt: skip


def energy_over_time(series: TimeSeries) -> Array:
    """Return the integral of force times velocity (N,) [J] from the first sample."""
    return np.asarray(cumulative_trapezoid(series["force"] * series["velocity"], series.time, initial=0))


def crossings_of(series: TimeSeries) -> list[Crossing]:
    """Return the changes of direction between half cycles of at least 2 % of the record's stroke."""
    path, velocity = path_of(series), series["velocity"]
    turns = turning_points(path, threshold=SMALLEST * float(np.ptp(path)))
    if not turns:
        return []
    beyond = np.abs(velocity) >= REACHED * float(np.abs(velocity).max())
    middles = [(a + b) // 2 for a, b in pairwise(turns)]
    spans = zip(turns, [0, *middles], [*middles, velocity.size - 1], strict=True)
    found = (_crossing(series, beyond, *span) for span in spans)
    return [crossing for crossing in found if crossing is not None]


def _crossing(
    series: TimeSeries, beyond: NDArray[np.bool_], turn: int, first: int, last: int
) -> Crossing | None:  # fmt: skip
    """Return the crossing of zero near a turning point, from the samples `first` to `last`.

    Time and force are lines over the velocities between the samples (N,) whose speed is `beyond` the threshold.
    """
    before, after = np.flatnonzero(beyond[first:turn]), np.flatnonzero(beyond[turn : last + 1])
    start = first + int(before[-1]) if before.size else first
    stop = turn + int(after[0]) if after.size else last
    velocity = series["velocity"][start : stop + 1]
    if not (velocity[0] * velocity[-1] < 0.0 and velocity.size > 1):
        return None
    part = slice(start, stop + 1)
    place = series["displacement"][part] if "displacement" in series else np.zeros(velocity.size)
    time = _at_zero_velocity(velocity, series.time[part])
    rate = float(velocity[-1] - velocity[0]) / float(series.time[stop] - series.time[start])
    force = _at_zero_velocity(velocity, series["force"][part])
    return Crossing(time, force, start, stop, bool(velocity[-1] > 0.0), rate, _at_zero_velocity(velocity, place))


def _at_zero_velocity(velocity: Array, row: Array) -> float:
    """Return a channel (M,) at zero velocity: the mean of the lines through the samples of either direction.

    The lines differ where strokes have different rates and where friction changes its sign.
    """
    sides = [velocity > 0.0, velocity < 0.0]
    if all(np.count_nonzero(side) >= 2 and np.ptp(velocity[side]) > 0.0 for side in sides):
        return float(np.mean([_line_at_zero(velocity[side], row[side]) for side in sides]))
    return _line_at_zero(velocity, row)


def _line_at_zero(velocity: Array, row: Array) -> float:
    middle = velocity - velocity.mean()
    return float(row.mean() - velocity.mean() * (middle @ (row - row.mean())) / (middle @ middle))


def _peak(series: TimeSeries, start: int, stop: int) -> tuple[float, float]:
    part = slice(start, stop + 1)
    velocity, force = series["velocity"][part], series["force"][part]
    top = np.abs(velocity) >= PEAK * float(np.abs(velocity).max())
    return float(velocity[top].mean()), float(force[top].mean())


def force_at_rest(series: TimeSeries) -> Found:
    """Return the force at zero velocity and acceleration in the middle of the stroke [N] from the changes of direction.

    A lag adds a force in proportion to the acceleration, with the damping rate of the stroke that ends. A constant, a
    rate for each stroke and a stiffness are fitted by least squares to the half of the changes of direction with the
    smallest accelerations, where this proportion holds. The accelerations must differ, as in a random motion.
    """
    crossings = crossings_of(series)
    rates = np.array([crossing.acceleration for crossing in crossings])
    sizes = [np.abs(rates[rates > 0.0]), np.abs(rates[rates < 0.0])]
    if any(size.size < FEWEST_TURNS or size.std() < SPREAD * size.mean() for size in sizes):
        return Unknown("the accelerations at the changes of direction are alike or few")
    gentle = np.abs(rates) <= np.median(np.abs(rates))
    crossings, rates = [one for one, chosen in zip(crossings, gentle, strict=True) if chosen], rates[gentle]
    columns = [np.ones_like(rates), np.maximum(rates, 0.0), np.minimum(rates, 0.0)]
    if "displacement" in series:
        path = series["displacement"]
        columns.append(np.array([one.displacement for one in crossings]) - 0.5 * float(path.max() + path.min()))
    design = np.stack(columns, axis=1) / np.abs(columns).max(axis=1)
    found = np.linalg.lstsq(design, np.array([crossing.force for crossing in crossings]), rcond=None)[0]
    return float(found[0])


def _width(crossings: list[Crossing]) -> Found:
    """Return the width of the loop at zero velocity [N]."""
    extended = [crossing.force for crossing in crossings if crossing.upward]
    compressed = [crossing.force for crossing in crossings if not crossing.upward]
    if not (extended and compressed):
        return Unknown("the velocity does not change its sign in both directions")
    return float(np.mean(compressed)) - float(np.mean(extended))


# ---- Slow parts: gas force, gas stiffness and friction, where lag and valves have little effect ---------------------

#: A part is slow below this speed [m/s] and this acceleration [m/s2]: a lag of 10 ms changes its speed by 0.5 mm/s.
SLOW, GENTLE = 0.010, 0.05
#: Speed below which the direction of friction is that of the last motion [m/s], after this time at rest [s].
RESTING, SETTLED = 0.001, 0.5
#: Time left out on either side of a start or stop, in which the low-passed velocity is not the true one [s].
BESIDE = 0.1
VARIED = 0.2  #: Minimum standard deviation of the speed, over its mean, to distinguish friction from the valves.
#: Minimum duration of all slow parts together [s], and minimum share of them in each direction.
ENOUGH, EACH_WAY = 1.0, 0.1
RANGE = 0.2  #: Minimum range of displacement in the slow parts for a stiffness, as a share of the stroke.
CUTOFF = 10.0  #: Cut-off frequency of the velocity that decides what is slow [Hz].


@dataclass(frozen=True, slots=True)
class SlowFigures:
    """Figures of the slow parts: F = gas force + stiffness (x - middle) + friction sign(v) + viscous rate v."""

    gas_force: Found  #: Gas force in the middle of the stroke [N].
    stiffness: Found  #: Gas stiffness [N/m].
    friction: Found  #: Friction force in either direction [N].
    residual: Found  #: RMS of the forces about this equation [N].


def slow_figures(series: TimeSeries) -> SlowFigures:
    """Return the figures of the slow parts of a record: holds, and motions below 10 mm/s and 0.05 m/s2."""
    rate = series.sample_rate
    velocity = lowpass(series["velocity"], rate, min(CUTOFF, 0.2 * rate), order=2)
    direction = _direction(velocity, rate)
    used = (np.abs(velocity) <= SLOW) & (np.abs(derivative(velocity, rate)) <= GENTLE) & (direction != 0.0)
    used &= ~_near_changes(np.abs(velocity) > RESTING, round(BESIDE * rate))
    duration = float(np.count_nonzero(used)) / rate
    if duration < ENOUGH:
        none = Unknown(f"less than {ENOUGH:g} s of the record is slower than {1e3 * SLOW:.0f} mm/s and {GENTLE:g} m/s2")
        return SlowFigures(none, none, none, none)
    share = float(np.mean(direction[used] > 0.0))
    if not EACH_WAY <= share <= 1.0 - EACH_WAY:
        none = Unknown("the slow parts are in one direction only, so friction and gas force cannot be distinguished")
        return SlowFigures(none, none, none, none)
    return _fitted(series, velocity, direction, used)


def _direction(velocity: Array, rate: float) -> Array:
    """Return the direction of friction (N,): that of the motion, at rest that of the last motion, 0 if undecided."""
    moving = np.abs(velocity) > RESTING
    last = np.maximum.accumulate(np.where(moving, np.arange(velocity.size), -1))
    direction = np.where(last >= 0, np.sign(velocity[np.maximum(last, 0)]), 0.0)
    for start, stop in _stretches(~moving):
        if stop - start < SETTLED * rate:
            direction[start:stop] = 0.0
    return np.asarray(direction)


def _near_changes(flags: NDArray[np.bool_], width: int) -> NDArray[np.bool_]:
    """Return which samples (N,) are within a width of a change of the flags (N,)."""
    changes = np.flatnonzero(np.diff(flags.astype(np.int8)) != 0)
    edges = np.zeros(flags.size + 1, dtype=np.intp)
    np.add.at(edges, np.maximum(changes + 1 - width, 0), 1)
    np.add.at(edges, np.minimum(changes + 1 + width, flags.size), -1)
    return np.asarray(np.cumsum(edges)[:-1] > 0)


def _stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.diff(np.concatenate(([0], flags.astype(np.int8), [0])))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def _fitted(series: TimeSeries, velocity: Array, direction: Array, used: NDArray[np.bool_]) -> SlowFigures:
    force = series["force"][used]
    columns = [np.ones_like(force), direction[used]]
    position = _position(series, used)
    if not isinstance(position, Unknown):
        columns.append(position)
    speed = np.abs(velocity[used])
    moves = np.count_nonzero(speed > RESTING) >= 0.1 * force.size
    has_one_speed = moves and float(speed.std()) < VARIED * float(speed.mean())
    if moves and not has_one_speed:
        columns.append(velocity[used])
    design = np.stack(columns, axis=1)
    scale = np.abs(design).max(axis=0)
    found, _, rank, _ = np.linalg.lstsq(design / scale, force, rcond=1e-6)
    if rank < design.shape[1]:
        none = Unknown("the slow parts do not distinguish gas force, friction and valves")
        return SlowFigures(none, none, none, none)
    values = found / scale
    residual = float(np.sqrt(np.mean((design @ values - force) ** 2)))
    if values[1] < -residual:
        none = Unknown("the slow parts give a negative friction, so the shock is not at rest in them")
        return SlowFigures(none, none, none, residual)
    friction: Found = float(values[1])
    if has_one_speed:
        friction = Unknown("the slow parts have one speed, at which friction and valves cannot be distinguished")
    if isinstance(position, Unknown):
        return SlowFigures(position, position, friction, residual)
    return SlowFigures(float(values[0]), float(values[2]), friction, residual)


def _position(series: TimeSeries, used: NDArray[np.bool_]) -> Array | Unknown:
    """Return the displacement from the middle of the stroke (M,) [m] in the slow parts, if they show a stiffness."""
    if "displacement" not in series:
        return Unknown("the record has no displacement")
    path = series["displacement"]
    if float(np.ptp(path[used])) < RANGE * float(np.ptp(path)):
        return Unknown(f"the slow parts cover less than {100.0 * RANGE:.0f} % of the stroke")
    return np.asarray(path[used] - 0.5 * (path.max() + path.min()))


Stroke = Literal["compression", "rebound"]
STROKES: tuple[Stroke, Stroke] = ("compression", "rebound")
