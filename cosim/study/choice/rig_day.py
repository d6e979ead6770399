"""A study on the rig: setups to confirm, the list of their runs, their measures, and the certainty that follows."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np

from cosim.study.choice.assess import Knowledge
from cosim.study.choice.certainty import OBJECTIVE, Certainty, ConfirmedRun
from cosim.study.choice.compare import FEWEST, Comparison, usable_deviation
from cosim.study.choice.sensitivity import levels_of
from cosim.study.definition import Drive, Setup, SetupSpace, Study
from cosim.study.measures import Measure
from cosim.study.table import StudyResult
from eightpost import units
from eightpost.array_types import Array, Integers
from eightpost.display import some
from eightpost.errors import FileFormatError, InputError
from eightpost.files import MALFORMED, atomic_path, plain_cell, read_text, sha256_of, write_rows
from eightpost.signals import TimeSeries

# ---- Selection of low and high setups of each measure for the rig, spread over the bank (7.3, Table 7.5) ------------

#: Low or high in a measure, or a test that the certainty of the study proposes.
End = Literal["low", "high", "test"]

_ENDS: tuple[End, ...] = get_args(End)

#: Factor on the values of a measure that puts each end first.
ENDS: Mapping[End, float] = {"low": 1.0, "high": -1.0}

#: Share of the setups at each end from which to choose: 48 of 2401.
POOL = 0.02

#: Minimum number of candidates per selected setup, for small banks.
_CANDIDATES = 4

#: Number of setups that the dissertation tested on a rig day (Table 7.5).
TOTAL = 20


@dataclass(frozen=True, slots=True)
class Selected:
    """A setup to confirm on the rig."""

    setup: Setup  #: The setup.
    measure: str  #: Measure for which the setup was selected; for a proposed test of the objective, its first measure.
    end: End  #: Whether the setup is low or high in the measure, or a proposed test.
    value: float  #: Predicted value [SI].
    rank: int  #: Position from that end, for a test from the low end; 1 for the extreme setup.
    marks: str = ""  #: Marks of the prediction, such as a tire off the ground.


@dataclass(frozen=True, slots=True)
class Selection:
    """Setups to confirm on the rig, each once."""

    #: Setups in the order: proposed tests, low ones of the first measure, its high ones, those of the next measure, and
    #: so on.
    chosen: tuple[Selected, ...]
    closest: int  #: Minimum number of corners (or groups of corners that are alike) in which two of them differ.

    @property
    def setups(self) -> dict[str, set[int]]:
        """Numbers of the setups by the measure for which they were chosen."""
        return {name: {one.setup.index for one in self.of(name)} for name in (s.measure for s in self.chosen)}

    def of(self, measure: str) -> tuple[Selected, ...]:
        """Return the setups that were chosen for a measure, low ones first."""
        return tuple(selected for selected in self.chosen if selected.measure == measure)


def select(
    result: StudyResult,
    measures: Sequence[str] = (),
    *,
    total: int = TOTAL,
    share: Mapping[str, int] | None = None,
    pool: float = POOL,
    certainty: Certainty | None = None,
) -> Selection:
    """Choose setups to confirm on the rig; the same input gives the same setups.

    The tests that decide most about the best setup come first, if the certainty of the study is known. Setups that
    failed or break a constraint are excluded.

    Args:
        measures: Measures to confirm; empty: those of the objective, or all if the study has no objective.
        total: Total number of setups. Those that are not proposed tests are divided equally among the ends of all
            measures; the first ones get the remainder.
        share: Number of setups at each end by measure (Table 7.5 has 4, 4 and 2); replaces `measures` and `total`;
            proposed tests come in addition.
        pool: Share of the setups at each end from which to choose [1].
        certainty: Certainty of the study, whose next tests are selected; None selects none.

    Raises:
        InputError: A measure is not in the study, there are fewer setups than requested, or fewer are requested than
            there are ends of measures.
    """
    rows, tests = np.flatnonzero(result.feasible), list[Selected]()
    if share is None:
        names = _names(result, measures, total)
        tests = _tests(result, rows, certainty, total - 2 * len(names))
        each, left = divmod((total - len(tests)) // 2, len(names))
        counts: Mapping[str, int] = {name: each + (place < left) for place, name in enumerate(names)}
    else:
        counts = share
        tests = _tests(result, rows, certainty, rows.size - 2 * sum(share.values()))
    if (requested := 2 * sum(counts.values())) > rows.size:
        raise InputError(
            f"{requested} setups cannot be selected, because only {rows.size} ran and meet the constraints"
        )
    levels = levels_of(result.study.space, result.setups)
    orders = {(name, end): _order(rows, result.values(name) * sign) for name in counts for end, sign in ENDS.items()}
    found: dict[tuple[str, End], list[int]] = {key: [] for key in orders if counts[key[0]]}
    taken = [int(np.flatnonzero(result.setups == test.setup.index)[0]) for test in tests]
    for key, own in found.items():
        own.append(int(orders[key][~np.isin(orders[key], taken)][0]))
        taken.append(own[0])
    for key, extreme in found.items():
        extreme.extend(_spread(orders[key], levels, taken, counts[key[0]] - 1, pool))
    chosen = [_selected(result, key, row, orders[key]) for key, group in found.items() for row in group]
    return selection_of(result, [*tests, *chosen])


def selection_of(result: StudyResult, chosen: Sequence[Selected]) -> Selection:
    """Return a selection of setups of a study."""
    levels = levels_of(result.study.space, np.array([selected.setup.index for selected in chosen], dtype=np.int64))
    apart = (levels[:, None, :] != levels[None, :, :]).sum(axis=2)
    pairs = apart[np.triu_indices(levels.shape[0], 1)]
    return Selection(tuple(chosen), int(pairs.min()) if pairs.size else 0)


def _tests(result: StudyResult, rows: Integers, certainty: Certainty | None, most: int) -> list[Selected]:
    if certainty is None or most <= 0:
        return []
    is_sum = certainty.criterion == OBJECTIVE
    name = result.study.objective[0].measure if is_sum else certainty.criterion
    order, places = _order(rows, result.values(name)), {int(result.setups[row]): int(row) for row in rows}
    found = [places[test.setup] for test in certainty.tests if test.setup in places]
    return [_selected(result, (name, "test"), row, order) for row in found[:most]]


def _names(result: StudyResult, measures: Sequence[str], total: int) -> list[str]:
    """Return the measures to confirm, at both ends each."""
    objective = dict.fromkeys(term.measure for term in result.study.objective)
    names = list(measures or objective or (measure.name for measure in result.measures))
    for name in names:
        result.study.measure(name)
    if total // 2 < len(names):
        raise InputError(
            f"{total} setups are too few for both ends of {len(names)} measures; select {2 * len(names)} or more"
        )
    return names


def _order(rows: Integers, values: Array) -> Integers:
    return rows[np.lexsort((rows, values[rows]))]


def _spread(order: Integers, levels: Integers, taken: list[int], count: int, pool: float) -> list[int]:
    """Take `count` more rows from the first ones of an order, each as different as possible from all rows taken."""
    free = order[~np.isin(order, taken)]
    candidates, own = free[: max(round(pool * order.size), _CANDIDATES * count)], list[int]()
    while len(own) < count:
        candidates = candidates[~np.isin(candidates, taken)]
        apart = (levels[candidates][:, None, :] != levels[taken][None, :, :]).sum(axis=2)
        best = int(candidates[np.lexsort((-apart.sum(axis=1), -apart.min(axis=1)))[0]])
        own.append(best)
        taken.append(best)
    return own


def _selected(result: StudyResult, key: tuple[str, End], row: int, order: Integers) -> Selected:
    name, end = key
    rank = int(np.flatnonzero(order == row)[0]) + 1
    marks: str = result.table["marks"][row]
    return Selected(result.setup(row), name, end, float(result.values(name)[row]), rank, marks)


# ---- CSV file of the setups to test on the rig, to which the measured runs are added --------------------------------

#: Number of baseline runs, from which the run-to-run deviation is computed (7.3).
BASELINE_RUNS = 5

#: Number of selected setups that are run twice: what drifts from run to run moves other setups more than the baseline.
TWICE = 4


def write_selection(selection: Selection, result: StudyResult, path: str | Path, *, twice: int = TWICE) -> None:
    """Write the setups to test, one line each, then second runs of some, then the runs of the baseline if there is one.

    The column `file` names the record that `eightpost study compare --measured` reads from the folder of the list.

    Args:
        twice: Maximum number of setups with a second run; see `repeated`.
    """
    corners = tuple(result.study.corners)
    rows = [_row(number, result, selected.setup.index) for number, selected in enumerate(selection.chosen, start=1)]
    for row, selected in zip(rows, selection.chosen, strict=True):
        unit = result.display(selected.measure)
        predicted = float(units.convert(selected.value, result.unit(selected.measure), unit))
        row |= {"measure": selected.measure, "end": selected.end, "predicted": f"{predicted:.6g}", "unit": unit}
        row |= {"place": str(selected.rank), "marks": selected.marks}
    baseline = result.study.baseline_setup
    runs = [("repeat", setup) for setup in repeated(selection, twice)]
    runs += [("baseline", baseline.index)] * BASELINE_RUNS if baseline is not None else []
    rows += [{**_row(number, result, setup), "end": end} for number, (end, setup) in enumerate(runs, len(rows) + 1)]
    names = ("run", "file", "setup", *corners, "measure", "end", "predicted", "unit", "place", "marks")
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        write_rows(stream, [names, *([row.get(name, "") for name in names] for row in rows)], end="\r\n")


def repeated(selection: Selection, twice: int = TWICE) -> list[int]:
    """Return the numbers of at most `twice` setups that are run again: the first one of each end of each measure."""
    ends = [one for one in selection.chosen if one.end in ENDS]
    first = {(one.measure, one.end): one.setup.index for one in reversed(ends)}
    return list(first.values())[::-1][:twice]


def read_selection(path: str | Path, result: StudyResult) -> Selection:
    """Read a list of `write_selection` for the same study; values are taken from the study.

    Raises:
        FileFormatError: The file is not a selection of this study.
    """
    path = Path(path)
    text = read_text(path)
    try:
        heads, *lines = csv.reader(io.StringIO(text, newline=""))
        rows = [dict(zip(map(plain_cell, heads), map(plain_cell, line), strict=True)) for line in lines if line]
        return selection_of(result, [_read(row, end, result) for row in rows for end in _ENDS if end == row["end"]])
    except (csv.Error, *MALFORMED) as error:
        raise FileFormatError(
            f"is not a selection of this study ({error}); run `eightpost study select` again", path=path
        ) from error


def _read(row: dict[str, str], end: End, result: StudyResult) -> Selected:
    setup = result.study.space.setup(int(row["setup"]))
    if (place := result.row(setup.builds)) is None:
        raise InputError(f"setup {setup.index} was not run in the study")
    value = float(result.values(row["measure"])[place])
    return Selected(setup, row["measure"], end, value, int(row["place"]), row["marks"])


def _row(number: int, result: StudyResult, setup: int) -> dict[str, str]:
    builds = result.study.space.setup(setup).builds
    return {"run": str(number), "file": f"run_{number:02d}.parquet", "setup": str(setup), **builds}


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
    rows, present = [], list[tuple[str, tuple[str, ...]]]()
    for run in runs:
        series = read(run.file)
        rows.append(dict(_measures(series, drives[run.drive], study, run.file)))
        present.append((run.drive, series.names))
    values, missing = dict[str, Array](), dict[str, str]()
    for measure in study.measures:
        column = np.array([row.get(measure.name, np.nan) for row in rows])
        there = [names for drive, names in present if measure.drive in ("", drive)]
        lacking = [name for name in _rig_channels(measure, study) if any(name not in names for names in there)]
        if np.isfinite(column).any():
            values[measure.name] = column
        elif not there:
            missing[measure.name] = f"there is no record on the drive {measure.drive!r}"
        else:
            missing[measure.name] = f"the records lack {', '.join(lacking)}" if lacking else "its value is not finite"
    return Measured(np.array([run.setup for run in runs], dtype=np.int64), values, missing)


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
    return tuple(_comparison(result, name, measured.setups, v, certainty) for name, v in measured.values.items())


def _comparison(
    result: StudyResult, name: str, setups: Integers, values: Array, certainty: Certainty | None
) -> Comparison:
    predicted = dict(zip(result.setups.tolist(), result.values(name).tolist(), strict=True))
    known = np.isfinite(values) & np.isfinite([predicted[int(setup)] for setup in setups])
    numbers, places, counts = np.unique(setups[known], return_inverse=True, return_counts=True)
    if numbers.size < FEWEST:
        raise InputError(f"{name}: {numbers.size} setups were predicted and measured; {FEWEST} or more are needed")
    means = np.bincount(places, values[known]) / counts
    freedom = int(np.sum(counts - 1))
    squares = float(np.sum((values[known] - means[places]) ** 2))
    noise = float(np.sqrt(squares / freedom)) if freedom else 0.0
    true = None
    if certainty is not None:
        rows = [certainty.row(setup) for setup in numbers.tolist()]
        used = np.isin(numbers, [run.setup for run in certainty.runs])  # the intervals contain their rig runs already
        true = np.where(used, np.nan, np.stack(certainty.levels[name].interval(0.95))[:, rows])
    return Comparison(name, numbers, np.array([predicted[int(n)] for n in numbers]), means, counts, noise, true)


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
    runs, notes = _runs_with_records(read_run_list(path, result.study), path)
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


def _runs_with_records(runs: Sequence[MeasuredRun], path: str | Path) -> tuple[tuple[MeasuredRun, ...], list[str]]:
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
        runs, notes = _runs_with_records(read_run_list(path, result.study), path)
    else:
        runs, notes = tuple(_pair(text, result) for text in texts), []
    if unknown := [run.setup for run in runs if run.setup not in result.setups[result.done]]:
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
    made, repeated, missing = list[ConfirmedRun](), list[str](), dict[str | Path, Mapping[str, str]]()
    for run in runs:
        digest = sha256_of(run.file)
        if digest in digests:
            repeated.append(run.file.name)
            continue
        digests.add(digest)
        values, missing[run.file] = _values(result, run, read, measures)
        made.append(ConfirmedRun(run.file.name, run.setup, run.drive, digest, values))
    every = (*known.runs, *made)
    earlier = _repeated_noise(known.runs)
    stated = {name: value for name, value in known.run_to_run.items() if value != earlier.get(name)}
    noise = {**_repeated_noise(every), **stated}
    notes = [f"taken into account already: {some(repeated)}"] if repeated else []
    return replace(known, runs=every, run_to_run=noise), [*notes, *without(missing)]


def _values(
    result: StudyResult, run: MeasuredRun, read: Callable[[Path], TimeSeries], measures: Sequence[str]
) -> tuple[dict[str, float], dict[str, str]]:
    """Return the wanted measures of a record, and why others cannot be computed."""
    found = measured_runs([run], result.study, read)
    wanted = measures or [measure.name for measure in result.measures if not measure.absolute]
    kept = {name: float(values[0]) for name, values in found.values.items() if name in wanted}
    missing = {name: reason for name, reason in found.missing.items() if name in wanted}
    if not kept:
        raise InputError(
            f"{run.file}: no measure can be taken into account: {'; '.join(without({run.file: missing}))}; channels "
            "must have the names of the vehicle's, or give a channel map with --channel"
        )
    return kept, missing


def _repeated_noise(runs: Sequence[ConfirmedRun]) -> Mapping[str, float]:
    """Return the run-to-run deviation of each measure from setups with several runs, pooled, SI.

    It is increased for the number of repeats; see `usable_deviation`.
    """
    found = dict[str, float]()
    for name in dict.fromkeys(name for run in runs for name in run.values):
        values = dict[tuple[int, str], list[float]]()
        for run in (run for run in runs if name in run.values):
            values.setdefault((run.setup, run.drive), []).append(run.values[name])
        squares = sum(float(np.sum((np.array(one) - np.mean(one)) ** 2)) for one in values.values())
        if freedom := sum(len(one) - 1 for one in values.values()):
            found[name] = usable_deviation(float(np.sqrt(squares / freedom)), freedom)
    return found
