"""Columns of a dynamometer file beside those that are read, such as a setting that changes; units of two systems."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.rig.plausibility import MixedUnits
from eightpost.rig.plausibility_rules import CHANGED_COLUMN
from eightpost.signals.column_headers import letters_of
from eightpost.units import compatible, is_unit

if TYPE_CHECKING:
    from eightpost.signals.channel_map import ChannelMap
    from eightpost.signals.raw_record import RawRecord
    from eightpost.signals.timeseries import TimeSeries
    from eightpost.verdict import Reason

# ---- Units of two systems -------------------------------------------------------------------------------------------

_US = {"m": ("in", "ft"), "m/s": ("in/s", "ft/s"), "N": ("lbf", "kip")}
_SI = {"m": "m", "displacement": "m", "velocity": "m/s", "force": "N"}


def mixed_units(record: RawRecord, mapping: ChannelMap, given: Mapping[str, str]) -> MixedUnits:
    """Return the units of motion and force if one is metric and the other US customary; empty texts otherwise."""
    units = {}
    for name in ("displacement", "velocity", "force"):
        if name in mapping.channels:
            pick = mapping.channels[name]
            stated = record.units[record.names.index(pick.source)] if pick.source in record.names else None
            units[name] = pick.unit or given.get(name) or given.get(pick.source) or stated or ""
    motion = [name for name in ("displacement", "velocity") if units.get(name)]
    customary = {name: _is_customary(units[name], _SI[name]) for name in units}
    if not motion or not units.get("force") or any(customary[name] == customary["force"] for name in motion):
        return MixedUnits()
    return MixedUnits(" and ".join(units[name] for name in motion), units["force"])


def _is_customary(unit: str, si: str) -> bool:
    from eightpost.units import conversion  # noqa: PLC0415

    if not (is_unit(unit) and compatible(unit, si)):
        return False
    return any(abs(conversion(unit, known)[0] - 1.0) < 1e-9 for known in _US[si])


# ---- A column that changes during the run ---------------------------------------------------------------------------

#: Columns that count or describe samples and not the shock, in lower case and reduced to letters.
_COUNTERS = (
    "index", "sample", "count", "cycle", "point", "row", "number", "date", "clock", "time", "step", "stroke", "scan",
    "direction", "id", "phase", "event", "events",
)  # fmt: skip
#: Units of measured motion, force and temperature: such a column is another sensor, not a setting.
_MEASURED = ("m", "m/s", "m/s2", "N", "K", "s", "rad", "Hz", "Pa", "N.m", "W", "J")
#: Number of parts of a record, minimum relative change, and minimum share of the variance between the parts.
PARTS, CHANGE, BETWEEN = 24, 0.02, 0.8


def column_reasons(record: RawRecord, mapping: ChannelMap, series: TimeSeries, origin: str) -> Iterator[Reason]:
    """Yield a reason for each column that is not read and changes from one part of the record to the next."""
    used = {pick.source for pick in mapping.channels.values()} | ({mapping.time.source} if mapping.time else set())
    for name, unit, column in zip(record.names, record.units, record.columns, strict=True):
        if name in used or _is_sensor(name, unit) or column.size != series.time.size:
            continue
        figure = _text_change(column, series.time) if column.dtype == object else _change(column, series.time)
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


def _change(column: Array, time: Array) -> str:
    """Return a figure if a column (N,) has different values in different parts of the record; empty otherwise."""
    values = np.asarray(column, dtype=np.float64)
    if not np.isfinite(values).all() or not float(np.ptp(values)) > CHANGE * float(np.abs(values).max()):
        return ""
    steps = np.diff(values)
    if (steps == steps[0]).all():  # a counter
        return ""
    parts = np.array_split(values, PARTS)
    within = float(np.sum([part.var() * part.size for part in parts])) / values.size
    # One part may contain the step itself.
    if within > (1.0 - BETWEEN) * float(values.var()):
        return ""
    means = np.array([part.mean() for part in parts])
    at = int(np.argmax(np.abs(np.diff(means)))) + 1
    where = time[min(at * values.size // PARTS, values.size - 1)]
    return f"from {means[0]:.4g} to {means[-1]:.4g}, largest change near {where:.4g} s"


def _text_change(column: NDArray[Any], time: Array) -> str:
    """Return a figure if a column of texts (N,) has two to eight values, each for a long part of the record."""
    texts = [str(cell).strip() for cell in column]
    changes = [i for i in range(1, len(texts)) if texts[i] != texts[i - 1]]
    if not 1 <= len(changes) <= 8 or len(set(texts)) > 8:
        return ""
    return f"from {texts[0]!r} to {texts[changes[0]]!r} at {time[changes[0]]:.4g} s"
