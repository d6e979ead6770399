"""Choice of the segment of a record that is fitted (3.3: seconds 1 to 10 of the random test)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError

if TYPE_CHECKING:
    from eightpost.signals import TimeSeries

#: The dissertation's segment [s].
SEGMENT = (1.0, 10.0)

#: Length of the edges that a record's ends disturb, times the cutoff frequency [1]: the slowest pole of the 8th-order
#: Butterworth decays by exp(-2 pi 0.195 f_c t), to 0.06 % here.
FILTER_EDGE = 6.0

#: The dissertation's segment is not used if the shock's speed there stays below this share of its peak speed.
_LIVELY = 0.5


def choose_segment(
    series: TimeSeries, requested: tuple[float, float] | None, cutoff: float
) -> tuple[tuple[float, float], list[str]]:
    """Return start and stop [s] of the segment, and a sentence if it is not the dissertation's.

    Args:
        series: Record with `velocity`; time starts at 0.
        requested: Requested start and end [s], or None.
        cutoff: Cutoff frequency of the low-pass [Hz]; the filter's edges are left out.

    Raises:
        ParameterError: The requested segment is not in the record.
    """
    edge = FILTER_EDGE / cutoff
    whole = (edge, series.duration - edge)
    if requested is not None:
        return _requested(requested, series.duration, whole)
    if series.duration < SEGMENT[1]:
        return whole, [
            f"{_seconds(whole)} fitted, all but the filter's edges, because the record lasts {series.duration:.4g} s"
        ]
    velocity = np.abs(series["velocity"])
    here = velocity[(series.time >= SEGMENT[0]) & (series.time <= SEGMENT[1])].max()
    if here < _LIVELY * velocity.max():
        why = f"{100.0 * here / velocity.max():.0f} % of the record's peak speed"
        return whole, [f"{_seconds(whole)} fitted, the whole record, because seconds 1 to 10 reach only {why}"]
    return (SEGMENT[0], min(SEGMENT[1], whole[1])), []


def _requested(
    requested: tuple[float, float], duration: float, whole: tuple[float, float]
) -> tuple[tuple[float, float], list[str]]:
    start, stop = requested
    if not 0.0 <= start < stop or stop > duration * (1.0 + 1e-9):
        raise ParameterError(
            f"the segment must lie within the record, 0 to {duration:.4g} s, not from {start:g} to {stop:g} s"
        )
    used = (max(start, whole[0]), min(stop, whole[1]))
    changes = [] if requested == SEGMENT else [f"{_seconds(used)} fitted as requested, instead of 1 to 10 s"]
    return used, changes


def _seconds(segment: tuple[float, float]) -> str:
    return f"seconds {segment[0]:.4g} to {segment[1]:.4g}"
