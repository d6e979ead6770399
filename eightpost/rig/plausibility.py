"""Whether a dynamometer record can be what its header says: units, signs, one setting of the shock, constant motion.

Every finding is a reason of the verdict (`eightpost.verdict`) with its figure and a remedy.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from eightpost.array_types import Array
from eightpost.rig.cycles import run_down
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.force_scale import force_scale_reasons
from eightpost.rig.lag import lag_reasons
from eightpost.rig.one_setting import setting_reasons
from eightpost.rig.plausibility_rules import (
    CONTRADICTORY_UNITS,
    NEGATIVE_REST,
    RECTIFIED,
    RUN_DOWN,
    UNLIKELY_UNITS,
)
from eightpost.rig.rest_force import pulls_at_standstill, rest_force
from eightpost.signals.filters import lowpass, white_noise
from eightpost.signals.timeseries import TimeSeries
from eightpost.verdict import Reason

# ---- Limits ---------------------------------------------------------------------------------------------------------

#: Usual damping rate of a shock [N.s/m]. The measured records of docs/evidence/measured_shocks.md and the virtual
#: shocks have 1300 to 11,000; 1000 lbf per m/s labelled N would be 4.4 times less, inches labelled mm 25.4 times more.
LOW_RATE, HIGH_RATE = 1e3, 3e4
#: The same, if a file has force in newtons beside motion in inches, or the reverse.
MIXED_LOW, MIXED_HIGH = 2.5e3, 1.2e4
#: Range of force [N] above which a high damping rate is not seal friction in a very slow test.
NOT_FRICTION = 200.0
#: Usual sample rate of a dynamometer [Hz].
LOWEST_SAMPLING, HIGHEST_SAMPLING = 20.0, 2e5
#: Ratios of the slope of displacement to velocity that two contradictory units cause, and what causes them.
RATIOS = {
    1e-3: "time is in ms but labelled s, displacement in m labelled mm, or velocity in mm/s labelled m/s",
    1e3: "time is in s but labelled ms, displacement in mm labelled m, or velocity in m/s labelled mm/s",
    25.4: "displacement is in mm but labelled in, or velocity in in/s labelled mm/s",
    1.0 / 25.4: "displacement is in inches but labelled mm, or velocity in mm/s labelled in/s",
    25.4e-3: "velocity is in mm/s but labelled in/s and displacement is in m labelled mm, or m is labelled in",
    0.1: "displacement is in cm but labelled mm, or velocity in mm/s labelled cm/s",
    10.0: "displacement is in mm but labelled cm, or velocity in cm/s labelled mm/s",
    60.0: "time is in min but labelled s",
    1.0 / 60.0: "velocity is per minute but labelled per second",
}
#: Relative tolerance of such a ratio.
RATIO_TOLERANCE = 0.08
#: A force is rectified if its correlation with speed exceeds this in both strokes, and ...
RECTIFIED_CORRELATION = 0.3
#: ... it does not fall below minus this share of its maximum: neither its mean at a velocity, nor ...
RECTIFIED_FLOOR = 0.02
#: ... a value that is more than this many standard deviations of its noise below zero.
RECTIFIED_NOISE = 6.0
#: Number of classes of the speed of a stroke, in which a mean is taken, and the force may fall to zero and rise again.
TURN_CLASSES = 12
#: Smallest number of samples of a class.
TURN_SAMPLES = 5
#: Seconds that a fit uses unless others are given (3.3).
SEGMENT = (1.0, 10.0)
#: Share of the range, and number of standard errors, of a negative force at standstill that is reported.
REST_SHARE, REST_ERRORS = 0.01, 4.0
#: Speeds above this share of the peak show whether a force has a sign.
FAST = 0.15


def record_reasons(
    series: TimeSeries,
    *,
    measured: tuple[str, ...],
    origin: str,
    units: MixedUnits,
    conditions: DynoConditions | None = None,
) -> Iterator[Reason]:
    """Yield what is implausible about the units and signs of a record.

    Args:
        series: Record with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
        measured: Names of the channels that were measured, not derived.
        origin: Name of the record.
        units: Whether the file mixes inches and newtons.
        conditions: Stated conditions, whose gas pressure or gas force the force is compared with.
    """
    if rectified := rectified_force(series):
        yield RECTIFIED.reason("the force is rectified", figure=rectified, origin=origin)
        return
    suspicious = list(_unit_reasons(series, measured, origin, units))
    yield from suspicious or force_scale_reasons(series, conditions or DynoConditions(), origin)
    yield from _rest_reasons(series, origin)
    if not suspicious:
        yield from lag_reasons(series, origin)


def part_reasons(series: TimeSeries, *, origin: str, until: float = SEGMENT[1]) -> Iterator[Reason]:
    """Yield what changed during a record or a run of it: the setting of the shock, the motion.

    Args:
        series: Record or run with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
        origin: Name of the record.
        until: End of the fitted seconds, from the start of the series [s].
    """
    if not rectified_force(series):
        yield from setting_reasons(series, origin)
    yield from _run_down_reasons(series, origin, until)


# ---- Units ----------------------------------------------------------------------------------------------------------


class MixedUnits(NamedTuple):
    """Units of motion and of force of a file, if one is metric and the other US customary; otherwise empty texts."""

    motion: str = ""
    force: str = ""


def damping_rate(series: TimeSeries) -> float:
    """Return the mean damping rate [N.s/m]: dissipated energy over the integral of the squared velocity."""
    velocity, force = series["velocity"], series["force"]
    moving = velocity - velocity.mean()
    return float(moving @ (force - force.mean()) / (moving @ moving))


def unit_ratio(ratio: float) -> str | None:
    """Return what causes a ratio of the slope of displacement to velocity; None for a ratio of no two units."""
    causes = (cause for known, cause in RATIOS.items() if abs(ratio / known - 1.0) <= RATIO_TOLERANCE)
    return next(causes, None)


def _unit_reasons(series: TimeSeries, measured: tuple[str, ...], origin: str, units: MixedUnits) -> Iterator[Reason]:
    rate = series.sample_rate
    if rate < LOWEST_SAMPLING or rate > HIGHEST_SAMPLING:
        hint = "time is probably in ms but labelled s" if rate < LOWEST_SAMPLING else "time is probably in s or min"
        figure = (
            f"{rate:.4g} samples per second over {series.duration:.4g} s; usual are {LOWEST_SAMPLING:g} to "
            f"{HIGHEST_SAMPLING:g} Hz: {hint}"
        )
        yield UNLIKELY_UNITS.reason("the sample rate is not that of a dynamometer", figure=figure, origin=origin)
        return
    if {"velocity", "displacement"} <= set(measured):
        ratio = slope_ratio(series)
        if cause := unit_ratio(ratio):
            figure = f"the slope of displacement is {ratio:.4g} times the velocity: {cause}"
            yield CONTRADICTORY_UNITS.reason("the units of the channels contradict each other", figure=figure,
                                             origin=origin)  # fmt: skip
            return
    yield from _rate_reasons(series, origin, units)


def slope_ratio(series: TimeSeries) -> float:
    """Return the standard deviation of the slope of displacement over that of velocity [1], both without noise."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    rate = even.sample_rate
    path = lowpass(even["displacement"], rate, min(50.0, 0.4 * rate))
    velocity = lowpass(even["velocity"], rate, min(50.0, 0.4 * rate))
    return float(np.gradient(path, 1.0 / rate).std() / velocity.std())


