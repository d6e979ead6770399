"""Whether the force of a record, at the same motion, drifts from its start to its end; the force at standstill."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.rig.motion_channels import slopes
from eightpost.rig.one_setting import cycle_blocks
from eightpost.rig.plausibility_rules import DRIFT
from eightpost.signals.filters import lowpass
from eightpost.signals.timeseries import TimeSeries
from eightpost.verdict import Reason

#: Number of knots of the curve over velocity, and of the effect of acceleration (a lag) over velocity.
KNOTS, LAG_KNOTS = 15, 5
#: Knots of both at these shares of the highest speed.
NEAR_ZERO = (-0.02, 0.0, 0.02)
#: Fewest blocks of cycles, and smallest size of the motion in a block relative to the median.
FEWEST_BLOCKS, FADE = 5, 0.5
#: Relative change of a gain, and change of a level relative to the range, that is reported, ...
CHANGE = 0.05
#: ... in multiples of its standard error; and range of the logarithm of a motion's size that is the same motion.
ERRORS, SAME = 6.0, 0.02
#: Change of the stroke of a sine above which it is a sweep.
SWEEP = 0.25


class Explained(NamedTuple):
    """Force that a curve over velocity, gas and a lag explain (N,) [N], and the force at standstill [N]."""

    force: Array
    rest: float


def explained(series: TimeSeries) -> Explained:
    """Return the force that velocity, displacement and acceleration explain by least squares.

        F = f(v) + a g(v) + k x, with f and g linear between knots; g is the effect of a lag

    Args:
        series: Record or run with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
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
    return Explained(design @ found, float(curve[at_rest] @ found[: curve.shape[1]]))


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


def drift_reasons(series: TimeSeries, measured: tuple[str, ...], origin: str) -> Iterator[Reason]:
    """Yield a reason if the force drifts at the same motion, or the displacement beside the velocity.

    Args:
        series: Record or run with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
        measured: Names of the channels that were measured, not derived.
        origin: Name of the record.
    """
    force, model = series["force"], explained(series).force
    span = float(np.ptp(model))
    parts = _parts(cycle_blocks(series["velocity"]), series["velocity"])
    if len(parts) < FEWEST_BLOCKS:
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
            yield DRIFT.reason(f"the {name.split()[-1]} drifts", figure=figure, origin=origin)


def _gain(values: Array, reference: Array) -> float:
    """Return the factor of the variations of a reference (N,) in values (N,)."""
    varied = reference - reference.mean()
    return float(varied @ values / max(float(varied @ varied), 1e-300))


def _parts(block: NDArray[np.intp], velocity: Array) -> list[NDArray[np.intp]]:
    """Return the samples of each block of whole cycles that is not part of a fade-in or a pause."""
    parts = [np.flatnonzero(block == number) for number in range(1, int(block.max()))]
    sizes = np.array([float(velocity[part].std()) for part in parts])
    return [part for part, size in zip(parts, sizes, strict=True) if size > FADE * np.median(sizes)]


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
