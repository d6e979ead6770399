"""Conversion of a raw record into a time series in SI: selection, checks and units."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import MissingChannelError, TooShortError, UnknownUnitError
from eightpost.signals.channel_map import ChannelMap, MappedChannel, find_time
from eightpost.signals.faults import check_finite, check_time
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import SI_UNITS, compatible, convert, si_unit

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eightpost.signals.raw_record import RawRecord


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
