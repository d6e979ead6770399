"""Dynamometer tests: velocity, force and displacement of a shock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import FileFormatError, MissingChannelError
from eightpost.files import sha256_of
from eightpost.rig.dyno_conditions import DynoConditions, conditions_from
from eightpost.rig.dyno_notes import notes_of
from eightpost.signals import faults
from eightpost.signals.channel_map import TIME_NAMES, ChannelMap, MappedChannel
from eightpost.signals.faults import Origin
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.formats import read_record, read_records
from eightpost.signals.raw_record import letters_of, mapped_series
from eightpost.units import compatible, is_unit

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord
    from eightpost.signals.timeseries import TimeSeries


# ---- Channel names that shock dynamometers use ----------------------------------------------------------------------

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


def _dyno_map(record: RawRecord, channel_map: ChannelMap | None = None) -> ChannelMap:
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
    matches = [name for name in record.names if name not in taken and letters_of(name) in _ALIASES[channel]]
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


# ---- Shock dynamometer tests ----------------------------------------------------------------------------------------

#: Low-pass cut-off for dynamometer data in the dissertation (3.3) [Hz].
CUTOFF = 50.0

#: Minimum duration [s] and minimum number of samples of a record.
SHORTEST, FEWEST = 0.5, 200


@dataclass(frozen=True, slots=True, eq=False)
class DynoTest:
    """A dynamometer test that passed all checks.

    Attributes:
        series: Record with `velocity` [m/s] and `force` [N], and if known `displacement` [m] and `temperature` [K]; all
            except the temperature are positive in compression.
        conditions: Build, clicks, gas pressure and other known conditions.
        source: Path of the file, None for a record created in memory.
        sha256: SHA-256 digest of the file, empty without a file.
        derived: Descriptions of channels that were computed, not measured.
        notes: Notes on suspicious features of the record (`eightpost.rig.dyno_notes`); a fit repeats them.
    """

    series: TimeSeries
    conditions: DynoConditions = field(default_factory=DynoConditions)
    source: Path | None = None
    sha256: str = ""
    derived: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("velocity", "force"):
            if name not in self.series:
                known = ", ".join(self.series.names)
                raise MissingChannelError(f"a dynamometer test needs this channel; there are: {known}", channel=name)

    @property
    def stroke(self) -> float | None:
        """Difference between the highest and the lowest displacement [m]; None if the displacement is unknown."""
        return float(np.ptp(self.series["displacement"])) if "displacement" in self.series else None


def read_dyno_test(
    path: str | Path,
    *,
    channel_map: ChannelMap | None = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
    conditions: DynoConditions | None = None,
    cutoff: float | None = None,
) -> DynoTest:
    """Read and check a shock dynamometer file with one table.

    Columns are recognised by their usual names (t, x, disp, v, vel, F, load, temp, ...); a channel map takes
    precedence. A missing velocity is derived from the displacement with a low-pass and central differences (6.1.2). An
    offset of the force (static gas force, rod weight) is not removed. Suspicious features that leave the record usable
    are described in the test's notes.

    Args:
        path: Path of a .csv, .txt, .tsv, .parquet, .mat, .mf4 or .mdf file.
        channel_map: Columns by channel, for columns with unusual names.
        units: Units by channel name, for columns without a unit in the header.
        flip: Names of the channels whose sign is changed.
        conditions: Known conditions of the test, which take precedence over the file's preamble.
        cutoff: Low-pass cut-off for a derived velocity [Hz]; default 50 Hz, at most 0.4 of the sample rate.

    Raises:
        FileFormatError: The file cannot be read, or contains several tables.
        MissingChannelError: There is no force, or neither velocity nor displacement.
        MissingUnitError: A channel has no unit.
        UnknownUnitError: A unit is unknown or has the wrong dimension.
        NotANumberError: A sample is NaN, empty or text.
        BackwardTimeError: Time decreases.
        DuplicateTimeError: Time repeats.
        TimeGapError: Samples are missing.
        TooShortError: The record has less than 0.5 s or 200 samples.
        ConstantChannelError: Velocity, displacement or force is constant.
        ClippedChannelError: The force is clipped.
        WrongSignError: The force or the displacement has the wrong sign.
    """
    reading = _Reading(Path(path), channel_map, dict(units or {}), tuple(flip), cutoff)
    return reading.test(read_record(path), conditions or DynoConditions())


def read_dyno_tests(
    path: str | Path,
    *,
    channel_map: ChannelMap | None = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
    conditions: DynoConditions | None = None,
    cutoff: float | None = None,
) -> tuple[DynoTest, ...]:
    """Read and check all tables of a shock dynamometer file; see read_dyno_test for arguments and errors.

    Conditions in a preamble apply to its table and to the following tables, until another preamble changes them. Times
    that continue from one table to the next are not changed. `split_runs` splits a table into runs.
    """
    reading = _Reading(Path(path), channel_map, dict(units or {}), tuple(flip), cutoff)
    known = DynoConditions()
    tests = []
    for record in read_records(path):
        known = conditions_from(record.preamble)[0].over(known)
        tests.append(reading.test(record, (conditions or DynoConditions()).over(known)))
    return tuple(tests)


@dataclass(frozen=True, slots=True)
class _Reading:
    """Options for reading the tables of a file."""

    path: Path
    channel_map: ChannelMap | None
    units: Mapping[str, str]
    flip: tuple[str, ...]
    cutoff: float | None

    def test(self, record: RawRecord, conditions: DynoConditions) -> DynoTest:
        """Return the checked test of a table."""
        mapping = _dyno_map(record, self.channel_map).flipped(self.flip)
        _check_channels(record, mapping)
        series = mapped_series(record, mapping, units=self.units, expected=DYNO_UNITS)
        _check_record(series, record.origin)
        measured, origin = series.names, record.origin
        derived: tuple[str, ...] = ()
        if "velocity" not in series:
            series, derived = _with_velocity(series, self.cutoff)
            origin = origin if len(derived) == 1 else Origin(origin.path, None, origin.header_line)
        elif "displacement" in series:
            _check_displacement_sign(series, origin)
        _check_force(series, origin, derived)
        stated, notes = conditions_from(record.preamble)
        notes += notes_of(series, measured=measured, origin=origin)
        return DynoTest(series, conditions.over(stated), self.path, sha256_of(self.path), derived, notes)


def _check_channels(record: RawRecord, mapping: ChannelMap) -> None:
    """Raise MissingChannelError if time, force or a motion channel is missing."""
    known = ", ".join(record.names)
    advice = f"the file has: {known}; name the column in a channel map"
    if mapping.time is None:
        raise record.origin.header_fault(MissingChannelError, f"the channel is missing; {advice}", channel="time")
    if "force" not in mapping.channels:
        raise record.origin.header_fault(MissingChannelError, f"the channel is missing; {advice}", channel="force")
    if not {"velocity", "displacement"} & set(mapping.channels):
        what = f"there is neither velocity nor displacement; {advice}"
        raise record.origin.header_fault(MissingChannelError, what, channel="velocity")


def _check_record(series: TimeSeries, origin: Origin) -> None:
    """Check the time and that the measured channels vary."""
    faults.check_gaps(series.time, origin=origin)
    faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=origin)
    for name in ("velocity", "displacement", "force"):
        if name in series:
            faults.check_moves(series[name], channel=name, origin=origin)


def _check_force(series: TimeSeries, origin: Origin, derived: tuple[str, ...]) -> None:
    """Check the force for clipping, and its sign by its correlation with the velocity."""
    velocity, force = series["velocity"], series["force"]
    faults.check_not_clipped(force, channel="force", origin=origin, against=velocity)
    against = "the velocity derived from displacement" if derived else "velocity"
    faults.check_sign(force, velocity, channel="force", against=against, origin=origin)


def _check_displacement_sign(series: TimeSeries, origin: Origin) -> None:
    """Check the displacement's sign by comparison with the measured velocity."""
    rate = series.sample_rate
    slope = velocity_from_displacement(series["displacement"], rate, _default_cutoff(rate))
    faults.check_sign(slope, series["velocity"], channel="displacement", against="velocity", origin=origin)


def _default_cutoff(rate: float) -> float:
    return min(CUTOFF, 0.4 * rate)


def _with_velocity(series: TimeSeries, cutoff: float | None) -> tuple[TimeSeries, tuple[str, ...]]:
    """Return the series with the derivative of the displacement as velocity, and descriptions of the steps."""
    steps = []
    if not series.is_uniform:
        series = series.resample(series.sample_rate)
        steps.append(f"resampled to an even {series.sample_rate:g} Hz")
    rate = series.sample_rate
    cutoff = cutoff or _default_cutoff(rate)
    velocity = velocity_from_displacement(series["displacement"], rate, cutoff)
    steps.append(f"velocity from displacement, low-pass {cutoff:g} Hz and central differences")
    return series.with_channel("velocity", "m/s", velocity), tuple(steps)
