"""Gas force, gas stiffness and friction from the slow parts of a record, where lag and valves have little effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.dyno_report.found import Found, Unknown
from eightpost.signals import TimeSeries
from eightpost.signals.filters import derivative, lowpass

#: A part is slow below this speed [m/s] and this acceleration [m/s2]: a lag of 10 ms changes its speed by 0.5 mm/s.
SLOW, GENTLE = 0.010, 0.05
#: Speed below which the direction of friction is that of the last motion [m/s], after this time at rest [s].
RESTING, SETTLED = 0.001, 0.5
#: Time left out on either side of a start or stop, in which the low-passed velocity is not the true one [s].
BESIDE = 0.1
#: Minimum standard deviation of the speed, over its mean, to distinguish friction from the valves.
VARIED = 0.2
#: Minimum duration of all slow parts together [s], and minimum share of them in each direction.
ENOUGH, EACH_WAY = 1.0, 0.1
#: Minimum range of displacement in the slow parts for a stiffness, as a share of the stroke.
RANGE = 0.2
#: Cut-off frequency of the velocity that decides what is slow [Hz].
CUTOFF = 10.0


@dataclass(frozen=True, slots=True)
class SlowFigures:
    """Figures of the slow parts: F = gas force + stiffness (x - middle) + friction sign(v) + viscous rate v."""

    #: Gas force in the middle of the stroke [N].
    gas_force: Found
    #: Gas stiffness [N/m].
    stiffness: Found
    #: Friction force in either direction [N].
    friction: Found
    #: RMS of the forces about this equation [N].
    residual: Found


def slow_figures(series: TimeSeries) -> SlowFigures:
    """Return the figures of the slow parts of a record: holds, and motions below 10 mm/s and 0.05 m/s2.

    Args:
        series: Record with an even time step, `velocity` [m/s], `force` [N], and if known `displacement` [m].
    """
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