def _rate_reasons(series: TimeSeries, origin: str, units: MixedUnits) -> Iterator[Reason]:
    rate, mixed = damping_rate(series), bool(units.force)
    low, high = (MIXED_LOW, MIXED_HIGH) if mixed else (LOW_RATE, HIGH_RATE)
    span, speed = float(np.ptp(series["force"])), float(np.abs(series["velocity"]).max())
    beside = f"; the file has {units.motion} beside {units.force}" if mixed else ""
    if 0.0 < rate < low:
        hint = f"if force is in lbf but labelled N, it is {4.448 * rate:.4g}"
    elif rate > high and span > NOT_FRICTION:
        hint = f"if inches are labelled mm, it is {rate / 25.4:.4g}; if ms are labelled s, {rate / 1000.0:.4g}"
    else:
        return
    figure = (
        f"damping rate {rate:.4g} N.s/m (force range {span:.4g} N, peak velocity {speed:.4g} m/s); usual are "
        f"{low:g} to {high:g} N.s/m{beside}; {hint}"
    )
    yield UNLIKELY_UNITS.reason("a unit is probably wrong", figure=figure, origin=origin)


# ---- Signs ----------------------------------------------------------------------------------------------------------


def rectified_force(series: TimeSeries) -> str:
    """Return a figure if the force is a magnitude without sign; empty otherwise."""
    velocity, force = series["velocity"], series["force"]
    floor = RECTIFIED_FLOOR * float(force.max())
    if _lowest_mean(velocity, force) < -floor or force.min() < -max(floor, RECTIFIED_NOISE * white_noise(force)):
        return ""
    speed = np.abs(velocity)
    fast = speed > FAST * float(speed.max())
    with_speed = [_correlation(speed[side], force[side]) for side in (fast & (velocity > 0.0), fast & (velocity < 0.0))]
    values = f"minimum {force.min():.4g} N, maximum {force.max():.4g} N"
    if min(with_speed) >= RECTIFIED_CORRELATION:
        return (
            f"{values}; its correlation with speed is {with_speed[0]:.2f} in compression and {with_speed[1]:.2f} in "
            "rebound, where it must be negative"
        )
    turn = _turning_speed(speed[velocity < 0.0], force[velocity < 0.0], float(force.max()))
    return f"{values}; in rebound it falls to about zero at {turn:.2g} m/s and rises again beyond" if turn else ""


