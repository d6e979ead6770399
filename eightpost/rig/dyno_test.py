"""Dynamometer tests: velocity, force and displacement of a shock, and the runs of a record."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from eightpost.array_types import Array
from eightpost.display import Summary
from eightpost.errors import MissingChannelError, WrongSignError
from eightpost.files import sha256_of
from eightpost.rig.columns import (
    DYNO_UNITS,
    check_one_time,
    choice_faults,
    column_faults,
    dyno_map,
    has_channels,
    length_note,
    propose_map,
    with_readable_columns,
)
from eightpost.rig.dyno_conditions import (
    DynoConditions,
    conditions_from,
    conditions_in,
    reversed_channels,
    stated_units,
)
from eightpost.rig.faults import PART_RULES
from eightpost.rig.motion import grouped, path_of, turning_points
from eightpost.rig.plausibility import SEGMENT, part_faults, record_faults, rectified_force
from eightpost.signals import faults
from eightpost.signals.faults import Origin
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.formats import read_record, read_records
from eightpost.signals.raw_record import ChannelMap, RawRecord, mapped_series, spread_evenly
from eightpost.signals.timeseries import Recording
from eightpost.units import shown_difference
from eightpost.verdict import Grade, Reason

if TYPE_CHECKING:
    from eightpost.report.pictures import Picture
    from eightpost.signals.timeseries import TimeSeries


# ==== Shock dynamometer tests ========================================================================================

CUTOFF = 50.0  #: Low-pass cut-off for dynamometer data in the dissertation (3.3) [Hz].
SHORTEST, FEWEST = 0.5, 200  #: Minimum duration [s] and minimum number of samples of a record.


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
        from eightpost.report.pictures import loop  # noqa: PLC0415 -- matplotlib takes long to load

        if channels or start is not None or stop is not None:
            return Recording.plot(self, channels, start=start, stop=stop)
        return loop(self.series, "velocity", "force", title=self.label)

    def judged(self, *, until: float = SEGMENT[1]) -> DynoTest:
        """Return the test with the reasons about samples and changes (`PART_RULES`) that this series has.

        The fitted seconds end at `until` [s] from the start of the series.
        """
        kept = tuple(reason for reason in self.reasons if reason.rule not in PART_RULES)
        found = part_faults(self.series, measured=self.measured, until=until)
        return replace(self, reasons=(*kept, *(fault.reason(self.label) for fault in found)))

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
        WrongSignError: The force or the displacement has the wrong sign.
    """
    reading = _Reading(Path(path), channel_map, dict(units or {}), tuple(flip), cutoff)
    records = [one for one in read_records(path) if has_channels(dyno_map(one, channel_map))]
    record = records[0] if len(records) == 1 else read_record(path)
    return reading.test(record, conditions or DynoConditions())


