"""Whether a shock was at one setting throughout a dynamometer record.

The force of each cycle, at the same velocities, is compared with that of the others. One step between two levels that
nothing smooth explains, neither a drift nor a warming towards a constant value, is a change of the shock. Low
speeds are examined by themselves, because a bleed acts there, and its force is small.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.rig.plausibility_rules import SMALL_CHANGE, TWO_SETTINGS
from eightpost.rig.rest_force import rest_force
from eightpost.signals.timeseries import TimeSeries
from eightpost.verdict import Reason

#: Maximum and minimum number of blocks of a record.
BLOCKS, FEWEST_BLOCKS = 20, 5
#: Number of classes of velocity.
CLASSES = 15
#: Bands of speed that are examined, as shares of the peak, and what a figure calls them.
BANDS = {"": (0.15, 1.0), " at low speed": (0.04, 0.3), " at high speed": (0.6, 1.0)}
#: Speeds above this share of the peak separate the strokes of a cycle.
MOVING = 0.15
#: Step of the force between two parts of a record that is reported, and that makes it not usable, ...
STEP, LARGE_STEP = 0.03, 0.08
#: ... in multiples of the scatter within these parts, ...
STEP_SCATTER = 6.0
#: ... and maximum share of the scatter about a smooth course that the scatter about a step may have.
STEP_SHARE = 0.3
#: Time constants of a smooth course, as shares of the record; in addition to a straight drift.
SETTLING = (0.05, 0.1, 0.2, 0.4, 0.8)
#: Ratio of the sizes of the motion before and after a step above which the motion changed, and the shock perhaps did
#: not: the force at a velocity depends on frequency and stroke.
MOTION = 1.3
#: Size of the velocity, relative to its median over all cycles, below which a cycle is part of a fade-in.
FADE = 0.5
#: Smallest number of other cycles on each side of a step.
FEWEST_MOVING = 2
#: Minimum share of the record on each side of a step: a shock that cavitates needs some cycles to reach its state.
FEWEST_SHARE = 0.15


def setting_reasons(series: TimeSeries, origin: str) -> Iterator[Reason]:
    """Yield a reason for each stroke in which the force at the same velocity steps during the record.

    Args:
        series: Record or run with `velocity` [m/s] and `force` [N].
        origin: Name of the record.
    """
    velocity, force = series["velocity"], series["force"]
    block = cycle_blocks(velocity)
    count = int(block.max()) + 1
    rest = rest_force(velocity, force)
    if count < FEWEST_BLOCKS or rest is None:
        return
    phase = _phase(series)
    for side, sign in (("compression", 1.0), ("rebound", -1.0)):
        speed, stroke_force = sign * velocity / float(np.abs(velocity).max()), sign * (force - rest[0])
        found = []
        for where, (low, high) in BANDS.items():
            chosen = (speed > low) & (speed <= high)
            if np.count_nonzero(chosen) < CLASSES * FEWEST_BLOCKS:
                continue
            sizes = _block_sizes(speed[chosen], stroke_force[chosen], phase[:, chosen], block[chosen], count)
            step = _step_of(sizes)
            if step and _has_one_motion(phase, velocity, block, step.block):
                found.append((step, where))
        if found:
            step, where = max(found, key=lambda one: abs(one[0].change))
            at = float(series.time[np.argmax(block == step.block)])
            figure = f"{side} force {100.0 * step.change:+.0f} % at the same velocity{where} from about {at:.4g} s on"
            rule = TWO_SETTINGS if abs(step.change) >= LARGE_STEP else SMALL_CHANGE
            yield rule.reason("the shock changed during the record", figure=figure, origin=origin)


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


def cycle_blocks(velocity: Array) -> NDArray[np.intp]:
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


class _Step(NamedTuple):
    """A step: number of the first block after it, relative change [1]."""

    block: int
    change: float


def _step_of(sizes: Array) -> _Step | None:
    """Return the step of a sequence (K,), if it is one step and not a drift or scatter."""
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
    return _Step(int(places[split]), float(change))


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