def _lowest_mean(velocity: Array, force: Array) -> float:
    """Return the lowest mean force of a class of velocities [N]; noise about zero does not make a mean negative."""
    place = np.round(TURN_CLASSES * velocity / max(float(np.abs(velocity).max()), 1e-12)).astype(int) + TURN_CLASSES
    count, total = np.bincount(place), np.bincount(place, weights=force)
    kept = count >= TURN_SAMPLES
    return float((total[kept] / count[kept]).min(initial=float(force.max())))


def _turning_speed(speed: Array, force: Array, largest: float) -> float:
    """Return the rebound speed [m/s] at which the force falls to zero and rises again; 0 if it does not.

    Gas pushes in rebound too, so of a force with little damping only the part at high speed was negative.
    """
    place = np.minimum((speed / float(speed.max(initial=1e-12)) * TURN_CLASSES).astype(int), TURN_CLASSES - 1)
    classes = [part for k in range(TURN_CLASSES) if (part := np.flatnonzero(place == k)).size >= TURN_SAMPLES]
    if len(classes) < 3:
        return 0.0
    means = np.array([force[part].mean() for part in classes])
    lowest = int(np.argmin(means))
    beyond = np.concatenate(classes[lowest:])
    is_folded = (
        force.min() < RECTIFIED_FLOOR * largest
        and means[-1] - means[lowest] > RECTIFIED_FLOOR * largest
        and _correlation(speed[beyond], force[beyond]) >= RECTIFIED_CORRELATION
    )
    return float(speed[classes[lowest]].mean()) if is_folded else 0.0


def _correlation(first: Array, second: Array) -> float:
    """Return the correlation of two channels (N,), 0 if one of them is constant."""
    if first.size < 3 or not (np.ptp(first) > 0.0 and np.ptp(second) > 0.0):
        return 0.0
    return float(np.corrcoef(first, second)[0, 1])


def _rest_reasons(series: TimeSeries, origin: str) -> Iterator[Reason]:
    velocity, force = series["velocity"], series["force"]
    found = rest_force(velocity, force)
    span = float(np.ptp(force))
    if found is None or found[0] >= -max(REST_SHARE * span, REST_ERRORS * found[1]):
        return
    if not pulls_at_standstill(velocity, force, REST_SHARE * span):
        return
    figure = f"{found[0]:.4g} N at standstill, {100.0 * found[0] / span:.2g} % of the force's range"
    yield NEGATIVE_REST.reason("the force at standstill is negative, although gas pushes", figure=figure, origin=origin)


# ---- Steady motion --------------------------------------------------------------------------------------------------


def _run_down_reasons(series: TimeSeries, origin: str, until: float) -> Iterator[Reason]:
    """Yield a reason if a steady sine runs down before the end of a record."""
    velocity, rate = series["velocity"], series.sample_rate
    path = series["displacement"] if "displacement" in series else _integral(series)
    start = run_down(series.time, lowpass(path, rate, min(50.0, 0.1 * rate), order=2), velocity)
    begin, end = float(series.time[0]), float(series.time[-1])
    if start is None or start - begin >= until:
        return
    figure = f"from {start:.4g} s to {end:.4g} s the motion runs down"
    remedy = f"fit the part before it: --segment '0 s' '{start - begin:.4g} s'"
    yield RUN_DOWN.reason("the machine stops within the record", figure=figure, origin=origin, remedy=remedy)


def _integral(series: TimeSeries) -> Array:
    path = cumulative_trapezoid(series["velocity"] - series["velocity"].mean(), series.time, initial=0)
    return np.asarray(path)
