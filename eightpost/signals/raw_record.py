"""Records as a file has them, and their channels under this library's names and units."""

from __future__ import annotations

import logging
import mmap
import re
import tempfile
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from annotated_types import Ge
from numpy.typing import NDArray
from typing_extensions import TypedDict

from eightpost.array_types import Stored
from eightpost.errors import (
    FileFormatError,
    InputError,
    MissingChannelError,
    MissingUnitError,
    NotANumberError,
    TooShortError,
    UnknownUnitError,
)
from eightpost.files import read_text
from eightpost.signals.faults import Origin, check_finite, check_time, runs
from eightpost.signals.table_text import is_number, seconds_of, split_header, times_of
from eightpost.signals.timeseries import StoredSeries, TimeSeries
from eightpost.units import SI_UNITS, compatible, conversion, convert, is_unit, note_file, si_unit

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from eightpost.array_types import Array
    from eightpost.confined.readers import Signal


# ==== Channel maps: assignment of columns to channels, with unit and sign ============================================

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

    With `bridge = 20` above the tables, at most 20 samples in a row that are NaN or empty become a straight line.
    """

    channels: Mapping[str, MappedChannel] = field(default_factory=dict)  #: Column of each channel, by channel name.
    time: MappedChannel | None = None  #: Time column; None to use the column with a usual name (`TIME_NAMES`).
    path: Path | None = None  #: Path of the file that the map was read from.
    bridge: int = 0  #: Largest number of samples in a row that are NaN or empty and are replaced by a straight line.

    @classmethod
    def read(cls, path: str | Path) -> ChannelMap:
        """Read a channel map from a TOML file.

        Raises:
            FileFormatError: The file is missing or not TOML, has an unknown key, or has a value of the wrong type.
        """
        from eightpost.toml_document import parse_model  # noqa: PLC0415 -- most records need no map

        path = Path(path)
        entries = parse_model(_Entries, read_text(path), path)
        if "time" in entries.get("channels", {}):
            raise FileFormatError("'channels.time' must be the table 'time'", path=path)
        return cls(entries.get("channels", {}), entries.get("time"), path, entries.get("bridge", 0))

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


def bridge_of(value: object) -> int:
    """Return the number of samples in a row to bridge."""
    if not str(value).isdecimal():
        raise FileFormatError(f"'bridge' must be a number of samples, such as 20, not {value!r}")
    return int(str(value))


class _Entries(TypedDict, total=False):
    """Entries of the file of a channel map."""

    schema: int
    channels: dict[str, MappedChannel]
    time: MappedChannel
    bridge: Annotated[int, Ge(0)]


# ==== The record =====================================================================================================

_LOG = logging.getLogger(__name__)
IN_MEMORY = 2**24  #: Largest file whose columns are kept in memory, and largest temporary file there [bytes].


class Blocks:
    """Columns that a reader adds block by block: numbers are kept in a temporary file."""

    def __init__(self, count: int, file: tempfile.SpooledTemporaryFile[bytes]) -> None:
        self._file = file
        self._texts: list[list[NDArray[Any]]] = [[] for _ in range(count)]
        self._places: list[list[tuple[np.dtype[Any], int, int]]] = [[] for _ in range(count)]

    def add(self, block: Iterable[NDArray[Any]]) -> None:
        """Add the next samples (K,) of each column."""
        for texts, places, values in zip(self._texts, self._places, block, strict=True):
            if values.dtype == object:
                texts.append(values)
            elif values.size:
                places.append((values.dtype, values.size, self._file.tell()))
                self._file.write(np.ascontiguousarray(values).data)

    def columns(self) -> tuple[NDArray[Any] | Stored, ...]:
        """Return the columns."""
        size = self._file.tell()
        self._file.seek(0)
        is_large = size > IN_MEMORY
        content = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ) if is_large else self._file.read()

        def joined(places: Sequence[tuple[np.dtype[Any], int, int]]) -> Array:
            parts = [np.frombuffer(content, *place) for place in places]
            return np.concatenate([np.empty(0), *parts], dtype=np.float64)

        return tuple(
            np.concatenate(texts) if texts else Stored(sum(count for _, count, _ in places), partial(joined, places))
            for texts, places in zip(self._texts, self._places, strict=True)
        )


@dataclass(frozen=True, slots=True, eq=False)
class RawRecord:
    """Named columns with the units stated in the file."""

    origin: Origin  #: File and line number of each sample.
    names: tuple[str, ...]  #: C column names without units.
    units: tuple[str | None, ...]  #: C units as written in the file, None for columns without a unit.
    columns: tuple[NDArray[Any] | Stored, ...]  #: C vectors (N,) of numbers, or of texts if a cell is not a number.
    preamble: tuple[tuple[str, ...], ...] = ()  #: Lines above the table, one tuple of cells per line.
    notes: tuple[str, ...] = ()  #: Sentences on what was left out while reading.
    steps: tuple[str, ...] = ()  #: Sentences on how cells were understood that could be understood otherwise.

    def __post_init__(self) -> None:
        """Number repeated names and convert columns of times of day to seconds."""
        times = {i: found for i, column in enumerate(self.columns)
                 if column.dtype == object and (found := times_of(np.asarray(column))) is not None}  # fmt: skip
        object.__setattr__(self, "columns", tuple(times.get(i, column) for i, column in enumerate(self.columns)))
        object.__setattr__(self, "units", tuple("s" if i in times else unit for i, unit in enumerate(self.units)))
        counts: Counter[str] = Counter()
        names = []
        for name in self.names:
            counts[name] += 1
            names.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
        object.__setattr__(self, "names", tuple(names))

    @classmethod
    def in_memory(cls, columns: Mapping[str, Any]) -> RawRecord:
        """Return a record of columns, such as those of a pandas DataFrame, whose names may have units: `force [lbf]`.

        Raises:
            InputError: There is no column, or the columns differ in length.
        """
        vectors = [np.asarray(values) for values in columns.values()]
        if len({vector.shape for vector in vectors}) != 1 or vectors[0].ndim != 1:
            shapes = ", ".join(f"{name} {vector.shape}" for name, vector in zip(columns, vectors, strict=True))
            raise InputError(f"the columns must be vectors of one length; they are {shapes or 'missing'}")
        named = [split_header(str(name)) for name in columns]
        numbers = tuple(v if v.dtype == object else v.astype(np.float64) for v in vectors)
        note_file(unit for _, unit in named)
        return cls(Origin(), tuple(name for name, _ in named), tuple(unit for _, unit in named), numbers)

    def bridged(self, longest: int) -> RawRecord:
        """Return the record with straight lines over at most `longest` samples in a row that are NaN or empty.

        A step of the record says how many samples were replaced. Samples at the ends stay as they are.
        """
        if not longest:
            return self
        columns, steps = [], []
        for name, column in zip(self.names, self.columns, strict=True):
            values = _with_nan(np.asarray(column))
            gaps = [] if values is None else runs(np.isnan(values))
            inner = [(start, stop) for start, stop in gaps if start > 0 and stop < column.size]
            short = [np.arange(start, stop) for start, stop in inner if stop - start <= longest]
            if not short or values is None:
                columns.append(column)
                continue
            missing, known = np.concatenate(short), np.flatnonzero(~np.isnan(values))
            values[missing] = np.interp(missing, known, values[known])
            columns.append(values)
            steps.append(f"{missing.size} of {column.size} samples of {name!r} are NaN or empty, at most "
                         f"{max(map(len, short))} in a row; they were bridged by straight lines")  # fmt: skip
        return replace(self, columns=tuple(columns), steps=(*self.steps, *steps)) if steps else self

    def column(self, place: int) -> NDArray[Any]:
        """Return the values (N,) of a column."""
        return np.asarray(self.columns[place])

    def loaded(self) -> RawRecord:
        """Return the record with all its columns in memory."""
        return replace(self, columns=tuple(map(np.asarray, self.columns)))

    def with_column(self, place: int, values: NDArray[Any]) -> RawRecord:
        """Return the record with other values (N,) in a column."""
        return replace(self, columns=(*self.columns[:place], values, *self.columns[place + 1 :]))

    def log_notes(self) -> None:
        """Log what was left out, for readers whose result has no notes."""
        for note in (*self.notes, *self.steps):
            _LOG.warning("%s: %s", self.origin.path, note)

    @property
    def listed(self) -> str:
        """Names of the columns in a message, with advice if they have none."""
        names = ", ".join(self.names)
        if not all(name.isdigit() for name in self.names):
            return names
        return (
            f"{names}, as it has no header line; add one such as `time [s],velocity [m/s],force [N]`, or name the "
            "columns by number and their units, --channel 'force=3 [N]'"
        )

    def check_unique(self, source: str, *, channel: str | None = None) -> None:
        """Raise a FileFormatError if several columns of the file have the name `source`."""
        if any(re.fullmatch(rf"{re.escape(source)} \(\d+\)", name) for name in self.names):
            what = f"the column name {source!r} is not unique; rename one of the columns"
            raise self.origin.header_fault(FileFormatError, what, channel=channel)

    def index(self, source: str, *, channel: str) -> int:
        """Return the index of the column `source`; otherwise raise a MissingChannelError that lists the columns."""
        if source in self.names:
            return self.names.index(source)
        name, unit = split_header(source)  # a channel map may have the whole header, with its unit
        if name in self.names and self.units[self.names.index(name)] == unit:
            return self.names.index(name)
        what = f"there is no column {source!r}; the file has: {self.listed}"
        raise self.origin.header_fault(MissingChannelError, what, channel=channel)

    def unit(self, index: int, *, channel: str, given: Mapping[str, str], mapped: str | None) -> str:
        """Return a column's unit: from the channel map, otherwise from `given` (by name), otherwise from the file.

        Raises:
            MissingUnitError: No source states the unit.
            NotANumberError: The column is the time, has no unit, and a cell is neither a number nor a time.
            UnknownUnitError: The file and `given` state different units.
        """
        source, stated = self.names[index], self.units[index]
        given_unit = given.get(channel) or given.get(source)
        if given_unit and stated and not mapped and not _is_same(given_unit, stated):
            raise self.origin.header_fault(
                UnknownUnitError,
                f"the unit of the column {source!r} is [{stated}] in its header, but {given_unit!r} was given or "
                "stands above the table; leave that out, or set the unit in a channel map if the header is wrong",
                channel=channel,
            )
        unit = mapped or given_unit or stated
        if unit is None and channel == "time" and self.columns[index].dtype == object:
            self._check_times(index)
        if unit is None:
            raise self.origin.header_fault(
                MissingUnitError,
                f"the column {source!r} has no unit; write `{source} [unit]` in the header, pass "
                f"`--channel '{channel}=[unit]'` (in a system file: units = {{ {channel} = 'unit' }}), or use a "
                "channel map",
                channel=channel,
            )
        return unit

    def _check_times(self, index: int) -> None:
        """Raise a NotANumberError for a column of times that `times_of` refuses, at the cell that is no time if any."""
        for row, cell in enumerate(map(str, self.column(index))):
            if not is_number(cell):
                what = (
                    f"{cell!r} is neither a number nor a time; write seconds, hh:mm:ss.s or a date such as 2026-11-12 "
                    "or 12-Nov-2026 before the time"
                )
                raise self.origin.fault(NotANumberError, what, channel="time", sample=row)
        if any(seconds_of(str(cell)) is not None for cell in self.column(index)[:1]):
            what = "the dates change at other times than midnight; write them as 2026-11-12, whose days are counted"
            raise self.origin.fault(NotANumberError, what, channel="time", sample=0)

    def numbers(self, index: int, *, channel: str) -> NDArray[np.float64]:
        """Return a column (N,) as numbers; a NotANumberError names the first cell that is not a number."""
        column = self.column(index)
        if column.dtype != object:
            return column.astype(np.float64, copy=False)
        return np.array([self._number(cell, row, channel) for row, cell in enumerate(column)])

    def si(self, index: int, si: str) -> NDArray[np.float64]:
        """Return a column (N,) in SI; a MissingUnitError or an UnknownUnitError if its unit is not one of `si`."""
        name = self.names[index]
        unit = self.unit(index, channel=name, given={}, mapped=None)
        return convert(self.numbers(index, channel=name), unit, _target_unit(self, name, unit, si))

    def _number(self, cell: object, row: int, channel: str) -> float:
        try:
            return float(str(cell).replace(",", "."))
        except ValueError:
            what = "the cell is empty" if cell == "" else f"{cell!r} is not a number"
            advice = "correct the cell or delete these lines"
            raise self.origin.fault(NotANumberError, f"{what}; {advice}", channel=channel, sample=row) from None


def _with_nan(column: NDArray[Any]) -> Array | None:
    """Return a copy of a column (N,) with NaN for empty cells; None if another cell is not a number."""
    if column.dtype != object:
        return column.astype(np.float64)
    try:
        return np.array([float(str(cell).strip().replace(",", ".") or "nan") for cell in column])
    except ValueError:
        return None


def _is_same(unit: str, other: str) -> bool:
    known = is_unit(unit) and is_unit(other) and compatible(unit, other)
    return unit == other or (known and conversion(unit, other) == (1.0, 0.0))


# ---- Conversion of a raw record into a time series in SI ------------------------------------------------------------


def mapped_series(
    record: RawRecord,
    channel_map: ChannelMap,
    *,
    units: Mapping[str, str] | None = None,
    expected: Mapping[str, str] | None = None,
    keep: bool = True,
) -> TimeSeries:
    """Return the channels of a channel map as a time series in SI.

    Args:
        record: Columns of a file.
        channel_map: Columns to read, with units, gains and offsets.
        units: Units by channel (or column) name, for columns without a unit in the header.
        expected: SI units by channel name, for channels that must have a given dimension.
        keep: Whether the series has the samples in memory; otherwise it reads a channel each time it is used.

    Raises:
        DataError: A column, a unit or a sample has a fault; the subclass and the message say which and where.
    """
    if not record.columns[0].size:
        raise record.origin.header_fault(TooShortError, "it has no samples")
    time = channel_map.time or find_time(record)
    picks = {"time": time, **{name: pick for name, pick in channel_map.channels.items() if name != "time"}}
    known = {*picks, *(pick.source for pick in picks.values())}
    for name in units or {}:  # otherwise a typing error in the name of a channel has no effect
        if name not in known:
            what = f"a unit is given for this channel, but the channels that are read are: {', '.join(picks)}"
            raise record.origin.header_fault(MissingChannelError, what, channel=name)
    # In messages about a channel map of a file, a channel has its key there.
    keys = {name: name if name == "time" else f"channels.{name}" for name in picks}
    labels = {n: f"{key} of {channel_map.path}" if channel_map.path else n for n, key in keys.items()}
    columns = {name: record.index(pick.source, channel=labels[name]) for name, pick in picks.items()}
    expected = {"time": "s", **(expected or {})}
    _check_units(record, picks, columns, units or {})
    plans = {}
    for name, pick in picks.items():  # all units before the numbers
        unit = record.unit(columns[name], channel=name, given=units or {}, mapped=pick.unit)
        plans[name] = unit, _target_unit(record, name, unit, expected.get(name))

    def read(name: str) -> Array:
        raw, pick = record.numbers(columns[name], channel=name), picks[name]
        check_finite(raw, channel=name, origin=record.origin)
        scaled = raw if (pick.gain, pick.offset) == (1.0, 0.0) else pick.gain * raw + pick.offset
        return convert(scaled, *plans[name])

    rows = np.empty((len(plans) if keep else 1, record.columns[0].size))
    for number, name in enumerate(plans):  # one by one, as a record may take gigabytes
        values = read(name)  # a fault is found now, also in a channel that is not kept
        if number < len(rows):
            rows[number] = values
    rows.setflags(write=False)
    check_time(rows[0], origin=record.origin)
    names, targets = tuple(plans)[1:], tuple(target for _, target in plans.values())[1:]
    if keep:
        return TimeSeries(rows[0], rows[1:], names, targets)
    return StoredSeries(rows[0], {name: partial(read, name) for name in names}, targets)


def _check_units(
    record: RawRecord, picks: Mapping[str, MappedChannel], columns: Mapping[str, int], units: Mapping[str, str]
) -> None:
    """Raise a MissingUnitError that names all channels without a unit if there are several."""
    missing = [
        name
        for name, pick in picks.items()
        if not (pick.unit or units.get(name) or units.get(pick.source) or record.units[columns[name]])
        and (name != "time" or record.columns[columns[name]].dtype != object)
    ]
    if len(missing) > 1:
        sources = ", ".join(repr(picks[name].source) for name in missing)
        advice = " ".join(f"--channel '{name}=[unit]'" for name in missing)
        what = f"the columns {sources} have no unit; add it to each name as `name [unit]`, or pass `{advice}`"
        raise record.origin.header_fault(MissingUnitError, what, channel=missing[0])


def _target_unit(record: RawRecord, channel: str, unit: str, expected: str | None) -> str:
    """Return the SI unit of a channel; refuse a unit that is unknown or has the wrong dimension."""
    try:
        if expected is None:
            return unit if unit in SI_UNITS else si_unit(unit)
        if compatible(unit, expected):
            return expected
    except UnknownUnitError as error:
        what = f"{error}; or use a channel map that names only the columns to read"
        raise record.origin.header_fault(UnknownUnitError, what, channel=channel) from error
    what = f"the unit {unit!r} cannot be converted to {expected!r}; check that it is the right column"
    raise record.origin.header_fault(UnknownUnitError, what, channel=channel)


def find_time(record: RawRecord) -> MappedChannel:
    """Return the time column, or raise a MissingChannelError that lists the columns.

    `T` is the time only if its unit is a time unit, because it may also be the temperature.
    """
    for time_name in TIME_NAMES:
        for name, unit in zip(record.names, record.units, strict=True):
            if name.lower() == time_name and (name != "T" or unit in ("s", "ms", "sec")):
                return MappedChannel(name)
    return MappedChannel(record.names[record.index("time", channel="time")])


def map_beside(record: RawRecord) -> ChannelMap | None:
    """Return the map `rig_map.toml` in the record's folder; None without one that names a column of the record."""
    path = record.origin.path and record.origin.path.parent / MAP_BESIDE
    if not (path and path.is_file()):
        return None
    found = ChannelMap.read(path)
    sources = {name for pick in found.channels.values() for name in (pick.source, split_header(pick.source)[0])}
    return found if sources & set(record.names) else None


