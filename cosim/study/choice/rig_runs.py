"""Rig runs of a study's setups: their list, their measures, the comparison, and the certainty that follows."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cosim.study.choice.assess import Knowledge
from cosim.study.choice.certainty import Certainty, ConfirmedRun
from cosim.study.choice.compare import FEWEST, Comparison, usable_deviation
from cosim.study.definition import Drive, SetupSpace, Study
from cosim.study.measures import Measure
from cosim.study.table import StudyResult
from eightpost.array_types import Array, Integers
from eightpost.display import some
from eightpost.errors import FileFormatError, InputError
from eightpost.files import plain_cell, read_text, sha256_of
from eightpost.signals import TimeSeries

# ---- Rig runs -------------------------------------------------------------------------------------------------------

#: Number of samples by which a record may be shorter than the drive.
_MISSING = 2.0


class MeasuredRun(NamedTuple):
    """One run on the rig."""

    file: Path  #: Record of the run.
    setup: int  #: Number of the setup.
    drive: str  #: Name of the drive.


class Measured(NamedTuple):
    """Measures of R runs on one or several drives."""

    setups: Integers  #: Setup number of each run (R,).
    values: Mapping[str, Array]  #: Values of each measure (R,) [SI]; NaN for runs on another drive.
    missing: Mapping[str, str]  #: Measures that cannot be computed from any run, each with the reason.


def read_run_list(path: str | Path, study: Study) -> tuple[MeasuredRun, ...]:
    """Read the list of rig runs: a CSV with a header.

    Columns: `file` (relative to the list's folder), `setup` (number) or one per corner (name of the build), and, if the
    study has several drives, `drive`. Other columns and lines that begin with # are ignored. A setup may be listed
    several times: its runs are averaged and give the run-to-run deviation.

    Args:
        path: List of runs, such as the selection.csv of a study.
        study: Study to which the setups belong.

    Raises:
        FileFormatError: The file cannot be read, a column is missing, or a line does not name a setup of the study.
    """
    path = Path(path)
    lines = read_text(path, advice="name the list of measured runs").splitlines()
    numbered = [
        (number, line) for number, line in enumerate(lines, start=1) if line.strip() and line.lstrip()[0] != "#"
    ]
    try:
        rows = list(csv.DictReader(line for _, line in numbered))
    except csv.Error as error:
        raise FileFormatError(f"cannot be read as a list of runs ({error})", path=path) from error
    if len(rows) != max(0, len(numbered) - 1):
        raise FileFormatError("a quoted cell spans several lines; write each run on one line", path=path)
    return tuple(_run(row, study, path, number) for row, (number, _) in zip(rows, numbered[1:], strict=True))


def measured_runs(runs: Sequence[MeasuredRun], study: Study, read: Callable[[Path], TimeSeries]) -> Measured:
    """Compute a study's measures from measured runs.

    A channel of the vehicle is found under its name without the component: `car.lf.tire_force` as `lf.tire_force`. The
    first sample of a record is the start of the run; the settling time is excluded as in the study.

    Raises:
        InputError: There are no runs, or a record is shorter than its drive.
    """
    if not runs:
        raise InputError("the list contains no measured runs")
    drives = {drive.name: drive for drive in study.drives}
    rows, present = [], list[tuple[str, frozenset[str]]]()
    for run in runs:
        series = read(run.file)
        rows.append(dict(_measures(series, drives[run.drive], study, run.file)))
        present.append((run.drive, frozenset(series.names)))
    names = [measure.name for measure in study.measures]
    found = {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
    values = {name: column for name, column in found.items() if np.isfinite(column).any()}
    missing = {name: _reason(study.measure(name), study, present) for name in names if name not in values}
    return Measured(np.array([run.setup for run in runs], dtype=np.int64), values, missing)


def _reason(measure: Measure, study: Study, present: Sequence[tuple[str, frozenset[str]]]) -> str:
    """Return why no run gives a measure, from the drive and the channels of each run."""
    there = [names for drive, names in present if measure.drive in ("", drive)]
    if not there:
        return f"there is no record on the drive {measure.drive!r}"
    lacking = [name for name in _rig_channels(measure, study) if any(name not in names for names in there)]
    return f"the records lack {', '.join(lacking)}" if lacking else "its value is not finite"


def comparisons(result: StudyResult, measured: Measured, certainty: Certainty | None = None) -> tuple[Comparison, ...]:
    """Compare every measure that was measured; the run-to-run deviation is pooled over setups with several runs.

    Args:
        certainty: Certainty of the study, which states intervals of the levels; None without one.

    Raises:
        InputError: A setup was not run in the study, or fewer than three setups were measured.
    """
    if unknown := sorted(set(measured.setups.tolist()) - set(result.setups.tolist())):
        raise InputError(
            f"setup {unknown[0]} was measured but not run in the study; run it, or remove it from the list"
        )
    found = [_comparison(result, name, measured.setups, values) for name, values in measured.values.items()]
    return tuple(found if certainty is None else (replace(one, true=_true(one, certainty)) for one in found))


def _true(one: Comparison, certainty: Certainty) -> Array:
    """Return the 95 % intervals of the true levels (2, K); NaN for setups whose rig runs they already contain."""
    known = {run.setup for run in certainty.runs}
    rows = [certainty.row(setup) for setup in one.setups.tolist()]
    new = [setup not in known for setup in one.setups.tolist()]
    return np.where(new, np.stack(certainty.levels[one.measure].interval(0.95))[:, rows], np.nan)


def _comparison(result: StudyResult, name: str, setups: Integers, values: Array) -> Comparison:
    predicted = dict(zip(result.setups.tolist(), result.values(name).tolist(), strict=True))
    known = np.isfinite(values) & np.isfinite([predicted[int(setup)] for setup in setups])
    numbers, places, counts = np.unique(setups[known], return_inverse=True, return_counts=True)
    if numbers.size < FEWEST:
        raise InputError(f"{name}: {numbers.size} setups were predicted and measured; {FEWEST} or more are needed")
    means = np.bincount(places, values[known]) / counts
    freedom = int(np.sum(counts - 1))
    squares = float(np.sum((values[known] - means[places]) ** 2))
    noise = float(np.sqrt(squares / freedom)) if freedom else 0.0
    return Comparison(name, numbers, np.array([predicted[int(n)] for n in numbers]), means, counts, noise)


def _run(row: Mapping[str, str | None], study: Study, path: Path, line: int) -> MeasuredRun:
    cells = {plain_cell(str(n).strip()): plain_cell(v.strip()) for n, v in row.items() if isinstance(v, str)}
    if not cells.get("file"):
        raise FileFormatError(
            f"has no record; the list needs a column `file` with the name of the record, and its columns are "
            f"{', '.join(cells) or 'empty'} (they are separated by commas)",
            path=path,
            line=line,
        )
    drive = cells.get("drive") or study.drives[0].name
    if drive not in [d.name for d in study.drives]:
        raise FileFormatError(f"there is no drive {drive!r} in the study", path=path, line=line)
    try:
        setup = _setup(cells, study.space)
    except ValueError as error:
        raise FileFormatError(str(error), path=path, line=line) from error
    return MeasuredRun(path.parent / cells["file"], setup, drive)


def _setup(cells: Mapping[str, str], space: SetupSpace) -> int:
    """Return the setup of a line, by its builds or else by its number; if both are given, they must agree."""
    builds = {corner: cells[corner] for corner in space.corners if cells.get(corner)}
    if not builds and not cells.get("setup"):
        raise InputError(
            f"there is no setup; state its number in a column `setup`, or builds at {', '.join(space.corners)}"
        )
    text = cells.get("setup", "")
    if text and not text.isdecimal():
        raise InputError(f"setup must be a number, not {text!r}")
    number = int(text) if text else None
    if not builds and number is not None:
        return space.setup(number).index
    found = space.find(builds).index
    if number is not None and found != number:
        raise InputError(
            f"setup {number} is {space.setup(number)}, but the line has {space.setup(found)}; correct the number or "
            "the builds"
        )
    return found


def _measures(series: TimeSeries, drive: Drive, study: Study, file: Path) -> Iterator[tuple[str, float]]:
    step = series.duration / (len(series) - 1) if len(series) > 1 else 0.0
    if series.duration < drive.stop - _MISSING * step:
        raise InputError(
            f"{file}: the record is {series.duration:g} s long, but the study's run on {drive.name!r} {drive.stop:g} s"
        )
    run = TimeSeries(series.time - series.time[0], series.values, series.names, series.units).window(0.0, drive.stop)
    for measure in study.measures_of(drive):
        channels = _rig_channels(measure, study)
        if all(channel in run for channel in channels):
            yield measure.name, replace(measure, channels=channels).of(run, start=study.settling)


def _rig_channels(measure: Measure, study: Study) -> tuple[str, ...]:
    return tuple(channel.removeprefix(f"{study.vehicle.name}.") for channel in measure.channels)


def compare_with_rig(
    result: StudyResult,
    path: str | Path,
    read: Callable[[Path], TimeSeries],
    measures: Sequence[str] = (),
    certainty: Certainty | None = None,
) -> tuple[int, tuple[Comparison, ...], list[str]]:
    """Compare a study's prediction with the rig runs of a list.

    Args:
        path: List of rig runs; see `read_run_list`.
        measures: Measures to compare. By default, all that do not depend on a mean, because the zero of the rig
            differs.
        certainty: Certainty of the study, which states intervals of the levels; None without one.

    Returns:
        Number of rig runs with a record, comparison of each measure, and notes about what is left out.

    Raises:
        InputError: A measure is unknown, no record of the list exists, or none of the measures can be computed.
    """
    for name in measures:
        result.study.measure(name)
    runs, notes = runs_with_records(read_run_list(path, result.study), path)
    rig = measured_runs(runs, result.study, read)
    notes += without({path: rig.missing})
    means = [] if measures else [name for name in rig.values if result.study.measure(name).absolute]
    if means:
        notes.append(f"left out, because the zero of the rig differs: {', '.join(means)}; compare one with --measure")
    names = [name for name in measures or rig.values if name in rig.values and name not in means]
    compared = comparisons(result, rig._replace(values={name: rig.values[name] for name in names}), certainty)
    if not compared:
        raise InputError(f"{path}: no measure can be compared: {'; '.join(notes)}")
    return len(runs), compared, notes


def without(missing: Mapping[str | Path, Mapping[str, str]]) -> list[str]:
    """Return a note for each reason why measures are left out, from the reasons by measure of each file."""
    found = dict[str, tuple[dict[str, None], dict[str, None]]]()
    for file, reasons in missing.items():
        for measure, reason in reasons.items():
            measures, files = found.setdefault(reason, ({}, {}))
            measures[measure], files[Path(file).name] = None, None
    return [
        f"without {', '.join(measures)}, because {reason} ({some(files)})"
        for reason, (measures, files) in found.items()
    ]  # fmt: skip


def runs_with_records(runs: Sequence[MeasuredRun], path: str | Path) -> tuple[tuple[MeasuredRun, ...], list[str]]:
    """Return the runs whose records exist, and a note about the others.

    Raises:
        InputError: No record exists.
    """
    there = tuple(run for run in runs if run.file.is_file())
    missing = [run.file.name for run in runs if not run.file.is_file()]
    if not there:
        first = f"the first is {runs[0].file}" if runs else "the list is empty"
        raise InputError(f"{path}: none of its {len(runs)} records exists; {first}")
    return there, [f"no record yet: {', '.join(missing)}"] if missing else []


# ---- Confirmation: the certainty that follows from measured levels --------------------------------------------------


def requested_runs(result: StudyResult, texts: Sequence[str]) -> tuple[tuple[MeasuredRun, ...], list[str]]:
    """Return the rig runs that arguments name, and notes about records that do not exist.

    Args:
        texts: One list of runs (a CSV file, see `read_run_list`, or a folder with a selection.csv), or one or more
            SETUP=FILE on the first drive of the study.

    Raises:
        InputError: An argument names neither, a setup was not run in the study, or no record exists.
    """
    if not any("=" in text for text in texts):
        if len(texts) != 1:
            raise InputError(f"name one list of rig runs, or each record as SETUP=FILE, not {len(texts)} files")
        path = Path(texts[0])
        path = path / "selection.csv" if path.is_dir() else path
        runs, notes = runs_with_records(read_run_list(path, result.study), path)
    else:
        runs, notes = tuple(_pair(text, result) for text in texts), []
    known = set(result.setups[result.done].tolist())
    if unknown := [run.setup for run in runs if run.setup not in known]:
        raise InputError(f"setup {unknown[0]} was measured but not run in the study; run it, or leave the record out")
    return runs, notes


def _pair(text: str, result: StudyResult) -> MeasuredRun:
    number, _, file = text.partition("=")
    if not number.strip().isdecimal() or not file:
        raise InputError(f"{text!r}: name a rig run as SETUP=FILE, such as 37=run1.csv")
    setup = result.study.space.setup(int(number)).index
    if not Path(file).is_file():
        raise InputError(f"{text!r}: there is no file {file}")
    return MeasuredRun(Path(file), setup, result.study.drives[0].name)


def with_rig_runs(
    result: StudyResult,
    known: Knowledge,
    runs: Sequence[MeasuredRun],
    read: Callable[[Path], TimeSeries],
    measures: Sequence[str] = (),
) -> tuple[Knowledge, list[str]]:
    """Return what is known with rig runs, and notes about what is left out; a record that is known counts once.

    Unless a run-to-run deviation is stated, it comes from setups that were tested several times, in all runs so far.

    Args:
        measures: Measures to take into account. By default, all that do not depend on a mean, because the zero of the
            rig differs.

    Raises:
        InputError: A measure is unknown, or none can be computed from a record.
    """
    for name in measures:
        result.study.measure(name)
    digests = {run.digest for run in known.runs}
    made, notes, missing = list[ConfirmedRun](), list[str](), dict[str | Path, Mapping[str, str]]()
    for run in runs:
        digest = sha256_of(run.file)
        if digest in digests:
            notes.append(f"{run.file.name} is taken into account already")
            continue
        digests.add(digest)
        values, missing[run.file] = _values(result, run, read, measures)
        made.append(ConfirmedRun(run.file.name, run.setup, run.drive, digest, values))
    every = (*known.runs, *made)
    earlier = repeated_noise(known.runs)
    stated = {name: value for name, value in known.run_to_run.items() if value != earlier.get(name)}
    noise = {**repeated_noise(every), **stated}
    return replace(known, runs=every, run_to_run=noise), [*notes, *without(missing)]


def _values(
    result: StudyResult, run: MeasuredRun, read: Callable[[Path], TimeSeries], measures: Sequence[str]
) -> tuple[dict[str, float], dict[str, str]]:
    """Return the wanted measures of a record, and why others cannot be computed."""
    found = measured_runs([run], result.study, read)

    def is_wanted(name: str) -> bool:
        return name in measures if measures else not result.study.measure(name).absolute

    kept = {n: float(values[0]) for n, values in found.values.items() if is_wanted(n) and np.isfinite(values[0])}
    missing = {name: reason for name, reason in found.missing.items() if is_wanted(name)}
    if not kept:
        raise InputError(
            f"{run.file}: no measure can be taken into account: {'; '.join(without({run.file: missing}))}; channels "
            "must have the names of the vehicle's, or give a channel map with --channel"
        )
    return kept, missing


def repeated_noise(runs: Sequence[ConfirmedRun]) -> Mapping[str, float]:
    """Return the run-to-run deviation of each measure from setups with several runs, pooled, SI.

    It is increased for the number of repeats; see `usable_deviation`.
    """
    found = dict[str, float]()
    for name in dict.fromkeys(name for run in runs for name in run.values):
        squares, freedom = 0.0, 0
        for setup in dict.fromkeys((run.setup, run.drive) for run in runs):
            values = [run.values[name] for run in runs if (run.setup, run.drive) == setup and name in run.values]
            if len(values) > 1:
                squares += float(np.sum((np.array(values) - np.mean(values)) ** 2))
                freedom += len(values) - 1
        if freedom:
            found[name] = usable_deviation(float(np.sqrt(squares / freedom)), freedom)
    return found
