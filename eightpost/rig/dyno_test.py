"""Shock dynamometer tests: a checked record and the conditions it was taken under."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from eightpost.errors import MissingChannelError
from eightpost.files import sha256_of
from eightpost.rig.dyno_aliases import DYNO_UNITS, dyno_map
from eightpost.rig.dyno_conditions import DynoConditions, conditions_from
from eightpost.rig.dyno_notes import notes_of
from eightpost.signals import faults
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.mapped_series import mapped_series
from eightpost.signals.origin import Origin
from eightpost.signals.read import read_record, read_records

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from eightpost.signals.channel_map import ChannelMap
    from eightpost.signals.raw_record import RawRecord
    from eightpost.signals.timeseries import TimeSeries

#: The dissertation's low-pass cut-off for dynamometer data (3.3) [Hz].
CUTOFF = 50.0

#: Shortest record [s] and fewest samples that say something about a shock.
SHORTEST, FEWEST = 0.5, 200


@dataclass(frozen=True, slots=True, eq=False)
class DynoTest:
    """A dynamometer test that passed every check.

    Attributes:
        series: `velocity` [m/s] and `force` [N], where known `displacement` [m] and `temperature` [K]; all
            but the last positive in compression.
        conditions: Build, clicks, gas pressure, and what else is known.
        source: The file, None for a record made in memory.
        sha256: The file's digest, empty without a file.
        derived: What was not measured but computed, in words.
        notes: What is suspicious in the record, in words (`eightpost.rig.dyno_notes`); a fit repeats them.
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
                raise MissingChannelError(f"a dynamometer test needs it; there are: {known}", channel=name)


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

    Columns are recognised by their usual names (t, x, disp, v, vel, F, load, temp, ...); a channel map goes
    first. A missing velocity is derived from the displacement by a low-pass and central differences (6.1.2).
    An offset of the force (static gas force, rod weight) is left in it. What is suspicious but usable is in the
    test's notes.

    Args:
        path: A .csv, .txt, .tsv, .parquet, .mat, .mf4 or .mdf file.
        channel_map: Columns by channel, for what is not recognised.
        units: Units by channel name, for columns whose header says none.
        flip: Channels whose sign is turned.
        conditions: What is known about the shock; goes before what the file's preamble says.
        cutoff: Low-pass cut-off for a derived velocity [Hz]; default 50 Hz, at most 0.4 of the sample rate.

    Raises:
        FileFormatError: The file cannot be read, or holds several tables.
        MissingChannelError: There is no force, or neither velocity nor displacement.
        MissingUnitError: A channel has no unit.
        UnknownUnitError: A unit is not known or of the wrong dimension.
        NotANumberError: A sample is NaN, empty or text.
        BackwardTimeError: Time decreases.
        DuplicateTimeError: Time repeats.
        TimeGapError: Samples are missing.
        TooShortError: Under 0.5 s or 200 samples.
        ConstantChannelError: Velocity, displacement or force do not move.
        ClippedChannelError: The force sits at the end of its range.
        WrongSignError: The force, or the displacement, is positive the other way.
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
    """Read and check every table of a shock dynamometer file; arguments and errors as for read_dyno_test.

    What a preamble says holds for its table and those below it, until another preamble says otherwise. A time that
    runs through several tables is kept; splitting a table into runs is `split_runs`.
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
    """How the tables of a file are read."""

    path: Path
    channel_map: ChannelMap | None
    units: Mapping[str, str]
    flip: tuple[str, ...]
    cutoff: float | None

    def test(self, record: RawRecord, conditions: DynoConditions) -> DynoTest:
        """Return the checked test of a table."""
        mapping = dyno_map(record, self.channel_map).flipped(self.flip)
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
    """Raise MissingChannelError unless time, force and a motion are there."""
    known = ", ".join(record.names)
    advice = f"the file has: {known}; name the column in a channel map"
    if mapping.time is None:
        raise record.origin.header_fault(MissingChannelError, f"there is none; {advice}", channel="time")
    if "force" not in mapping.channels:
        raise record.origin.header_fault(MissingChannelError, f"there is none; {advice}", channel="force")
    if not {"velocity", "displacement"} & set(mapping.channels):
        what = f"there is neither velocity nor displacement; {advice}"
        raise record.origin.header_fault(MissingChannelError, what, channel="velocity")


def _check_record(series: TimeSeries, origin: Origin) -> None:
    """Check time and movement of what was measured."""
    faults.check_gaps(series.time, origin=origin)
    faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=origin)
    for name in ("velocity", "displacement", "force"):
        if name in series:
            faults.check_moves(series[name], channel=name, origin=origin)


def _check_force(series: TimeSeries, origin: Origin, derived: tuple[str, ...]) -> None:
    """Check the force for clipping, and its sign against the velocity."""
    velocity, force = series["velocity"], series["force"]
    faults.check_not_clipped(force, channel="force", origin=origin, against=velocity)
    against = "the velocity derived from displacement" if derived else "velocity"
    faults.check_sign(force, velocity, channel="force", against=against, origin=origin)


def _check_displacement_sign(series: TimeSeries, origin: Origin) -> None:
    """Check the displacement's sign against the velocity that was measured beside it."""
    rate = series.sample_rate
    slope = velocity_from_displacement(series["displacement"], rate, _default_cutoff(rate))
    faults.check_sign(slope, series["velocity"], channel="displacement", against="velocity", origin=origin)


def _default_cutoff(rate: float) -> float:
    return min(CUTOFF, 0.4 * rate)


def _with_velocity(series: TimeSeries, cutoff: float | None) -> tuple[TimeSeries, tuple[str, ...]]:
    """Add the velocity that the displacement implies, and say how it was made."""
    steps = []
    if not series.is_uniform:
        series = series.resample(series.sample_rate)
        steps.append(f"resampled to an even {series.sample_rate:g} Hz")
    rate = series.sample_rate
    cutoff = cutoff or _default_cutoff(rate)
    velocity = velocity_from_displacement(series["displacement"], rate, cutoff)
    steps.append(f"velocity from displacement, low-pass {cutoff:g} Hz and central differences")
    return series.with_channel("velocity", "m/s", velocity), tuple(steps)