def identity_map(record: RawRecord, time: MappedChannel) -> ChannelMap:
    """Return a map in which every column except time is a channel of the same name.

    Raises:
        FileFormatError: Two columns have the same name.
    """
    for name in record.names:
        record.check_unique(name)
    return ChannelMap({name: MappedChannel(name) for name in record.names if name != time.source}, time)


# ==== Channels that were sampled at different times: one table for each axis of time =================================


def by_time(signals: Sequence[Signal]) -> list[list[Signal]]:
    """Return the channels of each axis of time, those of the axis with most channels first, then long ones."""
    tables: dict[bytes, list[Signal]] = {}
    for signal in signals:
        tables.setdefault(signal.times.tobytes(), []).append(signal)
    return sorted(tables.values(), key=lambda table: (len(table), table[0].times.size), reverse=True)


_ROUNDED = 1.1  #: Largest range of the deviations of even times that were rounded to whole units, in units.


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


def table_of(
    signals: Sequence[Signal], path: Path, preamble: tuple[tuple[str, ...], ...] = (), notes: tuple[str, ...] = ()
) -> RawRecord:
    """Return channels with one axis of time as a table, with the time as its column `time` [s]."""
    names, units = ("time", *(signal.name for signal in signals)), ("s", *(signal.unit or None for signal in signals))
    columns = (signals[0].times, *(signal.samples for signal in signals))
    return RawRecord(Origin(path), names, units, columns, preamble, notes)


def tables_of(
    signals: Sequence[Signal], path: Path, preamble: tuple[tuple[str, ...], ...], notes: tuple[str, ...] = ()
) -> tuple[RawRecord, ...]:
    """Return a table for each axis of time; the first one has the temperatures of the others too, interpolated."""
    first, *others = by_time(signals)
    tables = ([*first, *temperatures_at(first[0].times, others)], *others)
    return tuple(table_of(table, path, preamble, notes) for table in tables)


def temperatures_at(times: NDArray[np.float64], tables: Sequence[Sequence[Signal]]) -> list[Signal]:
    """Return the temperatures of tables, interpolated at other times; beyond their own times they are constant."""
    warm = [signal for table in tables for signal in table if is_unit(signal.unit) and compatible(signal.unit, "K")]
    return [
        signal._replace(samples=np.interp(times, signal.times, signal.samples), times=times)
        for signal in warm
        if signal.times.size
    ]
