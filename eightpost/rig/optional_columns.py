"""Columns of a dynamometer file that must not prevent reading it, and further columns of time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.errors import DataError, FileFormatError
from eightpost.rig.dyno_columns import DYNO_UNITS, dyno_map, has_channels, is_command
from eightpost.rig.plausibility_rules import DEAD, LEFT_OUT
from eightpost.signals.channel_map import ChannelMap, MappedChannel
from eightpost.signals.column_headers import is_number, letters_of
from eightpost.units import compatible, convert, is_unit

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord
    from eightpost.verdict import Reason

#: Minimum number of temperatures in a column with empty cells.
FEWEST = 10

#: Largest difference of two columns of time that are the same, in median steps.
SAME = 0.01

_COMMAND = "it is a command, not a measurement"
_EMPTY, _CONSTANT = _DEAD = ("it is empty", "it is constant")


def with_readable_columns(
    record: RawRecord, given: ChannelMap | None, units: Mapping[str, str], origin: str
) -> tuple[RawRecord, ChannelMap, tuple[Reason, ...]]:
    """Return a record and a channel map without columns that cannot be read and are not needed, and reasons on them.

    A displacement is not needed beside a velocity, nor the reverse, nor one of several columns that could be a channel.
    Columns that the caller named are kept, and so is what is needed, for a message about its fault. Empty cells between
    temperatures are interpolated: it is often logged more slowly than the force.

    Args:
        record: Columns of the file.
        given: Channel map of the caller.
        units: Units of the caller, by channel or column.
        origin: Name of the record.
    """
    named = set(given.channels) if given is not None else set()
    reasons: list[Reason] = []
    while True:
        mapping = dyno_map(record, given)
        for name, pick in mapping.channels.items():
            if name in named or pick.source not in record.names:
                continue
            fault = _fault(record, name, pick, units)
            smaller = _without(record, pick.source)
            if fault and _is_complete(smaller, given, units, mapping):
                is_dead = fault in _DEAD and name != "temperature" and name not in dyno_map(smaller, given).channels
                rule = DEAD if is_dead else LEFT_OUT
                reasons.append(rule.reason(f"the column {pick.source!r} was not read", figure=fault, origin=origin))
                record = smaller
                break
        else:
            return _with_filled_temperature(record, mapping), mapping, tuple(reasons)


def _is_complete(smaller: RawRecord, given: ChannelMap | None, units: Mapping[str, str], whole: ChannelMap) -> bool:
    """Return whether a record without a column has all that is needed, and still a measured motion if there was one."""
    mapping = dyno_map(smaller, given)
    named = set(given.channels) if given is not None else set()
    readable = {
        name: pick
        for name, pick in mapping.channels.items()
        if name in named or _fault(smaller, name, pick, units) in ("", _COMMAND)
    }
    usable = replace(mapping, channels=readable)
    return has_channels(_measured(usable)) or (has_channels(usable) and not has_channels(_measured(whole)))


def _measured(mapping: ChannelMap) -> ChannelMap:
    """Return a channel map without commands."""
    channels = {name: pick for name, pick in mapping.channels.items() if not is_command(pick.source, name)}
    return replace(mapping, channels=channels)


def _fault(record: RawRecord, channel: str, pick: MappedChannel, units: Mapping[str, str]) -> str:
    """Return why a column cannot be read as a channel; empty if it can, or if its samples may be repaired."""
    if pick.source not in record.names:
        return ""  # an error names it
    place = record.names.index(pick.source)
    unit = pick.unit or units.get(channel) or units.get(pick.source) or record.units[place]
    if unit is None and channel == "force":  # the file may have the unit elsewhere: an error asks for it
        return ""
    if unit is None:
        return f"it has no unit; give it in the header or with --units {channel}=unit"
    if not (is_unit(unit) and compatible(unit, DYNO_UNITS[channel])):
        return f"its unit {unit!r} is not one of a {channel}"
    if is_command(pick.source, channel):
        return _COMMAND
    return _fault_of_samples(record.columns[place], channel)


def _fault_of_samples(column: NDArray[Any], channel: str) -> str:
    if column.dtype == object:
        is_damaged = channel == "temperature" or not any(is_number(str(cell)) for cell in column)
        return "it contains words" if is_damaged else ""
    known = column[np.isfinite(column)]
    if channel == "temperature":
        return f"{known.size} numbers" if known.size < min(FEWEST, column.size) else ""
    if not known.size:
        return _EMPTY
    if known.size == column.size and np.ptp(column) == 0.0:
        return _CONSTANT
    return "it is a magnitude, without a sign" if channel == "velocity" and known.min() >= 0.0 else ""


def _without(record: RawRecord, source: str) -> RawRecord:
    """Return a record without a column."""
    kept = [i for i, name in enumerate(record.names) if name != source]
    return replace(
        record,
        names=tuple(record.names[i] for i in kept),
        units=tuple(record.units[i] for i in kept),
        columns=tuple(record.columns[i] for i in kept),
    )


def _with_filled_temperature(record: RawRecord, mapping: ChannelMap) -> RawRecord:
    """Return a record without empty cells between its temperatures."""
    pick = mapping.channels.get("temperature")
    if pick is None or pick.source not in record.names:
        return record
    place = record.names.index(pick.source)
    values = record.columns[place]
    if values.dtype == object or not (known := np.isfinite(values)).any():
        return record
    rows = np.arange(values.size)
    filled = np.interp(rows, rows[known], values[known])
    return replace(record, columns=(*record.columns[:place], filled, *record.columns[place + 1 :]))


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
