"""Channels of a file that were sampled at different times: one table for each axis of time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.units import compatible, is_unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.confined.readers import Signal


def by_time(signals: Sequence[Signal]) -> list[list[Signal]]:
    """Return the channels of each axis of time, those of the axis with most channels first, then long ones."""
    tables: dict[bytes, list[Signal]] = {}
    for signal in signals:
        tables.setdefault(signal.times.tobytes(), []).append(signal)
    return sorted(tables.values(), key=lambda table: (len(table), table[0].times.size), reverse=True)


#: Largest range of the deviations of even times that were rounded to whole units, in units.
_ROUNDED = 1.1


def spread_evenly(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return times (N,) that were rounded to whole units, as an even series; other times are unchanged.

    The step must be at least one unit. Rounding moves an even series by less than one unit; a missing sample by more.
    """
    steps = np.diff(times)
    if not steps.size or not np.ptp(steps) or (times != np.round(times)).any() or not np.median(steps) >= 1.0:
        return times
    places = np.arange(times.size)
    even = np.asarray(np.polyval(np.polyfit(places, times, 1), places), dtype=np.float64)
    return even if np.ptp(even - times) <= _ROUNDED else times


def temperatures_at(times: NDArray[np.float64], tables: Sequence[Sequence[Signal]]) -> list[Signal]:
    """Return the temperatures of tables, interpolated at other times; beyond their own times they are constant.

    Args:
        times: Times (N,) [s].
        tables: Channels at other times.
    """
    warm = [signal for table in tables for signal in table if is_unit(signal.unit) and compatible(signal.unit, "K")]
    return [
        signal._replace(samples=np.interp(times, signal.times, signal.samples), times=times)
        for signal in warm
        if signal.times.size
    ]