def dyno_test_of(
    columns: Mapping[str, Any],
    *,
    channel_map: ChannelMap | None = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
    conditions: DynoConditions | None = None,
    cutoff: float | None = None,
) -> DynoTest:
    """Return the checked test of columns in memory, as `read_dyno_test` does of those of a file.

    Args:
        columns: Vectors (N,) by column, with the unit in the name (`Force [lbf]`) or in `units`.
        channel_map: Columns by channel; see `read_dyno_test` for this and the other arguments and for the errors.
        units: Units by channel or column.
        flip: Names of the channels whose sign is changed.
        conditions: Known conditions of the test.
        cutoff: Low-pass cut-off for a derived velocity [Hz].

    Raises:
        InputError: The columns differ in length.
    """
    reading = _Reading(None, channel_map, dict(units or {}), tuple(flip), cutoff)
    return reading.test(RawRecord.in_memory(columns), conditions or DynoConditions())


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

    path: Path | None  #: Path of the file; None for columns in memory.
    channel_map: ChannelMap | None
    units: Mapping[str, str]
    flip: tuple[str, ...]
    cutoff: float | None

    def test(self, record: RawRecord, conditions: DynoConditions) -> DynoTest:
        """Return the checked test of a table."""
        units = {**stated_units(record.preamble), **self.units}
        record = record.bridged(self.channel_map.bridge if self.channel_map else 0)
        record, mapping, left_out = with_readable_columns(record, self.channel_map, units)
        stated, outward = self._stated_signs(record, mapping)
        mapping = mapping.flipped(self.flip or outward)
        _check_channels(record, mapping)
        check_one_time(record, mapping, self.channel_map)
        record = _with_even_time(record, mapping)
        units = {n: unit for n, unit in units.items() if n in (*mapping.channels, *self.units, "time")}
        series = mapped_series(record, mapping, units=units, expected=DYNO_UNITS)
        measured, origin = series.names, record.origin
        faults.check_gaps(series.time, origin=origin)
        faults.check_length(series.time, shortest=SHORTEST, fewest=FEWEST, origin=origin)
        for name in ("velocity", "displacement", "force"):
            if name in series:
                faults.check_moves(series[name], channel=name, origin=origin)
        derived: tuple[str, ...] = ()
        if "velocity" not in series:
            series, derived = _with_velocity(series, self.cutoff)
            origin = origin if len(derived) == 1 else Origin(origin.path, None, origin.header_line)
        elif "displacement" in series:
            _check_displacement_sign(series, origin, stated)
        _check_force(series, origin, derived, stated)
        written, notes = conditions_from(record.preamble)
        known = conditions.over(written)
        of_name, named = conditions_in(self.path) if self.path else (DynoConditions(), ())
        named = named if known.over(of_name) != known else ()
        signs = [f"the signs of {', '.join(outward)} were reversed, because the file states {stated!r}"] * bool(outward)
        steps = (*record.steps, *signs, *length_note(mapping), *derived, *named)
        digest = sha256_of(self.path) if self.path else ""
        test = DynoTest(series, known.over(of_name), self.path, digest, steps, (*record.notes, *notes))
        found = (
            *left_out,
            *record_faults(series, measured=measured, conditions=test.conditions),
            *column_faults(record, mapping, series),
            *choice_faults(record, mapping, self.channel_map),
        )
        reasons = tuple(fault.reason(test.label) for fault in found)
        turned = next((reason for reason in reasons if reason.rule == "negative force at standstill"), None)
        if stated and turned is not None:
            what = (
                f"the file states {stated!r}, but then {turned.statement} ({turned.figure}); name the channels to "
                "reverse with --channel, which replaces the statement, or confirm it with "
                + (" ".join(f"--channel {name}=-" for name in outward) or "--channel force=+")
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
    old = record.column(place)
    if (new := spread_evenly(old)) is old:
        return record
    moved = float(np.abs(new - old).max())
    note = f"the times were rounded to whole numbers; they were spread evenly, which moved them by at most {moved:.2g}"
    return replace(record.with_column(place, new), steps=(*record.steps, note))


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


def _check_force(series: TimeSeries, origin: Origin, derived: tuple[str, ...], stated: str) -> None:
    """Check the sign of the force by its correlation with the velocity."""
    velocity, force = series["velocity"], series["force"]
    if rectified_force(series):  # a reason of the verdict; the correlation with velocity says nothing
        return
    against = "the velocity derived from displacement" if derived else "velocity"
    faults.check_sign(force, velocity, channel="force", against=against, origin=origin, stated=stated)


def _check_displacement_sign(series: TimeSeries, origin: Origin, stated: str) -> None:
    """Check the displacement's sign by comparison with the measured velocity."""
    rate, velocity = series.sample_rate, series["velocity"]
    slope = velocity_from_displacement(series["displacement"], rate, _default_cutoff(rate))
    faults.check_sign(slope, velocity, channel="displacement", against="velocity", origin=origin, stated=stated)


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


# ==== Splitting at pauses and at changes of amplitude or frequency of a sine =========================================

REST_SHARE = 0.01  #: The shock is at rest if it moves by less than this share of the record's stroke, ...
PAUSE = 0.5  #: ... for at least this time [s], ...
#: ... and for this share of the adjacent half cycle: a sine stays within 1 % of its stroke for 13 % of a half cycle.
PAUSE_SHARE = 0.5
ALIKE = 0.1  #: Half cycles belong to one block if stroke and duration are within this share of the block's median.
SMALLEST = 0.02  #: Minimum stroke of a half cycle, as a share of the stroke of the section; smaller motions are noise.
FEWEST_HALVES = 6  #: Minimum number of half cycles in a block.
#: Minimum share of a section that blocks must fill. Otherwise the section is one run, for example a random drive.
FILLED = 0.75


@dataclass(frozen=True, slots=True)
class _Half:
    """A half cycle between two turning points: samples, stroke [m], duration [s]."""

    start: int
    stop: int
    stroke: float
    duration: float

    def like(self, block: list[_Half]) -> bool:
        """Return whether the half cycle belongs to a block."""
        stroke, duration = np.median([half.stroke for half in block]), np.median([half.duration for half in block])
        return bool(abs(self.stroke - stroke) <= ALIKE * stroke and abs(self.duration - duration) <= ALIKE * duration)


def split_runs(test: DynoTest) -> tuple[DynoTest, ...]:
    """Split a record into its runs.

    1. A *pause* is a time of at least half a second in which the shock moves by less than 1 % of the record's stroke.
       It must last at least half as long as the adjacent half cycle, because a slow sine is nearly at rest at its ends.
       The record is split at pauses, and pauses are left out.
    2. A section between pauses is divided into half cycles at its turning points. Three or more consecutive cycles
       whose stroke and duration are within 10 % of their median are a *block*. If blocks fill three quarters of the
       section, each block is a run, and the cycles in between (in which the machine changes speed) are left out.
       Otherwise, as in a random drive, the section is one run.
    3. Runs with less than 0.5 s or 200 samples are left out, and a note of the first run says so.

    If displacement is unknown, the integral of velocity is used instead. The times are not shifted.

    Returns:
        Runs in their order, or only the test itself if there is nothing to split.
    """
    path = path_of(test.series)
    stretches = _stretches(test, path)
    pieces = [piece for stretch in stretches for piece in _blocks(test, path, *stretch)]
    time = test.series.time
    kept = [(start, stop) for start, stop in pieces
            if stop - start >= FEWEST and float(time[stop - 1] - time[start]) >= SHORTEST]  # fmt: skip
    if len(kept) < 2 and len(pieces) < 2:
        return (test,)
    runs = [_run(test, *piece, f"run {i} of {len(kept)}") for i, piece in enumerate(kept, 1)]
    if runs and len(kept) < len(pieces):
        count = len(pieces) - len(kept)
        left_out = f"{count} runs with less than {SHORTEST:g} s or {FEWEST} samples are left out"
        runs[0] = replace(runs[0], notes=(left_out, *runs[0].notes))
    return tuple(runs) or (test,)


def _stretches(test: DynoTest, path: Array) -> list[tuple[int, int]]:
    """Return the first sample and the sample after the last of each section between pauses."""
    width = max(3, round(PAUSE * test.series.sample_rate))
    if width >= path.size:
        return [(0, path.size)]
    moved = maximum_filter1d(path, width) - minimum_filter1d(path, width)
    still = moved < REST_SHARE * float(np.ptp(path))
    # If a window is at rest, all of its samples belong to the pause, not only the middle one.
    resting = maximum_filter1d(still.astype(np.int8), width).astype(bool)
    turns = np.array(turning_points(path, threshold=SMALLEST * float(np.ptp(path))))
    for start, stop in faults.runs(resting):
        # The number of samples between a pause and the farther of the two adjacent turning points
        before, after = turns[turns < start], turns[turns >= stop]
        half_cycle_beside = float(max(start - before[-1] if before.size else 0, after[0] - stop if after.size else 0))
        if stop - start < PAUSE_SHARE * half_cycle_beside:
            resting[start:stop] = False
    return faults.runs(~resting) or [(0, path.size)]


def _blocks(test: DynoTest, path: Array, start: int, stop: int) -> list[tuple[int, int]]:
    """Return the steady sines of a section, or the whole section if they do not fill it."""
    blocks = grouped(_halves(test.series.time[start:stop], path[start:stop], start), _Half.like)
    steady = [block for block in blocks if len(block) >= FEWEST_HALVES]
    filled = sum(block[-1].stop - block[0].start for block in steady)
    if len(steady) < 2 or filled < FILLED * (stop - start):
        return [(start, stop)]
    return [(block[0].start, block[-1].stop) for block in steady]


def _halves(time: Array, path: Array, offset: int) -> list[_Half]:
    """Return the half cycles between turning points at least 2 % of the section's stroke apart."""
    turns = turning_points(path, threshold=SMALLEST * float(np.ptp(path)))
    return [
        _Half(a + offset, b + offset, float(abs(path[b] - path[a])), float(time[b] - time[a]))
        for a, b in pairwise(turns)
    ]


def _run(test: DynoTest, start: int, stop: int, name: str) -> DynoTest:
    series = test.series.window(test.series.time[start], test.series.time[stop - 1])
    section = f"{name}: {series.time[0]:.4g} to {series.time[-1]:.4g} s of the record"
    return replace(test, series=series, derived=(*test.derived, section), notes=()).judged()


# ==== Effect of temperature on the force =============================================================================

REPEATED = 0.05  #: Runs are repetitions if the standard deviations of their velocities agree within this share.
SMALLEST_SPREAD = 1.0  #: Minimum range of temperature [K] for an estimate.


@dataclass(frozen=True, slots=True)
class TemperatureEffect:
    """Change of force with temperature, estimated from repeated runs."""

    per_kelvin: float  #: Relative change of the force's standard deviation [1/K]; negative if the shock becomes softer.
    error: float  #: Standard error of per_kelvin [1/K]; NaN if it is determined exactly by two runs.
    runs: int  #: Number of runs.
    spread: float  #: Range of the mean temperatures of the runs [K].

    def __str__(self) -> str:
        (degrees, unit), (spread, _) = shown_difference(1.0), shown_difference(self.spread)
        slope, error = 100.0 * self.per_kelvin / degrees, 100.0 * self.error / degrees
        known = "unknown" if np.isnan(error) else f"{error:.2f}"
        return (
            f"force changes by {slope:+.2f} %/{unit} (standard error {known}), from {self.runs} repeated runs "
            f"over a range of {spread:.1f} {unit}"
        )


def temperature_effect(tests: Iterable[DynoTest]) -> TemperatureEffect | None:
    """Estimate the change of force with temperature from runs that repeat each other.

    The model log(standard deviation of force) = g_k + b T is fitted by least squares. The groups k are runs with the
    same velocity (standard deviation within 5 %); within a group, the force is assumed proportional to the velocity.
    The result is None if no runs are repeated, or if their temperatures differ by less than 1 K.

    Args:
        tests: Runs from `split_runs` or from several files of one build.
    """
    known = [test for test in tests if "temperature" in test.series]
    temperatures, logs = [], []
    for group in runs_of_one_speed(known):
        if len(group) > 1:
            heat = np.array([test.series["temperature"].mean() for test in group])
            force = np.array([np.log(test.series["force"].std() / test.series["velocity"].std()) for test in group])
            temperatures.append(heat - heat.mean())
            logs.append(force - force.mean())
    if not temperatures or max(float(np.ptp(heat)) for heat in temperatures) < SMALLEST_SPREAD:
        return None
    heat, force = np.concatenate(temperatures), np.concatenate(logs)
    slope = float(heat @ force / (heat @ heat))
    free = heat.size - len(temperatures) - 1
    residual = force - slope * heat
    error = float(np.sqrt(residual @ residual / free / (heat @ heat))) if free > 0 else float("nan")
    spread = max(float(np.ptp(group)) for group in temperatures)
    return TemperatureEffect(slope, error, heat.size, spread)


def runs_of_one_speed(tests: Iterable[DynoTest]) -> list[list[DynoTest]]:
    """Return the runs in groups with the same standard deviation of velocity, slow ones first."""

    def speed(test: DynoTest) -> float:
        return float(test.series["velocity"].std())

    return grouped(sorted(tests, key=speed), lambda test, group: speed(test) <= (1.0 + REPEATED) * speed(group[0]))


def temperature_drift(series: TimeSeries) -> float:
    """Return the change of temperature [K] over a record, from the mean of its first tenth to that of its last."""
    values = series["temperature"]
    tenth = max(1, values.size // 10)
    return float(values[-tenth:].mean() - values[:tenth].mean())
