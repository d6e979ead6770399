"""Channel maps: which column is which channel, in which unit and with which sign."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eightpost.errors import FileFormatError, MissingChannelError
from eightpost.files import toml_content

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from eightpost.signals.raw_record import RawRecord

#: What a time column is called, in lower case.
TIME_NAMES = ("time", "t", "timestamp", "zeit")


@dataclass(frozen=True, slots=True)
class MappedChannel:
    """One channel: `gain * column + offset`, in the column's unit, then converted to SI.

    Attributes:
        source: The column's name (its unit stripped).
        unit: The column's unit; None takes the file's.
        gain: Factor [1]; -1 turns the sign.
        offset: Added after the gain, in the column's unit.
    """

    source: str
    unit: str | None = None
    gain: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class ChannelMap:
    """Which column is which channel. Columns that no channel names are not read.

    As a TOML file::

        [time]
        source = "Time"
        unit = "ms"

        [channels.force]
        source = "Load cell 2"
        unit = "lbf"
        gain = -1.0
        offset = 12.5

    Attributes:
        channels: Channel name to its column.
        time: The time column; None takes the column that is called time or t.
        path: The file the map was read from.
    """

    channels: Mapping[str, MappedChannel] = field(default_factory=dict)
    time: MappedChannel | None = None
    path: Path | None = None

    @classmethod
    def read(cls, path: str | Path) -> ChannelMap:
        """Read a channel map from a TOML file.

        Raises:
            FileFormatError: No such file, not TOML, an unknown key, or a value of the wrong kind.
        """
        path = Path(path)
        tables = toml_content(path)
        _check_keys(tables, ("channels", "time"), "", path)
        channels = _table(tables.get("channels", {}), "channels", path)
        if "time" in channels:
            raise FileFormatError("'channels.time' must be the table 'time'", path=path)
        mapped = {name: _mapped(entry, f"channels.{name}", path) for name, entry in channels.items()}
        time = _mapped(tables["time"], "time", path) if "time" in tables else None
        return cls(mapped, time, path)

    def flipped(self, names: Iterable[str]) -> ChannelMap:
        """Return the map with the sign of the channels `names` turned."""
        channels = dict(self.channels)
        for name in names:
            if name not in channels:
                known = ", ".join(channels)
                what = f"cannot turn its sign: no such channel; there are: {known}"
                raise MissingChannelError(what, path=self.path, channel=name)
            old = channels[name]
            channels[name] = replace(old, gain=-old.gain, offset=-old.offset)
        return replace(self, channels=channels)


def _check_keys(table: Mapping[str, Any], known: tuple[str, ...], where: str, path: Path) -> None:
    for key in table:
        if key not in known:
            name = f"{where}.{key}" if where else key
            raise FileFormatError(f"unknown key {name!r}; known here: {', '.join(known)}", path=path)


def _table(entry: object, where: str, path: Path) -> dict[str, Any]:
    if not isinstance(entry, dict):
        raise FileFormatError(f"{where!r} must be a table, not {entry!r}", path=path)
    return entry


def _mapped(entry: object, where: str, path: Path) -> MappedChannel:
    table = _table(entry, where, path)
    kinds = {"source": str, "unit": str, "gain": (int, float), "offset": (int, float)}
    _check_keys(table, tuple(kinds), where, path)
    if "source" not in table:
        raise FileFormatError(f"{where!r} has no 'source', the column that it is read from", path=path)
    for key, value in table.items():
        wrong = not isinstance(value, kinds[key]) or isinstance(value, bool)  # type: ignore[arg-type]
        if wrong or (not isinstance(value, str) and not math.isfinite(value)):
            raise FileFormatError(f"'{where}.{key}' must not be {value!r}", path=path)
    return MappedChannel(**table)


def find_time(record: RawRecord) -> MappedChannel:
    """Return the column that is called time; a MissingChannelError says what there is.

    `T` is a time only when its unit is one, because it is also a temperature.
    """
    for wanted in TIME_NAMES:
        for name, unit in zip(record.names, record.units, strict=True):
            if name.lower() == wanted and (name != "T" or unit in ("s", "ms", "sec")):
                return MappedChannel(name)
    return MappedChannel(record.names[record.index("time", wanted_as="time")])


def identity_map(record: RawRecord, time: MappedChannel) -> ChannelMap:
    """Return the map under which every column but time keeps its own name."""
    return ChannelMap({name: MappedChannel(name) for name in record.names if name != time.source}, time)
