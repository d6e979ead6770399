"""Whether a dynamometer record can be what its header says: units, signs, one state of the shock, sound instruments.

Every finding is a reason of the verdict (`eightpost.verdict`) with its figure and a remedy; `plausibility_rules` has
the table of all rules.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eightpost.array_types import Array
from eightpost.rig.cycles import path_of, run_down
from eightpost.rig.drift import drift_reasons, explained
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.force_spectrum import spectrum_reasons
from eightpost.rig.lag import lag_reasons
from eightpost.rig.motion_channels import motion_reasons
from eightpost.rig.one_setting import setting_reasons
from eightpost.rig.plausibility_rules import (
    CONTRADICTORY_UNITS,
    LARGE_REST,
    NEGATIVE_REST,
    RECTIFIED,
    RUN_DOWN,
    UNLIKELY_UNITS,
    UNRELATED,
)
from eightpost.rig.rest_force import rest_force
from eightpost.rig.sample_faults import sample_reasons
from eightpost.signals.filters import white_noise
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.verdict import Reason

# ---- Limits ---------------------------------------------------------------------------------------------------------

#: Usual sample rate of a dynamometer [Hz].
LOWEST_SAMPLING, HIGHEST_SAMPLING = 20.0, 2e5
#: Smallest and largest plausible velocity [m/s], stroke [m] and force [N].
PLAUSIBLE = {"velocity": (1e-3, 10.0), "displacement": (1e-4, 0.6), "force": (1.0, 1e5)}
#: Relative difference from 4.45 of the ratio of the stated and the measured gas force, and standard errors of the
#: force at standstill from which it is used.
GAS_TOLERANCE, CLEAR = 0.15, 6.0
#: One pound-force [N].
_LBF = convert(1.0, "lbf", "N")
#: Minimum correlation of force and velocity.
WEAK = 0.3
#: Force at standstill [N] that few gas springs reach: 2 MPa on a rod of 25 mm.
STRONG_GAS = 1000.0
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
#: Share of the range of a negative force at standstill that is reported.
REST_SHARE = 0.03
#: Speeds above this share of the peak show whether a force has a sign.
FAST = 0.15


def record_reasons(
    series: TimeSeries, *, measured: tuple[str, ...], origin: str, conditions: DynoConditions | None = None
) -> Iterator[Reason]:
    """Yield what is implausible about the units, signs and instruments of a record.

    Args:
        series: Record with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
        measured: Names of the channels that were measured, not derived.
        origin: Name of the record.
        conditions: Stated conditions, whose gas force the force is compared with.
    """
    if rectified := rectified_force(series):
        yield RECTIFIED.reason("the force is rectified", figure=rectified, origin=origin)
        return
    suspicious = list(_unit_reasons(series, measured, origin))
    yield from suspicious
    yield from _rest_reasons(series, conditions or DynoConditions(), origin)
    yield from motion_reasons(series, measured, origin)
    if not suspicious:
        yield from spectrum_reasons(series, measured, origin)
        yield from lag_reasons(series, origin)
    if (correlation := _correlation(series["force"], series["velocity"])) < WEAK:
        figure = f"their correlation is {correlation:.2f}"
        yield UNRELATED.reason("force and velocity are hardly related", figure=figure, origin=origin)


def part_reasons(
    series: TimeSeries, *, measured: tuple[str, ...], origin: str, until: float = SEGMENT[1]
) -> Iterator[Reason]:
    """Yield what is wrong in the samples of a record or a run of it, and what changed during it.

    Args:
        series: Record or run with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
        measured: Names of the channels that were measured, not derived.
        origin: Name of the record.
        until: End of the fitted seconds, from the start of the series [s].
    """
    yield from sample_reasons(series, measured, origin)
    stop = run_down(series.time, path_of(series), series["velocity"])
    steady = series if stop is None else series.window(float(series.time[0]), stop)
    if not rectified_force(series):
        changed = list(setting_reasons(steady, origin))
        yield from changed or drift_reasons(steady, measured, origin)
    if stop is not None and stop - series.time[0] < until:
        figure = f"from {stop:.4g} s to {series.time[-1]:.4g} s the motion runs down"
        remedy = f"fit the part before it: --segment '0 s' '{stop - series.time[0]:.4g} s'"
        yield RUN_DOWN.reason("the machine stops within the record", figure=figure, origin=origin, remedy=remedy)


# ---- Units ----------------------------------------------------------------------------------------------------------


def _unit_reasons(series: TimeSeries, measured: tuple[str, ...], origin: str) -> Iterator[Reason]:
    rate = series.sample_rate
    if not LOWEST_SAMPLING <= rate <= HIGHEST_SAMPLING:
        hint = "time is probably in ms but labelled s" if rate < LOWEST_SAMPLING else "time is probably in s or min"
        figure = (
            f"{rate:.4g} samples per second over {series.duration:.4g} s; usual are {LOWEST_SAMPLING:g} to "
            f"{HIGHEST_SAMPLING:g} Hz: {hint}"
        )
        yield UNLIKELY_UNITS.reason("the sample rate is not that of a dynamometer", figure=figure, origin=origin)
        return
    for name, (low, high) in PLAUSIBLE.items():
        if name in measured:
            values = series[name]
            largest = float(np.ptp(values) if name == "displacement" else np.abs(values).max())
            if not low <= largest <= high:
                figure = f"it reaches {largest:.4g} (SI); plausible are {low:g} to {high:g}"
                yield UNLIKELY_UNITS.reason(f"the unit of the {name} is probably wrong", figure=figure, origin=origin)


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


def _rest_reasons(series: TimeSeries, conditions: DynoConditions, origin: str) -> Iterator[Reason]:
    """Yield a reason if the force at standstill is not that of a gas, or not the stated one in its unit."""
    velocity, force = series["velocity"], series["force"]
    if (found := rest_force(velocity, force)) is None:
        return
    (rest, error), span = found, float(np.ptp(force))
    share = f"{rest:.4g} N at standstill, {100.0 * rest / span:.2g} % of the force's range"
    if (
        rest < -0.5 * REST_SHARE * span and explained(series).rest < -REST_SHARE * span
    ):  # a lag of a stiff rebound does not count
        what = "the force at standstill is negative, although gas pushes"
        yield NEGATIVE_REST.reason(what, figure=share, origin=origin)
    if rest > max(0.5 * span, STRONG_GAS):
        yield LARGE_REST.reason("the force at standstill is large", figure=share, origin=origin)
    stated = conditions.gas_force
    if stated and stated > 0.0 and rest > CLEAR * error:
        for factor, hint in ((_LBF, "lbf labelled N"), (1.0 / _LBF, "N labelled lbf")):
            if abs(stated / rest / factor - 1.0) < GAS_TOLERANCE:
                figure = f"{rest:.4g} N at standstill, but the stated gas force is {stated:.4g} N: {hint}"
                yield CONTRADICTORY_UNITS.reason("the unit of the force is wrong", figure=figure, origin=origin)
