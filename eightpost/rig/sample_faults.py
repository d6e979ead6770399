"""Faults in the samples of a dynamometer record: jumps, clipping, repeated samples."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import median_filter

from eightpost.array_types import Array
from eightpost.rig.plausibility_rules import HELD, JUMP, REPEATED
from eightpost.signals.faults import clipped_samples
from eightpost.signals.filters import white_noise
from eightpost.signals.timeseries import TimeSeries
from eightpost.verdict import Reason

#: A change between two samples is a jump if it exceeds this share of the range (a position cannot jump), and ...
JUMP_SHARE = {"velocity": 0.2, "displacement": 0.03, "force": 0.2}
#: ... this multiple of the median change in so many samples around it.
JUMP_FACTOR, AROUND = 10.0, 21
#: Share of repeated samples.
REPEATED_SHARE = 0.02
#: Range of the force, as a share of that of the record, in samples in which a clipped displacement stays constant.
FORCE_MOVES = 0.2


def sample_reasons(series: TimeSeries, measured: tuple[str, ...], origin: str) -> Iterator[Reason]:
    """Yield the faults in the samples of a record or a run.

    Args:
        series: Record or run with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
        measured: Names of the channels that were measured, not derived.
        origin: Name of the record.
    """
    moving = tuple(name for name in ("velocity", "displacement", "force") if name in measured)
    for name in moving:
        if figure := _jump(name, series):
            yield JUMP.reason(f"the {name} jumps", figure=figure, origin=origin)
    if "displacement" in moving and (figure := _held(series)):
        yield HELD.reason("the displacement is clipped", figure=figure, origin=origin)
    yield from _repeated(series, moving, origin)


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


def _held(series: TimeSeries) -> str:
    """Return a figure if the displacement stays at its maximum or minimum while the force moves."""
    values, force = series["displacement"], series["force"]
    for signed in (values, -values):
        samples = clipped_samples(signed, np.ones(values.size, dtype=bool))
        if samples.size and np.ptp(np.quantile(force[samples], [0.1, 0.9])) > FORCE_MOVES * np.ptp(force):
            return (
                f"{samples.size} of {values.size} samples are equal to {1e3 * values[samples[0]]:.4g} mm while the "
                f"force moves, the first at {series.time[samples[0]]:.4g} s"
            )
    return ""


def _repeated(series: TimeSeries, names: tuple[str, ...], origin: str) -> Iterator[Reason]:
    """Yield a reason if samples repeat the one before while the shock moves."""
    rows, speed = series.select(names).values, np.abs(series["velocity"])
    same = (np.diff(rows, axis=1) == 0.0).all(axis=0) & (speed[1:] > 0.1 * speed.max())
    if np.count_nonzero(same) > REPEATED_SHARE * same.size:
        first = series.time[int(np.argmax(same)) + 1]
        figure = f"{np.count_nonzero(same)} of {same.size + 1} samples, the first at {first:.4g} s"
        yield REPEATED.reason("samples repeat the one before", figure=figure, origin=origin)
