"""Channel names that shock dynamometers use."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from eightpost.errors import FileFormatError
from eightpost.signals.channel_map import TIME_NAMES, ChannelMap, MappedChannel
from eightpost.units import compatible, is_unit

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord

#: SI unit of each channel of a dynamometer test.
DYNO_UNITS = {"velocity": "m/s", "force": "N", "displacement": "m", "temperature": "K"}

#: Column names by channel, in lower case and reduced to letters. Files use `F` and `T` in upper and lower case.
_ALIASES = {
    "time": set(TIME_NAMES),
    "velocity": {"velocity", "vel", "v", "shockvelocity", "shaftvelocity", "dampervelocity", "speed"},
    "force": {"force", "f", "load", "loadcell", "shockforce", "damperforce"},
    "displacement": {
        "displacement", "disp", "x", "position", "pos", "travel", "stroke", "shocktravel",
    },
    "temperature": {"temperature", "temp", "t", "shocktemperature", "bodytemperature", "tempc", "tempf"},
}  # fmt: skip


def dyno_map(record: RawRecord, channel_map: ChannelMap | None = None) -> ChannelMap:
    """Return the channel map of a dynamometer record: the given map, completed by columns with usual names.

    A column named `T` is the temperature, unless it is the only column that can be the time.

    Raises:
        FileFormatError: Two columns have usual names of the same channel.
    """
    given = channel_map or ChannelMap()
    taken = {pick.source for pick in given.channels.values()} | ({given.time.source} if given.time else set())
    time = given.time or _alias(record, "time", taken)
    taken |= {time.source} if time else set()
    found = {name: _alias(record, name, taken) for name in DYNO_UNITS if name not in given.channels}
    channels = {name: pick for name, pick in found.items() if pick} | dict(given.channels)
    return ChannelMap(channels, time, given.path)


def _alias(record: RawRecord, channel: str, taken: set[str]) -> MappedChannel | None:
    """Return the column that has a usual name of `channel`, or None."""
    matches = [name for name in record.names if name not in taken and _plain(name) in _ALIASES[channel]]
    if channel == "time":
        matches = [name for name in matches if name != "T" or (len(matches) == 1 and not _is_heat(record, name))]
    if len(matches) > 1:
        what = f"{' and '.join(map(repr, matches))} could both be this channel; select one with a channel map"
        raise record.origin.header_fault(FileFormatError, what, channel=channel)
    return MappedChannel(matches[0]) if matches else None


def _is_heat(record: RawRecord, name: str) -> bool:
    """Return whether a column has a temperature unit."""
    unit = record.units[record.names.index(name)]
    return unit is not None and is_unit(unit) and compatible(unit, "K")


def _plain(name: str) -> str:
    return re.sub(r"[^a-z]", "", name.lower())
