"""Columns of a dynamometer file beside those that are read, such as a setting that changes during the run."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.rig.plausibility_rules import CHANGED_COLUMN
from eightpost.signals.column_headers import letters_of
from eightpost.units import compatible, is_unit

if TYPE_CHECKING:
    from eightpost.signals.channel_map import ChannelMap
    from eightpost.signals.raw_record import RawRecord
    from eightpost.signals.timeseries import TimeSeries
    from eightpost.verdict import Reason

#: Columns that count or describe samples and not the shock, in lower case and reduced to letters.
_COUNTERS = (
    "index", "sample", "count", "cycle", "point", "row", "number", "date", "clock", "time", "step", "stroke", "scan",
    "direction", "id", "phase",
)  # fmt: skip
#: Units of measured motion, force and temperature: such a column is another sensor, not a setting.
_MEASURED = ("m", "m/s", "m/s2", "N", "K", "s", "rad", "Hz", "Pa", "N.m", "W", "J")
#: Units of a control, which may vary all the time.
_CONTROL = ("V", "A")
#: Number of parts of a record, minimum relative change, and minimum share of the variance between the parts.
PARTS, CHANGE, BETWEEN = 24, 0.02, 0.8
#: Largest share of the variance within two levels, and share of the variance that slow changes of a control have.
WITHIN, SLOW = 0.1, 0.9
#: Correlation with a channel that is read, from which a column is the same sensor; with time, that of a counter.
SAME, COUNTER = 0.9, 0.9999
#: Number of times that are named, and of values of a column of texts.
NAMED, TEXTS = 4, 8


def column_reasons(record: RawRecord, mapping: ChannelMap, series: TimeSeries, origin: str) -> Iterator[Reason]:
    """Yield a reason for each column that is not read and changes during the record."""
    used = {pick.source for pick in mapping.channels.values()} | ({mapping.time.source} if mapping.time else set())
    for name, unit, column in zip(record.names, record.units, record.columns, strict=True):
        if name in used or _is_sensor(name, unit) or column.size != series.time.size:
            continue
        is_control = bool(unit) and is_unit(unit or "") and any(compatible(unit or "", known) for known in _CONTROL)
        is_text = column.dtype == object
        figure = _text_change(column, series.time) if is_text else _change(column, series, is_control=is_control)
        if figure:
            yield CHANGED_COLUMN.reason(f"the column {name!r} changes during the run",
                                        figure=figure + (f" [{unit}]" if unit else ""), origin=origin)  # fmt: skip


def _is_sensor(name: str, unit: str | None) -> bool:
    letters = letters_of(name)
    if any(letters == word or letters.startswith(word) or letters.endswith(word) for word in _COUNTERS):
        return True
    if "temp" in letters:
        return True
    return bool(unit) and is_unit(unit or "") and any(compatible(unit or "", known) for known in _MEASURED)


def _change(column: Array, series: TimeSeries, *, is_control: bool) -> str:
    """Return a figure if a column (N,) changes its level, drifts, or (a control) varies; empty otherwise."""
    values, time = np.asarray(column, dtype=np.float64), series.time
    if not float(np.ptp(values)) > CHANGE * float(np.abs(values).max()) or _is_known(values, series):  # or NaN
        return ""
    low, high = np.quantile(values, [0.02, 0.98])
    upper = values > 0.5 * (low + high)
    changes = np.flatnonzero(np.diff(upper)) + 1
    turns = int(np.count_nonzero(np.diff(np.sign(series["velocity"]))))
    within = sum(float(values[side].var()) * np.count_nonzero(side) for side in (upper, ~upper) if side.any())
    if changes.size and within < WITHIN * values.var() * values.size and 2 * changes.size < max(turns, 4):
        return f"between {values[~upper].mean():.4g} and {values[upper].mean():.4g} at {_times(time[changes])}"
    parts = np.array_split(values, PARTS)
    means = np.array([part.mean() for part in parts])
    if np.mean([part.var() for part in parts]) <= (1.0 - BETWEEN) * values.var():
        at = int(np.argmax(np.abs(np.diff(means)))) + 1
        where = time[min(at * values.size // PARTS, values.size - 1)]
        return f"from {means[0]:.4g} to {means[-1]:.4g}, largest change near {where:.4g} s"
    if is_control and np.diff(values).var() < 2.0 * (1.0 - SLOW) * values.var():
        return f"all the time between {low:.4g} and {high:.4g}"
    return ""


def _is_known(values: Array, series: TimeSeries) -> bool:
    """Return whether values (N,) count the samples, or are those of a channel that is read in another unit."""
    if np.corrcoef(values, series.time)[0, 1] > COUNTER:
        return True
    known = [series[name] for name in ("velocity", "displacement", "force") if name in series]
    return any(abs(np.corrcoef(values, row)[0, 1]) > SAME for row in known)


def _times(times: Array) -> str:
    more = f" and {times.size - NAMED} more times" if times.size > NAMED else ""
    return ", ".join(f"{time:.4g} s" for time in times[:NAMED]) + more


def _text_change(column: NDArray[Any], time: Array) -> str:
    """Return a figure if a column of texts (N,) has two to eight values, each for a long part of the record."""
    texts = [str(cell).strip() for cell in column]
    changes = [i for i in range(1, len(texts)) if texts[i] != texts[i - 1]]
    if not 1 <= len(changes) <= TEXTS or len(set(texts)) > TEXTS:
        return ""
    return f"from {texts[0]!r} to {texts[changes[0]]!r} at {_times(time[changes])}"
