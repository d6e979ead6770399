"""Dynamometer tests: velocity, force and displacement of a shock."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.display import Summary
from eightpost.errors import MissingChannelError, WrongSignError
from eightpost.files import sha256_of
from eightpost.rig.dyno_columns import DYNO_UNITS, choice_reasons, dyno_map, has_channels, length_note
from eightpost.rig.dyno_conditions import DynoConditions, conditions_from
from eightpost.rig.file_name import conditions_in
from eightpost.rig.optional_columns import check_one_time, with_readable_columns
from eightpost.rig.other_columns import column_reasons
from eightpost.rig.plausibility import SEGMENT, part_reasons, record_reasons, rectified_force
from eightpost.rig.plausibility_rules import NEGATIVE_REST, PART_RULES
from eightpost.rig.rig_columns import propose_map
from eightpost.rig.stated_conventions import reversed_channels, stated_units
from eightpost.signals import faults
from eightpost.signals.channel_map import ChannelMap
from eightpost.signals.faults import Origin
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.formats import read_record, read_records
from eightpost.signals.raw_record import mapped_series
from eightpost.signals.recording import Recording
from eightpost.signals.time_axes import spread_evenly
from eightpost.verdict import Grade, Reason

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
    """A dynamometer test that passed all checks."""

    #: Record with `velocity` [m/s] and `force` [N], and if known `displacement` [m] and `temperature` [K]; all except
    #: the temperature are positive in compression.
    series: TimeSeries
    #: Build, clicks, gas pressure and other known conditions.
    conditions: DynoConditions = field(default_factory=DynoConditions)
    source: Path | None = None  #: Path of the file, None for a record created in memory.
    sha256: str = ""  #: SHA-256 digest of the file, empty without a file.
    derived: tuple[str, ...] = ()  #: Descriptions of what was computed, or read in one of several possible ways.
    notes: tuple[str, ...] = ()  #: Notes of the reader: what it left out or could not read.
    #: Findings about the record and notes (`eightpost.rig.plausibility`), as reasons of a verdict.
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
    def measured(self) -> tuple[str, ...]:
        """Names of the channels that were measured, not derived."""
        is_derived = any(what.startswith("velocity from") for what in self.derived)
        return tuple(name for name in self.series.names if not (is_derived and name == "velocity"))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Notes, those of the reader first: what asks for attention and leaves the record usable."""
        return (*self.notes, *_sentences(reason for reason in self.reasons if reason.grade is Grade.USABLE))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Findings that limit the use of the record."""
        return _sentences(reason for reason in self.reasons if reason.grade is not Grade.USABLE)

    def _summary(self) -> Summary:
        known = self.conditions
        stated = [text for text in (known.build, known.clicks, known.run) if text]
        return Summary.of(
            "Dynamometer test",
            ("file", self.source.name if self.source else ""),
            ("conditions", ", ".join(stated)),
            *self.series.summary_rows(),
            ("derived", "; ".join(self.derived)),
            ("notes", "; ".join(self.remarks)),
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
        """Return the test with the reasons about samples and changes (`PART_RULES`) that this series has.

        Args:
            until: End of the fitted seconds, from the start of the series [s].
        """
        kept = tuple(reason for reason in self.reasons if reason.rule not in PART_RULES)
        found = part_reasons(self.series, measured=self.measured, origin=self.label, until=until)
        return replace(self, reasons=(*kept, *found))

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
    offset of the force (static gas force, rod weight) is not removed. Findings that leave the record usable are the
    test's reasons.

    Args:
        path: Path of a file in one of the formats of docs/reference/dyno_files.md.
        channel_map: Columns by channel, for columns with unusual names.
        units: Units by channel name, for columns without a unit in the header.
        flip: Names of the channels whose sign is changed; they replace the signs that the file states. `none`: none.
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


def _sentences(reasons: Iterable[Reason]) -> tuple[str, ...]:
    return tuple(f"{reason.statement}: {reason.figure}; {reason.remedy}" for reason in reasons)


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
        stated, outward = self._stated_signs(record, mapping)
        mapping = mapping.flipped(self.flip or outward)
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
            _check_displacement_sign(series, origin, stated)
        _check_force(series, origin, derived, stated)
        written, notes = conditions_from(record.preamble)
        known = conditions.over(written)
        of_name, named = conditions_in(self.path)
        named = named if known.over(of_name) != known else ()
        signs = [f"the signs of {', '.join(outward)} were reversed, because the file states {stated!r}"] * bool(outward)
        steps = (*record.steps, *signs, *length_note(mapping), *derived, *named)
        test = DynoTest(series, known.over(of_name), self.path, sha256_of(self.path), steps, (*record.notes, *notes))
        reasons = (
            *left_out,
            *record_reasons(series, measured=measured, origin=test.label, conditions=test.conditions),
            *column_reasons(record, mapping, series, test.label),
            *choice_reasons(record, mapping, self.channel_map, test.label),
        )
        turned = next((reason for reason in reasons if reason.rule == NEGATIVE_REST.name), None)
        if stated and turned is not None:
            what = (
                f"the file states {stated!r}, but then {turned.statement} ({turned.figure}); name the channels to "
                "negate with --flip, which replaces the statement, or confirm it with "
                + (" ".join(f"--flip {name}" for name in outward) or "--flip none")
            )
            raise record.origin.header_fault(WrongSignError, what, channel="force")
        return replace(test, reasons=reasons).judged()

    def _stated_signs(self, record: RawRecord, mapping: ChannelMap) -> tuple[str, tuple[str, ...]]:
        """Return what a file states about its signs, and the channels to negate; empty if the caller named some.

        A channel that the map reverses already, such as a length, has its sign from there.
        """
        if self.flip:
            return "", ()
        columns = ((f"{name} {pick.source}".replace(",", " "),) for name, pick in mapping.channels.items())
        stated, statement = reversed_channels((*record.preamble, *columns), record.origin.path or Path())
        return statement, tuple(n for n, pick in mapping.channels.items() if stated.get(n) and pick.gain > 0.0)


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
    if missing and (proposed := propose_map(record)):
        what = f"the file {proposed.finding}, not a dynamometer's; `eightpost inspect` proposes its channel map"
        raise record.origin.header_fault(MissingChannelError, what, channel=missing[0])
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


def _check_force(series: TimeSeries, origin: Origin, derived: tuple[str, ...], stated: str) -> None:
    """Check the force for clipping, and its sign by its correlation with the velocity."""
    velocity, force = series["velocity"], series["force"]
    faults.check_not_clipped(force, channel="force", origin=origin, against=velocity)
    if rectified_force(series):  # a reason of the verdict; the correlation with velocity says nothing
        return
    against = "the velocity derived from displacement" if derived else "velocity"
    faults.check_sign(force, velocity, channel="force", against=against, origin=origin, stated=stated)


def _check_displacement_sign(series: TimeSeries, origin: Origin, stated: str) -> None:
    """Check the displacement's sign by comparison with the measured velocity."""
    rate = series.sample_rate
    slope = velocity_from_displacement(series["displacement"], rate, _default_cutoff(rate))
    against = "velocity"
    faults.check_sign(slope, series[against], channel="displacement", against=against, origin=origin, stated=stated)


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
