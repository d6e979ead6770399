"""Columns of a dynamometer file that must not prevent reading it: the temperature, and further columns of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import DataError, FileFormatError
from eightpost.signals.channel_map import ChannelMap
from eightpost.signals.raw_record import letters_of
from eightpost.units import compatible, convert, is_unit

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord

#: Minimum number of temperatures in a column with empty cells.
FEWEST = 10

#: Largest difference of two columns of time that are the same, in median steps.
SAME = 0.01


def with_optional_temperature(
    record: RawRecord, mapping: ChannelMap, given: ChannelMap | None, units: Mapping[str, str]
) -> tuple[RawRecord, ChannelMap, tuple[str, ...]]:
    """Return a record and a channel map whose temperature can be read, and a note if it was changed or left out.

    Empty cells between temperatures are interpolated: it is often logged more slowly than the force. A column that is
    not needed is left out if it cannot be read, unless it was named by the caller.

    Args:
        record: Columns of the file.
        mapping: Columns of the channels.
        given: Channel map of the caller.
        units: Units of the caller, by channel or column.
    """
    pick = mapping.channels.get("temperature")
    if pick is None or (given is not None and "temperature" in given.channels) or pick.source not in record.names:
        return record, mapping, ()
    place = record.names.index(pick.source)
    without = replace(mapping, channels={n: p for n, p in mapping.channels.items() if n != "temperature"})
    unit = record.units[place]
    if unit is None and not {"temperature", pick.source} & set(units):
        return record, without, (f"the column {pick.source!r} was not read: it has no unit",)
    try:
        values = record.numbers(place, channel="temperature")
    except DataError:
        return record, without, (f"the column {pick.source!r} was not read: it contains words",)
    known = np.isfinite(values)
    if known.all():
        return record, mapping, ()
    if np.count_nonzero(known) < FEWEST:
        return record, without, (f"the column {pick.source!r} was not read: {np.count_nonzero(known)} numbers",)
    rows = np.arange(values.size)
    filled = np.interp(rows, rows[known], values[known])
    columns = (*record.columns[:place], filled, *record.columns[place + 1 :])
    return replace(record, columns=columns), mapping, ()


def check_one_time(record: RawRecord, mapping: ChannelMap, given: ChannelMap | None) -> None:
    """Raise a FileFormatError if a channel stands behind a column of time that differs from the one that is read.

    Tables side by side, and channels with a time of their own, repeat the column of time. It applies to the columns
    behind it, up to the next one. A column of time that the caller named is not questioned.

    Args:
        record: Columns of the file.
        mapping: Columns of the channels.
        given: Channel map of the caller.
    """
    is_named = given is not None and given.time is not None
    if is_named or mapping.time is None or mapping.time.source not in record.names:
        return
    used = record.names.index(mapping.time.source)
    name = _bare(mapping.time.source)
    times = [i for i, one in enumerate(record.names) if _bare(one) == name and _is_time(record.units[i])]
    for channel, pick in mapping.channels.items():
        place = record.names.index(pick.source) if pick.source in record.names else -1
        own = max((i for i in times if i < place), default=used)
        if own != used and not _is_same(record, used, own):
            what = (
                f"the column {pick.source!r} stands behind the time {record.names[own]!r}, which differs from "
                f"{record.names[used]!r}; export the channels with one time, or delete the other table"
            )
            raise record.origin.header_fault(FileFormatError, what, channel=channel)


def _bare(name: str) -> str:
    """Return a name without case, number and marks: `t (2)` and `T` are `t`."""
    return letters_of(name) or name


def _is_time(unit: str | None) -> bool:
    return unit is None or (is_unit(unit) and compatible(unit, "s"))


def _is_same(record: RawRecord, first: int, second: int) -> bool:
    try:
        values = [_seconds(record, place) for place in (first, second)]
    except DataError:
        return False
    step = float(np.median(np.abs(np.diff(values[0])))) if values[0].size > 1 else 0.0
    return bool(np.abs(values[0] - values[1]).max(initial=0.0) <= SAME * step)  # False if there is a NaN


def _seconds(record: RawRecord, place: int) -> Array:
    unit = record.units[place]
    values = record.numbers(place, channel="time")
    return convert(values, unit, "s") if unit is not None else values
