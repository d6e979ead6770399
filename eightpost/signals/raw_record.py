"""Records as a file has them, and their channels under this library's names and units."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eightpost.errors import (
    FileFormatError,
    MissingChannelError,
    MissingUnitError,
    NotANumberError,
    TooShortError,
    UnknownUnitError,
)
from eightpost.signals.channel_map import MAP_BESIDE, TIME_NAMES, ChannelMap, MappedChannel
from eightpost.signals.column_headers import is_number, split_header
from eightpost.signals.faults import check_finite, check_time
from eightpost.signals.text_cleaning import seconds_of, times_of
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import SI_UNITS, compatible, conversion, convert, is_unit, si_unit

if TYPE_CHECKING:
    from eightpost.signals.faults import Origin


_LOG = logging.getLogger(__name__)

# ---- Raw records ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class RawRecord:
    """Named columns with the units stated in the file."""

    origin: Origin  #: File and line number of each sample.
    names: tuple[str, ...]  #: C column names without units.
    units: tuple[str | None, ...]  #: C units as written in the file, None for columns without a unit.
    columns: tuple[NDArray[Any], ...]  #: C vectors (N,) of numbers, or of texts if a cell is not a number.
    preamble: tuple[tuple[str, ...], ...] = ()  #: Lines above the table, one tuple of cells per line.
    notes: tuple[str, ...] = ()  #: Sentences on what was left out while reading.
    steps: tuple[str, ...] = ()  #: Sentences on how cells were understood that could be understood otherwise.

    def __post_init__(self) -> None:
        """Number repeated names and convert columns of times of day to seconds."""
        times = {i: found for i, column in enumerate(self.columns)
                 if column.dtype == object and (found := times_of(column)) is not None}  # fmt: skip
        object.__setattr__(self, "columns", tuple(times.get(i, column) for i, column in enumerate(self.columns)))
        object.__setattr__(self, "units", tuple("s" if i in times else unit for i, unit in enumerate(self.units)))
        counts: Counter[str] = Counter()
        names = []
        for name in self.names:
            counts[name] += 1
            names.append(name if counts[name] == 1 else f"{name} ({counts[name]})")
        object.__setattr__(self, "names", tuple(names))

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
            "columns by number, --channel force=3, and their units, --units force=N"
        )

    def twins(self, source: str) -> tuple[str, ...]:
        """Return the names of further columns that had the same name in the file."""
        return tuple(name for name in self.names if re.fullmatch(rf"{re.escape(source)} \(\d+\)", name))

    def check_unique(self, source: str, *, channel: str | None = None) -> None:
        """Raise a FileFormatError if several columns of the file have the name `source`."""
        if self.twins(source):
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
                f"the column {source!r} has no unit; add it to the header as `{source} [unit]`, pass "
                f"`--units {channel}=unit` (in a system file: units = {{ {channel} = 'unit' }}), or use a channel map",
                channel=channel,
            )
        return unit

    def _check_times(self, index: int) -> None:
        """Raise a NotANumberError for a column of times that `times_of` refuses, at the cell that is no time if any."""
        for row, cell in enumerate(map(str, self.columns[index])):
            if not is_number(cell):
                what = (
                    f"{cell!r} is neither a number nor a time; write seconds, hh:mm:ss.s or a date such as 2026-11-12 "
                    "or 12-Nov-2026 before the time"
                )
                raise self.origin.fault(NotANumberError, what, channel="time", sample=row)
        if any(seconds_of(str(cell)) is not None for cell in self.columns[index][:1]):
            what = "the dates change at other times than midnight; write them as 2026-11-12, whose days are counted"
            raise self.origin.fault(NotANumberError, what, channel="time", sample=0)

    def numbers(self, index: int, *, channel: str) -> NDArray[np.float64]:
        """Return a column (N,) as numbers; a NotANumberError names the first cell that is not a number."""
        column = self.columns[index]
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
) -> TimeSeries:
    """Return the channels of a channel map as a time series in SI.

    Args:
        record: Columns of a file.
        channel_map: Columns to read, with units, gains and offsets.
        units: Units by channel (or column) name, for columns without a unit in the header.
        expected: SI units by channel name, for channels that must have a given dimension.

    Raises:
        TooShortError: There is no sample.
        MissingChannelError: A column is missing, or a unit is given for a channel that is not read.
        MissingUnitError: A column has no unit.
        UnknownUnitError: A unit is unknown or has the wrong dimension.
        NotANumberError: A sample is NaN, empty or text.
        BackwardTimeError: Time decreases.
        DuplicateTimeError: Time repeats.
    """
    if not record.columns[0].size:
        raise record.origin.header_fault(TooShortError, "it has no samples")
    time = channel_map.time or find_time(record)
    picks = {"time": time, **{name: pick for name, pick in channel_map.channels.items() if name != "time"}}
    _check_given(units or {}, picks, record)
    labels = {name: _label(name, channel_map) for name in picks}
    columns = {name: record.index(pick.source, channel=labels[name]) for name, pick in picks.items()}
    expected = {"time": "s", **(expected or {})}
    _check_units(record, picks, columns, units or {})
    plans = {}
    for name, pick in picks.items():
        unit = record.unit(columns[name], channel=name, given=units or {}, mapped=pick.unit)
        target = _target_unit(record, name, unit, expected.get(name))
        plans[name] = _Plan(name, columns[name], pick, unit, target)
    channels = {name: (plan.target, plan.values(record)) for name, plan in plans.items()}
    _, times = channels.pop("time")
    check_time(times, origin=record.origin)
    return TimeSeries.from_channels(times, channels)


@dataclass(frozen=True, slots=True)
class _Plan:
    """Recipe for one channel: column, gain and offset, unit of the column and SI unit."""

    name: str
    column: int
    pick: MappedChannel
    unit: str
    target: str

    def values(self, record: RawRecord) -> NDArray[np.float64]:
        raw = record.numbers(self.column, channel=self.name)
        check_finite(raw, channel=self.name, origin=record.origin)
        pick = self.pick
        scaled = raw if (pick.gain, pick.offset) == (1.0, 0.0) else pick.gain * raw + pick.offset
        return convert(scaled, self.unit, self.target)


def _check_given(units: Mapping[str, str], picks: Mapping[str, MappedChannel], record: RawRecord) -> None:
    """Refuse a unit for a channel that is not read, because the channel name may be a typing error."""
    known = {*picks, *(pick.source for pick in picks.values())}
    for name in units:
        if name not in known:
            what = f"a unit is given for this channel, but the channels that are read are: {', '.join(picks)}"
            raise record.origin.header_fault(MissingChannelError, what, channel=name)


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
        advice = " ".join(f"--units {name}=unit" for name in missing)
        what = f"the columns {sources} have no unit; add it to each name as `name [unit]`, or pass `{advice}`"
        raise record.origin.header_fault(MissingUnitError, what, channel=missing[0])


def _label(name: str, channel_map: ChannelMap) -> str:
    """Return the channel for messages: its name, or its key in the channel map's file."""
    if channel_map.path is None:
        return name
    return f"{name if name == 'time' else f'channels.{name}'} of {channel_map.path}"


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
