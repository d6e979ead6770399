"""Whether a shock stayed the same throughout a record: its force at standstill, one setting, no drift."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from eightpost.array_types import Array
from eightpost.rig.clipping import clipping_faults
from eightpost.rig.dyno_conditions import DynoConditions
from eightpost.rig.faults import Fault, fault
from eightpost.rig.motion import displacement_of, lag_faults, motion_faults, path_of, run_down, slopes
from eightpost.signals.filters import lowpass, white_noise
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

SLOW = 0.05  #: Speeds below this share of the peak count as standstill.


def rest_force(velocity: Array, force: Array) -> tuple[float, float] | None:
    """Return the force at standstill [N] and its standard error; None without samples on both sides of standstill.

    It is the mean of the forces just above and just below zero velocity, so that friction cancels.
    """
    limit = SLOW * float(np.abs(velocity).max())
    sides = [force[(velocity > 0.0) & (velocity <= limit)], force[(velocity < 0.0) & (velocity >= -limit)]]
    if min(side.size for side in sides) < 5:
        return None
    error = np.sqrt(sum(float(side.var()) / side.size for side in sides)) / 2.0
    return float(np.mean([side.mean() for side in sides])), float(error)


# ---- One setting ----------------------------------------------------------------------------------------------------
# The force of each cycle, at the same velocities, is compared with that of the others. One step between two levels that
# nothing smooth explains, neither a drift nor a warming towards a constant value, is a change of the shock. Low
# speeds are examined by themselves, because a bleed acts there, and its force is small.

BLOCKS, FEWEST_BLOCKS = 20, 5  #: Maximum and minimum number of blocks of a record.
CLASSES = 15  #: Number of classes of velocity.
#: Bands of speed that are examined, as shares of the peak, and what a figure calls them.
BANDS = {"": (0.15, 1.0), " at low speed": (0.04, 0.3), " at high speed": (0.6, 1.0)}
MOVING = 0.15  #: Speeds above this share of the peak separate the strokes of a cycle.
#: Step of the force between two parts of a record that is reported, and that makes it not usable, ...
STEP, LARGE_STEP = 0.03, 0.08
STEP_SCATTER = 6.0  #: ... in multiples of the scatter within these parts, ...
STEP_SHARE = 0.3  #: ... and maximum share of the scatter about a smooth course that the scatter about a step may have.
#: Time constants of a smooth course, as shares of the record; in addition to a straight drift.
SETTLING = (0.05, 0.1, 0.2, 0.4, 0.8)
#: Ratio of the sizes of the motion before and after a step above which the motion changed, and the shock perhaps did
#: not: the force at a velocity depends on frequency and stroke.
MOTION = 1.3
FADE = 0.5  #: Size of the velocity, relative to its median over all cycles, below which a cycle is part of a fade-in.
FEWEST_MOVING = 2  #: Smallest number of other cycles on each side of a step.
#: Minimum share of the record on each side of a step: a shock that cavitates needs some cycles to reach its state.
FEWEST_SHARE = 0.15


def setting_faults(series: TimeSeries) -> Iterator[Fault]:
    """Yield a fault for each stroke in which the force at the same velocity steps during the record."""
    velocity, force = series["velocity"], series["force"]
    block = _cycle_blocks(velocity)
    count = int(block.max()) + 1
    rest = rest_force(velocity, force)
    if count < FEWEST_BLOCKS or rest is None:
        return
    phase = _phase(series)
    for side, sign in (("compression", 1.0), ("rebound", -1.0)):
        speed, stroke_force = sign * velocity / float(np.abs(velocity).max()), sign * (force - rest[0])
        steps = []
        for where, (low, high) in BANDS.items():
            chosen = (speed > low) & (speed <= high)
            if np.count_nonzero(chosen) < CLASSES * FEWEST_BLOCKS:
                continue
            sizes = _block_sizes(speed[chosen], stroke_force[chosen], phase[:, chosen], block[chosen], count)
            step = _step_of(sizes)
            if step and _has_one_motion(phase, velocity, block, step[0]):
                steps.append((*step, where))
        if steps:
            first, change, where = max(steps, key=lambda step: abs(step[1]))
            at = float(series.time[np.argmax(block == first)])
            figure = f"{side} force {100.0 * change:+.0f} % at the same velocity{where} from about {at:.4g} s on"
            rule = "the shock changed" if abs(change) >= LARGE_STEP else "the shock changed a little"
            yield fault(rule, "the shock changed during the record", figure)


def _phase(series: TimeSeries) -> Array:
    """Return displacement (if known) and acceleration (2 or 1, N), on which the force at a velocity also depends."""
    rows = [np.gradient(series["velocity"], series.time)]
    if "displacement" in series:
        rows.append(series["displacement"])
    return np.stack([row / row.std() for row in rows])


def _has_one_motion(phase: Array, velocity: Array, block: NDArray[np.intp], first: int) -> bool:
    """Return whether velocity and the rows of `phase` have similar sizes before and from block `first` on."""
    count = np.maximum(np.bincount(block), 1)
    squares = np.stack([np.bincount(block, weights=(row - row.mean()) ** 2) / count for row in (velocity, *phase)])
    moving = squares[0] > np.median(squares[0]) * FADE**2
    before = np.arange(count.size) < first
    if min(np.count_nonzero(side & moving) for side in (before, ~before)) < FEWEST_MOVING:
        return False
    sizes = squares[:, before & moving].mean(axis=1), squares[:, ~before & moving].mean(axis=1)
    return bool((np.abs(np.log(sizes[0] / sizes[1])) <= 2.0 * np.log(MOTION)).all())


def _cycle_blocks(velocity: Array) -> NDArray[np.intp]:
    """Return the number of the block (N,) that each sample belongs to; a block is one or more whole cycles."""
    fast = np.flatnonzero(np.abs(velocity) > MOVING * float(np.abs(velocity).max()))
    signs = velocity[fast] > 0.0
    starts = fast[1:][signs[1:] & ~signs[:-1]]
    cycle = np.searchsorted(starts, np.arange(velocity.size), side="right")
    return np.asarray(cycle * BLOCKS // (starts.size + 1) if starts.size >= BLOCKS else cycle, dtype=np.intp)


def _block_sizes(speed: Array, force: Array, phase: Array, block: NDArray[np.intp], count: int) -> Array:
    """Return the force in each block (count,), relative to the mean at the same speeds; NaN for an empty block."""
    edges = np.quantile(speed, np.linspace(0.0, 1.0, CLASSES + 1)[1:-1])
    place = np.searchsorted(edges, speed)
    total = np.bincount(place, minlength=CLASSES)
    mean = (np.bincount(place, weights=force, minlength=CLASSES) / np.maximum(total, 1))[place]
    rest = force - mean
    size, *_ = np.linalg.lstsq(phase.T, rest, rcond=None)
    force = force - size @ phase
    norm = np.bincount(block, weights=mean * mean, minlength=count)
    share = norm / max(float(norm.max()), 1e-300)
    with np.errstate(invalid="ignore", divide="ignore"):
        sizes = np.bincount(block, weights=force * mean, minlength=count) / norm
    sizes[share <= 0.1] = np.nan
    sizes[[0, -1]] = np.nan  # incomplete cycles
    return np.asarray(sizes)


def _step_of(sizes: Array) -> tuple[int, float] | None:
    """Return the step of a sequence (K,), if it is one step and not a drift or scatter.

    It is the number of the first block after the step, and the relative change [1].
    """
    places = np.flatnonzero(np.isfinite(sizes))
    sizes = sizes[places]
    if sizes.size < FEWEST_BLOCKS:
        return None
    # The block in which the step occurs has both settings; it is left out.
    margin = max(1, int(np.ceil(FEWEST_SHARE * sizes.size)))
    splits = [(_scatter(sizes, i), i) for i in range(margin, sizes.size - margin)]
    scatter, split = min(splits)
    before, after = float(sizes[:split].mean()), float(sizes[split + 1 :].mean())
    deviation = np.sqrt(scatter / max(sizes.size - 3, 1))
    change = after / before - 1.0 if before > 0.0 else np.inf
    if abs(change) < STEP or abs(after - before) < STEP_SCATTER * deviation:
        return None
    if scatter > STEP_SHARE * _smooth_scatter(places, sizes):
        return None
    return int(places[split]), float(change)


def _scatter(sizes: Array, split: int) -> float:
    """Return the sum of squares about the means before and after block `split`, which is left out."""
    parts = (sizes[:split], sizes[split + 1 :])
    return float(sum(np.sum((part - part.mean()) ** 2) for part in parts))


def _smooth_scatter(places: NDArray[np.intp], sizes: Array) -> float:
    """Return the smallest sum of squares about a straight drift or an exponential approach to a constant value."""
    share = (places - places[0]) / (places[-1] - places[0])
    courses = [share, *(np.exp(-share / constant) for constant in SETTLING)]
    left = []
    for course in courses:
        design = np.column_stack([np.ones_like(course), course])
        found, *_ = np.linalg.lstsq(design, sizes, rcond=None)
        left.append(float(np.sum((sizes - design @ found) ** 2)))
    return min(left)


# ---- Drift of the force at the same motion --------------------------------------------------------------------------

#: Number of knots of the curve over velocity, and of the effect of acceleration (a lag) over velocity.
KNOTS, LAG_KNOTS = 15, 5
NEAR_ZERO = (-0.02, 0.0, 0.02)  #: Knots of both at these shares of the highest speed.
#: Fewest blocks of cycles, and smallest size of the motion in a block relative to the median.
DRIFT_BLOCKS, DRIFT_FADE = 5, 0.5
CHANGE = 0.05  #: Relative change of a gain, and change of a level relative to the range, that is reported, ...
#: ... in multiples of its standard error; and range of the logarithm of a motion's size that is the same motion.
ERRORS, SAME = 6.0, 0.02
SWEEP = 0.25  #: Change of the stroke of a sine above which it is a sweep.


def explained(series: TimeSeries) -> tuple[Array, float]:
    """Return the force (N,) [N] that velocity, displacement and acceleration explain, and that at standstill [N].

    F = f(v) + a g(v) + k x by least squares, with f and g linear between knots; g is the effect of a lag
    """
    rate, force = series.sample_rate, series["force"]
    velocity = lowpass(series["velocity"], rate, min(50.0, 0.2 * rate), order=2)
    slope = np.gradient(velocity, series.time)
    curve = _hats(velocity, KNOTS)
    columns = [curve, _hats(velocity, LAG_KNOTS) * _scaled(slope)[:, None]]
    if "displacement" in series:
        columns.append(_scaled(series["displacement"] - series["displacement"].mean())[:, None])
    design = np.hstack(columns)
    found, *_ = np.linalg.lstsq(design.T @ design, design.T @ force, rcond=None)
    at_rest = int(np.argmin(np.abs(velocity)))
    return design @ found, float(curve[at_rest] @ found[: curve.shape[1]])


def _scaled(values: Array) -> Array:
    return np.asarray(values / max(float(values.std()), 1e-300))


def _hats(values: Array, count: int) -> Array:
    """Return a basis (N, K) of functions of `values` (N,) that are linear between knots, one of them at 0.

    Besides quantiles there are knots close to 0, where a valve has its nose: the force at standstill is that at 0.
    """
    largest = float(np.abs(values).max())
    spread = np.quantile(values / largest, np.linspace(0.0, 1.0, count))
    knots = largest * np.unique(np.round(np.concatenate([spread, NEAR_ZERO]), 4))
    return np.stack([np.interp(values, knots, row) for row in np.eye(knots.size)], axis=1)


def _drift_faults(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[Fault]:
    """Yield a fault if the force drifts at the same motion, or the displacement beside the velocity."""
    force, model = series["force"], explained(series)[0]
    span = float(np.ptp(model))
    parts = _parts(_cycle_blocks(series["velocity"]), series["velocity"])
    if len(parts) < DRIFT_BLOCKS:
        return
    motion = [series["velocity"], np.gradient(series["velocity"], series.time)]
    middle = np.array([float(series.time[part].mean()) for part in parts])
    sizes = [np.log([float(row[part].std()) for part in parts]) for row in motion]
    slope = {
        "size of the force": _drift(middle, [_gain(force[part], model[part]) for part in parts], sizes),
        "level of the force": _drift(middle, [float((force - model)[part].mean()) for part in parts], sizes, unit=span),
    }
    if {"velocity", "displacement"} <= set(measured):
        velocity, path_slope, _ = slopes(series)
        gains = [_gain(path_slope[part], velocity[part]) for part in parts]
        slope["size of the displacement"] = _drift(middle, gains, sizes)
    elif "displacement" in measured:  # a steady sine keeps its stroke
        stroke = _drift(middle, np.log([float(series["displacement"][part].std()) for part in parts]), [])
        slope["size of the displacement"] = stroke if abs(stroke) * series.duration < SWEEP else 0.0
    for name, found in slope.items():
        if found:
            figure = (
                f"{100.0 * found * series.duration:+.0f} % in the {name} at the same motion from "
                f"{series.time[0]:.4g} s to {series.time[-1]:.4g} s"
            )
            yield fault("drift", f"the {name.split()[-1]} drifts", figure)


def _gain(values: Array, reference: Array) -> float:
    """Return the factor of the variations of a reference (N,) in values (N,)."""
    varied = reference - reference.mean()
    return float(varied @ values / max(float(varied @ varied), 1e-300))


def _parts(block: NDArray[np.intp], velocity: Array) -> list[NDArray[np.intp]]:
    """Return the samples of each block of whole cycles that is not part of a fade-in or a pause."""
    parts = [np.flatnonzero(block == number) for number in range(1, int(block.max()))]
    sizes = np.array([float(velocity[part].std()) for part in parts])
    return [part for part, size in zip(parts, sizes, strict=True) if size > DRIFT_FADE * np.median(sizes)]


def _drift(time: Array, values: Sequence[float] | Array, sizes: Sequence[Array], *, unit: float = 1.0) -> float:
    """Return the slope [1/s] of values (K,), in a unit, over the times (K,) [s], if it is clear; 0 otherwise.

    The sizes (K,) of the motion explain a part of the values, because the force also depends on frequency and stroke.
    """
    centred = time - time.mean()
    rows = [np.ones_like(time), *(size for size in sizes if np.ptp(size) > SAME)]
    design = np.column_stack([centred, *rows])
    if design.shape[0] < design.shape[1] + 2:
        return 0.0
    found, *_ = np.linalg.lstsq(design, one := np.asarray(values) / unit, rcond=None)
    rest = one - design @ found
    inverse = np.linalg.pinv(design.T @ design)
    error = np.sqrt(float(rest @ rest) / (one.size - design.shape[1]) * inverse[0, 0])
    change = abs(float(found[0])) * float(np.ptp(time))
    return float(found[0]) if change >= CHANGE and abs(found[0]) >= ERRORS * error else 0.0


# ==== The checks of a record =========================================================================================
# A record has `velocity` [m/s], `force` [N] and optionally `displacement` [m]; `measured` names the channels that were
# not derived. `dyno.txt` has all rules.

# ---- Limits ---------------------------------------------------------------------------------------------------------

LOWEST_SAMPLING, HIGHEST_SAMPLING = 20.0, 2e5  #: Usual sample rate of a dynamometer [Hz].
#: Smallest and largest plausible velocity [m/s], stroke [m] and force [N].
PLAUSIBLE = {"velocity": (1e-3, 10.0), "displacement": (1e-4, 0.6), "force": (1.0, 1e5)}
#: Relative difference from 4.45 of the ratio of the stated and the measured gas force, and standard errors of the
#: force at standstill from which it is used.
GAS_TOLERANCE, CLEAR = 0.15, 6.0
_LBF = convert(1.0, "lbf", "N")  #: One pound-force [N].
WEAK = 0.3  #: Minimum correlation of force and velocity.
STRONG_GAS = 1000.0  #: Force at standstill [N] that few gas springs reach: 2 MPa on a rod of 25 mm.
RECTIFIED_CORRELATION = 0.3  #: A force is rectified if its correlation with speed exceeds this in both strokes, and ...
#: ... it does not fall below minus this share of its maximum: neither its mean at a velocity, nor ...
RECTIFIED_FLOOR = 0.02
RECTIFIED_NOISE = 6.0  #: ... a value that is more than this many standard deviations of its noise below zero.
#: Number of classes of the speed of a stroke, in which a mean is taken, and the force may fall to zero and rise again.
TURN_CLASSES = 12
TURN_SAMPLES = 5  #: Smallest number of samples of a class.
SEGMENT = (1.0, 10.0)  #: Seconds that a fit uses unless others are given (3.3).
REST_SHARE = 0.03  #: Share of the range of a negative force at standstill that is reported.
FAST = 0.15  #: Speeds above this share of the peak show whether a force has a sign.


def record_faults(
    series: TimeSeries, *, measured: tuple[str, ...], conditions: DynoConditions | None = None
) -> Iterator[Fault]:
    """Yield what is implausible about the units, signs and instruments of a record."""
    if rectified := rectified_force(series):
        yield fault("rectified force", "the force is rectified", rectified)
        return
    suspicious = list(_unit_faults(series, measured))
    yield from suspicious
    yield from _rest_faults(series, conditions or DynoConditions())
    yield from motion_faults(series, measured)
    if not suspicious:
        yield from _spectrum_faults(series, measured)
        yield from lag_faults(series)
    if (correlation := _correlation(series["force"], series["velocity"])) < WEAK:
        figure = f"their correlation is {correlation:.2f}"
        yield fault("force without velocity", "force and velocity are hardly related", figure)


def part_faults(series: TimeSeries, *, measured: tuple[str, ...], until: float = SEGMENT[1]) -> Iterator[Fault]:
    """Yield what is wrong in the samples of a record or a run of it, and what changed during it."""
    yield from _sample_faults(series, measured)
    stop = run_down(series.time, path_of(series), series["velocity"])
    steady = series if stop is None else series.window(float(series.time[0]), stop)
    if not rectified_force(series):
        changed = list(setting_faults(steady))
        yield from changed or _drift_faults(steady, measured)
    if stop is not None and stop - series.time[0] < until:
        figure = f"from {stop:.4g} s to {series.time[-1]:.4g} s the motion runs down"
        remedy = f"fit the part before it: --set segment='0 s, {stop - series.time[0]:.4g} s'"
        yield fault("run-down of the machine", "the machine stops within the record", figure, remedy)


def _unit_faults(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[Fault]:
    rate = series.sample_rate
    if not LOWEST_SAMPLING <= rate <= HIGHEST_SAMPLING:
        hint = "time is probably in ms but labelled s" if rate < LOWEST_SAMPLING else "time is probably in s or min"
        figure = (
            f"{rate:.4g} samples per second over {series.duration:.4g} s; usual are {LOWEST_SAMPLING:g} to "
            f"{HIGHEST_SAMPLING:g} Hz: {hint}"
        )
        yield fault("unlikely units", "the sample rate is not that of a dynamometer", figure)
        return
    for name, (low, high) in PLAUSIBLE.items():
        if name in measured:
            values = series[name]
            largest = float(np.ptp(values) if name == "displacement" else np.abs(values).max())
            if not low <= largest <= high:
                figure = f"it reaches {largest:.4g} (SI); plausible are {low:g} to {high:g}"
                yield fault("unlikely units", f"the unit of the {name} is probably wrong", figure)


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


def _rest_faults(series: TimeSeries, conditions: DynoConditions) -> Iterator[Fault]:
    """Yield a fault if the force at standstill is not that of a gas, or not the stated one in its unit."""
    velocity, force = series["velocity"], series["force"]
    if (found := rest_force(velocity, force)) is None:
        return
    (rest, error), span = found, float(np.ptp(force))
    share = f"{rest:.4g} N at standstill, {100.0 * rest / span:.2g} % of the force's range"
    if rest < -0.5 * REST_SHARE * span and explained(series)[1] < -REST_SHARE * span:  # not a lag of a stiff rebound
        what = "the force at standstill is negative, although gas pushes"
        yield fault("negative force at standstill", what, share)
    if rest > max(0.5 * span, STRONG_GAS):
        yield fault("large force at standstill", "the force at standstill is large", share)
    stated = conditions.gas_force
    if stated and stated > 0.0 and rest > CLEAR * error:
        for factor, hint in ((_LBF, "lbf labelled N"), (1.0 / _LBF, "N labelled lbf")):
            if abs(stated / rest / factor - 1.0) < GAS_TOLERANCE:
                figure = f"{rest:.4g} N at standstill, but the stated gas force is {stated:.4g} N: {hint}"
                yield fault("contradictory units", "the unit of the force is wrong", figure)


# ==== Faults in the samples: jumps, clipping, repeated samples =======================================================

#: A change between two samples is a jump if it exceeds this share of the range (a position cannot jump), and ...
JUMP_SHARE = {"velocity": 0.2, "displacement": 0.03, "force": 0.2}
JUMP_FACTOR, AROUND = 10.0, 21  #: ... this multiple of the median change in so many samples around it.
REPEATED_SHARE = 0.02  #: Share of repeated samples.


def _sample_faults(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[Fault]:
    """Yield the faults in the samples of a record or a run."""
    moving = tuple(name for name in ("velocity", "displacement", "force") if name in measured)
    for name in moving:
        if figure := _jump(name, series):
            yield fault("jump of a channel", f"the {name} jumps", figure)
    yield from clipping_faults(series, moving)
    yield from _repeated(series, moving)


def _jump(name: str, series: TimeSeries) -> str:
    """Return a figure if a channel jumps between two samples: spikes, drop-outs, joined records, lost samples.

    Velocity (at the corners of a triangle) and force (dry friction) may step to another level and stay there.
    """
    values, limit = series[name], JUMP_SHARE[name] * float(np.ptp(series[name]))
    change = np.abs(np.diff(values))
    usual = np.maximum(median_filter(change, size=AROUND, mode="nearest"), white_noise(values))
    bad = [
        int(i)
        for i in np.flatnonzero((change > limit) & (change > JUMP_FACTOR * usual))
        if name == "displacement" or _returns(values, int(i))
    ]
    if not bad:
        return ""
    places = f", {len(bad)} such places" if len(bad) > 1 else ""
    return f"by {change[bad[0]]:.4g} {'N' if name == 'force' else 'SI'} at {series.time[bad[0] + 1]:.4g} s{places}"


def _returns(values: Array, i: int) -> bool:
    """Return whether values (N,) do not stay at the level to which they jump after sample `i`."""
    change = np.median(values[i + 1 : i + 8]) - np.median(values[max(0, i - 6) : i + 1])
    return bool(abs(change) < 0.5 * abs(values[i + 1] - values[i]))


def _repeated(series: TimeSeries, names: tuple[str, ...]) -> Iterator[Fault]:
    """Yield a fault if samples repeat the one before while the shock moves."""
    rows, speed = series.select(names).values, np.abs(series["velocity"])
    same = (np.diff(rows, axis=1) == 0.0).all(axis=0) & (speed[1:] > 0.1 * speed.max())
    if np.count_nonzero(same) > REPEATED_SHARE * same.size:
        first = series.time[int(np.argmax(same)) + 1]
        figure = f"{np.count_nonzero(same)} of {same.size + 1} samples, the first at {first:.4g} s"
        yield fault("repeated samples", "samples repeat the one before", figure)


# ==== What the spectrum of a channel shows of its instrument: hum of the mains, and a moving average =================
# A moving average over T removes the frequencies k / T, of noise and of harmonics alike, so that its spectrum has lobes
# between them. Neither the lag of a shock nor a filter with poles leaves such gaps.

#: Frequencies of the mains [Hz], their tolerance, and the range around them in which nothing else is as large [Hz].
MAINS, TOLERANCE, AROUND_MAINS = (50.0, 60.0), 0.3, 12.0
#: Smallest amplitude of hum as a share of the channel's range, and as a multiple of anything around it.
HUM_SHARE, HUM_RATIO = 2e-3, 4.0
LOWEST_HUM = 8.0  #: Lowest frequency at which hum is looked for, because the motion is below [Hz].
#: Durations of a moving average that are looked for [s], and smallest depth of its gaps (logarithm of power).
AVERAGES, DEPTH = (0.01, 0.12), 2.0
#: Number of durations that are tried, and of gaps that are examined: 1 % of error shifts the last one by 8 %.
CANDIDATES, GAPS = 250, 8
#: Length of the segments of the spectrum in periods of the motion, and smallest one [s].
PERIODS, SHORTEST_SEGMENT = 10.0, 4.0
#: Smallest distance of the gaps in frequencies of the motion: the harmonics of a sine leave narrower ones as well.
NARROWEST = 4.0
#: Half width of a gap or of the top of a lobe, as a share of their distance; quantile that is noise between harmonics.
WIDTH, FLOOR = 0.1, 0.25


def _spectrum_faults(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[Fault]:
    """Yield a fault for each channel with hum, and for a force that is a moving average."""
    force, velocity, rate = series["force"], series["velocity"], series.sample_rate
    for name in ("force", "velocity", "displacement"):
        figure = _hum(series[name], rate) if name in measured else ""
        if name == "force" and not figure:  # without harmonics of the motion
            figure = _hum(force - explained(series)[0], rate, float(np.ptp(force)))
        if figure:
            yield fault("hum", f"the {name} has hum", figure)
    frequency = float(velocity.std() / displacement_of(series).std()) / (2.0 * np.pi)
    if seconds := _average(force, rate, frequency):
        figure = f"a moving average over about {1e3 * seconds:.3g} ms"
        yield fault("smoothed force", "the force is smoothed", figure)


def _hum(values: Array, rate: float, span: float = 0.0) -> str:
    """Return a figure if `values` (N,) have a line at the frequency of the mains or its alias; empty otherwise."""
    window = np.hanning(values.size)
    size = 2.0 * np.abs(np.fft.rfft(window * (values - values.mean()))) / window.sum()
    frequency = np.fft.rfftfreq(values.size, 1.0 / rate)
    step = float(frequency[1])
    for mains in MAINS:
        seen = abs(mains - rate * round(mains / rate))
        if not LOWEST_HUM < seen < 0.48 * rate:
            continue
        distance = np.abs(frequency - seen)
        line = distance <= max(TOLERANCE, 2.0 * step)
        near = (distance <= AROUND_MAINS) & (distance > max(3.0 * TOLERANCE, 6.0 * step))
        amplitude, share = float(size[line].max()), float(size[line].max()) / (span or float(np.ptp(values)))
        if share >= HUM_SHARE and amplitude >= HUM_RATIO * float(size[near].max(initial=0.0)):
            alias = "" if seen == mains else f" (seen at {seen:.3g} Hz)"
            return f"{100.0 * share:.2g} % of its range at {mains:.0f} Hz{alias}"
    return ""


def _average(values: Array, rate: float, motion: float) -> float:
    """Return the duration [s] of a moving average that made `values` (N,) of a motion [Hz]; 0 if none did."""
    if values.size * motion < PERIODS * rate:  # the ends of a short record leave lobes
        return 0.0
    count = min(values.size - 1, round(max(SHORTEST_SEGMENT, PERIODS / motion) * rate))
    level = _level(np.diff(values), count)
    best, found = DEPTH, 0.0
    shortest, longest = max(3.0, AVERAGES[0] * rate), AVERAGES[1] * rate
    for samples in np.unique(np.round(np.geomspace(shortest, longest, CANDIDATES))).astype(int).tolist():
        depth = _depth(level, count / samples)
        if depth > best and rate / samples > NARROWEST * motion:
            best, found = depth, samples / rate
    return found


def _level(values: Array, count: int) -> Array:
    """Return the logarithm of the mean power of half overlapping segments of `count` of the values, in any unit."""
    segments = np.lib.stride_tricks.sliding_window_view(values, count)[:: count - count // 2]
    window = np.sin(np.pi * np.arange(count) / count) ** 2
    spectra = np.fft.rfft((segments - segments.mean(axis=1, keepdims=True)) * window)
    return np.asarray(np.log(np.maximum(np.mean(np.abs(spectra) ** 2, axis=0), 1e-300)))


def _depth(level: Array, spacing: float) -> float:
    """Return the median depth of the gaps in a spectrum (N,) at the multiples of a frequency [steps]."""
    half = max(WIDTH * spacing, 1.0)

    def floor(place: float) -> float:
        """Return the noise of the spectrum around a multiple of the frequency."""
        part = level[int(np.ceil(place * spacing - half)) : int(place * spacing + half) + 1]
        return float(np.sort(part)[int(FLOOR * part.size)])

    last = (level.size - 1 - half) / spacing
    depths = [
        np.mean([floor(place) for place in (k - 0.5, k + 0.5) if place <= last]) - floor(k)
        for k in range(1, min(GAPS, int(last)) + 1)
    ]
    return float(np.median(depths)) if len(depths) > 1 else 0.0
