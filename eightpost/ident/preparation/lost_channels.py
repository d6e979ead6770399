"""Check for channels that fail during a record, because a cable breaks or a logger repeats its last value."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ConstantChannelError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries

    Array = NDArray[np.float64]

#: Time for which a failed channel repeats one value [s] ...
HELD = 0.25
#: ... and fraction of its samples in which another channel changes if it moves [1].
MOVING = 0.5

_RESPONSES = ("tire_force", "displacement", "force", "hub_acceleration", "chassis_acceleration")


def check_lost_channels(series: TimeSeries, corners: Sequence[str], *, path: Path | None = None) -> None:
    """Check that no channel becomes constant while the others move.

    Args:
        series: Rig record.
        corners: Names of its corners; one empty name for a quarter car.
        path: Path of its file, for messages.

    Raises:
        ConstantChannelError: A channel becomes constant.
    """
    names = [f"{c}.{q}" if c else q for q in _RESPONSES for c in corners]
    there = [name for name in names if name in series]
    for name in there:
        start, stop = _longest_hold(series[name])
        span = (stop - start) / series.sample_rate
        if span < HELD or not _others_move(series, there, name, slice(start, stop)):
            continue
        where = f"from {series.time[start]:.4g} s to {series.time[stop]:.4g} s"
        what = (
            f"it stays at {series[name][start]:.6g} (SI) {where} ({span:.3g} s) while the other channels move: a cable "
            "or a logger failed there; remove that part of the record, or remove the channel from the map"
        )
        raise ConstantChannelError(what, path=path, channel=name)


def _longest_hold(values: Array) -> tuple[int, int]:
    """Return the first and the last sample of the longest run of one value."""
    edges = np.flatnonzero(np.diff(values) != 0.0) + 1
    bounds = np.concatenate(([0], edges, [values.size]))
    longest = int(np.argmax(np.diff(bounds)))
    return int(bounds[longest]), int(bounds[longest + 1]) - 1


def _others_move(series: TimeSeries, names: Sequence[str], own: str, held: slice) -> bool:
    """Return whether most of the other channels change in most samples of a span; a resting rig moves none."""
    moving = [np.mean(np.diff(series[name][held]) != 0.0) > MOVING for name in names if name != own]
    return bool(moving) and float(np.mean(moving)) > 0.5
