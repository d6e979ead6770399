"""Whether a shock stayed the same throughout a record: its force at standstill, one setting, no drift."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.checks.dyno import fault
from eightpost.checks.fault import Fault
from eightpost.rig.motion import slopes
from eightpost.signals.filters import lowpass
from eightpost.signals.timeseries import TimeSeries

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


def drift_faults(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[Fault]:
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
