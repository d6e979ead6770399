"""Dynamometer tests: velocity, force and displacement of a shock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.display import Summary
from eightpost.errors import MissingChannelError
from eightpost.files import sha256_of
from eightpost.rig.dyno_columns import DYNO_UNITS, choice_reasons, dyno_map, has_channels, length_note
from eightpost.rig.dyno_conditions import DynoConditions, conditions_from
from eightpost.rig.dyno_notes import notes_of
from eightpost.rig.file_name import conditions_in
from eightpost.rig.optional_columns import check_one_time, with_readable_columns
from eightpost.rig.other_columns import column_reasons, mixed_units
from eightpost.rig.plausibility import SEGMENT, part_reasons, record_reasons, rectified_force
from eightpost.rig.plausibility_rules import PART_RULES
from eightpost.rig.stated_conventions import reversed_channels, stated_units
from eightpost.signals import faults
from eightpost.signals.channel_map import ChannelMap
from eightpost.signals.faults import Origin
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.formats import read_record, read_records
from eightpost.signals.raw_record import mapped_series
from eightpost.signals.recording import Recording
from eightpost.signals.time_axes import spread_evenly
from eightpost.verdict import Reason

if TYPE_CHECKING:
    from eightpost.report.pictures import Picture
    from eightpost.signals.raw_record import RawRecord
    from eightpost.signals.timeseries import TimeSeries


# ---- Shock dynamometer tests ----------------------------------------------------------------------------------------

#: Low-pass cut-off for dynamometer data in the dissertation (3.3) [Hz].
CUTOFF = 50.0

#: Minimum duration [s] and minimum number of samples of a record.
SHORTEST, FEWEST = 0.5, 200


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class DynoTest(Recording):
    """A dynamometer test that passed all checks.

    Attributes:
        series: Record with `velocity` [m/s] and `force` [N], and if known `displacement` [m] and `temperature` [K]; all
            except the temperature are positive in compression.
        conditions: Build, clicks, gas pressure and other known conditions.
        source: Path of the file, None for a record created in memory.
        sha256: SHA-256 digest of the file, empty without a file.
        derived: Descriptions of what was computed, or read in one of several possible ways.
        notes: Notes on suspicious features of the record (`eightpost.rig.dyno_notes`); a fit repeats them.
        reasons: Findings that make the record implausible (`eightpost.rig.plausibility`), as reasons of a verdict.
    """

    series: TimeSeries
    conditions: DynoConditions = field(default_factory=DynoConditions)
    source: Path | None = None
    sha256: str = ""
    derived: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    reasons: tuple[Reason, ...] = ()

    def __post_init__(self) -> None:
        for name in ("velocity", "force"):
            if name not in self.series:
                known = ", ".join(self.series.names)
                raise MissingChannelError(f"a dynamometer test needs this channel; there are: {known}", channel=name)

    @property
    def label(self) -> str:
        """Name of the record in messages."""
        return f"record {self.source.name}" if self.source else "a record in memory"

    @property
    def warnings(self) -> tuple[str, ...]:
        """Notes, then the reasons as sentences."""
        return (*self.notes, *(f"{reason.statement}: {reason.figure}; {reason.remedy}" for reason in self.reasons))

    def _summary(self) -> Summary:
        known = self.conditions
        stated = [text for text in (known.build, known.clicks, known.run) if text]
        return Summary.of(
            "Dynamometer test",
            ("file", self.source.name if self.source else ""),
            ("conditions", ", ".join(stated)),
            *self.series.summary_rows(),
            ("derived", "; ".join(self.derived)),
            ("warnings", "; ".join(self.warnings)),
        )

    def _title(self) -> str:
        return self.label

    def plot(
        self, channels: str | Sequence[str] = (), *, start: float | None = None, stop: float | None = None
    ) -> Picture:
        """Return a picture of force over velocity, or of the named channels over time; see `Recording.plot`."""
        from eightpost.report.traces import loop  # noqa: PLC0415 -- matplotlib takes long to load

        if channels or start is not None or stop is not None:
            return Recording.plot(self, channels, start=start, stop=stop)
        return loop(self.series, "velocity", "force", title=self.label)

    def judged(self, *, until: float = SEGMENT[1]) -> DynoTest:
        """Return the test with the reasons about a change of the shock or of the motion that this series has.

        Args:
            until: End of the fitted seconds, from the start of the series [s].
        """
        kept = tuple(reason for reason in self.reasons if reason.rule not in PART_RULES)
        return replace(self, reasons=(*kept, *part_reasons(self.series, origin=self.label, until=until)))

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
        path: Path of a file in one of the formats of docs/reference/dyno_files.md.
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
    records = [one for one in read_records(path) if has_channels(dyno_map(one, channel_map))]
    record = records[0] if len(records) == 1 else read_record(path)
    return reading.test(record, conditions or DynoConditions())


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

    Tables without force and motion are left out if others have them. Conditions in a preamble apply to its table and to
    the following tables, until another preamble changes them. Times that continue from one table to the next are not
    changed. `split_runs` splits a table into runs.
    """
    reading = _Reading(Path(path), channel_map, dict(units or {}), tuple(flip), cutoff)
    known = DynoConditions()
    tests = []
    records = read_records(path)
    for record in [r for r in records if has_channels(dyno_map(r, channel_map))] or records:
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
        label = f"record {self.path.name}"
        units = {**stated_units(record.preamble), **self.units}
        record, mapping, left_out = with_readable_columns(record, self.channel_map, units, label)
        mapping, signs = _with_stated_signs(record, mapping)
        mapping = mapping.flipped(self.flip)
        _check_channels(record, mapping)
        check_one_time(record, mapping, self.channel_map)
        record = _with_even_time(record, mapping)
        units = {n: unit for n, unit in units.items() if n in (*mapping.channels, *self.units, "time")}
        series = mapped_series(record, mapping, units=units, expected=DYNO_UNITS)
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
        notes = (*record.notes, *notes, *notes_of(series, measured=measured, origin=origin))
        known = conditions.over(stated)
        of_name, named = conditions_in(self.path)
        named = named if known.over(of_name) != known else ()
        derived = (*record.steps, *signs, *length_note(mapping), *derived, *named)
        test = DynoTest(series, known.over(of_name), self.path, sha256_of(self.path), derived, notes)
        mixed = mixed_units(record, mapping, units)
        reasons = (
            *left_out,
            *record_reasons(series, measured=measured, origin=test.label, units=mixed, conditions=test.conditions),
            *column_reasons(record, mapping, series, test.label),
            *choice_reasons(record, mapping, self.channel_map, test.label),
        )
        return replace(test, reasons=reasons).judged()


