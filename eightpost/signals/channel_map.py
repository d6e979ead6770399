"""Channel maps: assignment of columns to channels, with unit and sign."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eightpost.errors import FileFormatError, MissingChannelError
from eightpost.files import toml_content

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping


#: Names of a time column, in lower case.
TIME_NAMES = (
    "time", "t", "timestamp", "zeit", "elapsed time", "running time", "test time", "run time", "temps", "tempo",
    "tiempo",
)  # fmt: skip


#: Name of the channel map that applies to all rig records in its folder, if no other is given.
MAP_BESIDE = "rig_map.toml"


@dataclass(frozen=True, slots=True)
class MappedChannel:
    """A channel, computed as `gain * column + offset` in the column's unit, then converted to SI."""

    source: str  #: Name of the column, without the unit.
    unit: str | None = None  #: Unit of the column; None to use the unit in the file.
    gain: float = 1.0  #: Factor [1]; -1 changes the sign.
    offset: float = 0.0  #: Value added after the gain, in the column's unit.


@dataclass(frozen=True, slots=True)
class ChannelMap:
    """Assignment of columns to channels. Columns that no channel uses are not read.

    Example of the TOML file::

        [time]
        source = "Time"
        unit = "ms"

        [channels.force]
        source = "Load cell 2"
        unit = "lbf"
        gain = -1.0
        offset = 12.5
    """

    channels: Mapping[str, MappedChannel] = field(default_factory=dict)  #: Column of each channel, by channel name.
    time: MappedChannel | None = None  #: Time column; None to use the column with a usual name (`TIME_NAMES`).
    path: Path | None = None  #: Path of the file that the map was read from.

    @classmethod
    def read(cls, path: str | Path) -> ChannelMap:
        """Read a channel map from a TOML file.

        Raises:
            FileFormatError: The file is missing or not TOML, has an unknown key, or has a value of the wrong type.
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
        """Return the map with the opposite sign for the channels `names`; the name `none` stands for no channel.

        Raises:
            MissingChannelError: The map has no channel of a name.
        """
        channels = dict(self.channels)
        for name in names:
            if name == "none":
                continue
            if name not in channels:
                known = ", ".join(channels)
                what = f"cannot change its sign: there is no such channel; there are: {known}"
                raise MissingChannelError(what, path=self.path, channel=name)
            old = channels[name]
            channels[name] = replace(old, gain=-old.gain, offset=-old.offset)
        return replace(self, channels=channels)


def _check_keys(table: Mapping[str, Any], known: tuple[str, ...], where: str, path: Path) -> None:
    for key in table:
        if key not in known:
            name = f"{where}.{key}" if where else key
            raise FileFormatError(f"unknown key {name!r}; allowed keys: {', '.join(known)}", path=path)


def _table(entry: object, where: str, path: Path) -> dict[str, Any]:
    if not isinstance(entry, dict):
        raise FileFormatError(f"{where!r} must be a table, not {entry!r}", path=path)
    return entry


def _mapped(entry: object, where: str, path: Path) -> MappedChannel:
    table = _table(entry, where, path)
    kinds = {"source": str, "unit": str, "gain": (int, float), "offset": (int, float)}
    _check_keys(table, tuple(kinds), where, path)
    if "source" not in table:
        raise FileFormatError(f"{where!r} has no 'source'; give the name of its column", path=path)
    for key, value in table.items():
        wrong = not isinstance(value, kinds[key]) or isinstance(value, bool)  # type: ignore[arg-type]
        if wrong or (not isinstance(value, str) and not math.isfinite(value)):
            kind = "a text" if kinds[key] is str else "a finite number"
            raise FileFormatError(f"'{where}.{key}' must be {kind}, not {value!r}", path=path)
    return MappedChannel(**table)