def _with_even_time(record: RawRecord, mapping: ChannelMap) -> RawRecord:
    """Return a record whose times, if they were rounded to whole numbers, are an even series, with a note."""
    place = record.names.index(mapping.time.source) if mapping.time and mapping.time.source in record.names else -1
    if place < 0 or record.columns[place].dtype == object:
        return record
    old = record.columns[place]
    if (new := spread_evenly(old)) is old:
        return record
    moved = float(np.abs(new - old).max())
    note = f"the times were rounded to whole numbers; they were spread evenly, which moved them by at most {moved:.2g}"
    columns = (*record.columns[:place], new, *record.columns[place + 1 :])
    return replace(record, columns=columns, steps=(*record.steps, note))


def _with_stated_signs(record: RawRecord, mapping: ChannelMap) -> tuple[ChannelMap, tuple[str, ...]]:
    """Return the channel map with the signs that the preamble states, and a note if it changes some.

    A channel that the map reverses already, such as a length, has its sign from there.
    """
    stated, statement = reversed_channels(record.preamble, record.origin.path or Path())
    turned = [name for name, pick in mapping.channels.items() if stated.get(name) and pick.gain > 0.0]
    if not turned:
        return mapping, ()
    note = f"the signs of {', '.join(turned)} were reversed, because the file states {statement!r}; --flip undoes it"
    return mapping.flipped(turned), (note,)


def _check_channels(record: RawRecord, mapping: ChannelMap) -> None:
    """Raise MissingChannelError if time, force or a motion channel is missing."""
    known = "; ".join((record.listed, *record.notes))
    missing = [
        what
        for what, is_there in (
            ("time", mapping.time),
            ("force", "force" in mapping.channels),
            ("displacement", {"velocity", "displacement"} & set(mapping.channels)),
        )
        if not is_there
    ]
    if missing:
        named = ", ".join(missing).replace("displacement", "displacement or velocity")
        advice = " ".join(f"--channel {name}=COLUMN" for name in missing)
        what = f"no column has a usual name of the {named}; name it with {advice}; the file has: {known}"
        raise record.origin.header_fault(MissingChannelError, what, channel=missing[0])


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
    if rectified_force(series):  # a reason of the verdict; the correlation with velocity says nothing
        return
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
