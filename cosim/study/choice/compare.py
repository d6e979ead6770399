"""Comparison of predictions with measurements, and of runs with each other."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from cosim.study.choice.robust import REACH
from cosim.study.measures import Measure
from cosim.study.result import StudyResult
from cosim.study.setup import SetupSpace
from cosim.study.study import Drive, Study
from eightpost.array_types import Array, Integers
from eightpost.cells import plain_cell
from eightpost.errors import FileFormatError, InputError
from eightpost.files import read_text
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade, Reason, Rule, Verdict

# ---- Comparison of measured with predicted levels -------------------------------------------------------------------

Flags = NDArray[np.bool_]

#: Minimum number of setups for a best-fit line with an uncertainty.
FEWEST = 3

#: Number of simulated rig days for the attainable rank correlation, and share of them that must exceed it.
_DAYS, _BETTER = 2000, 0.95


@dataclass(frozen=True, slots=True)
class Line:
    """Best-fit line by least squares: measured = intercept + slope * predicted.

    Attributes:
        slope: Slope [1].
        intercept: Intercept, in the unit of the measure.
        scatter: Standard deviation of the measured levels about the line.
        setups: Number of setups to which the line was fitted.
        center: Mean of the predicted levels.
        breadth: Sum of squares of the predicted levels about their mean.
    """

    slope: float
    intercept: float
    scatter: float
    setups: int
    center: float
    breadth: float

    @property
    def slope_error(self) -> float:
        """Standard error of the slope [1]."""
        return float(self.scatter / np.sqrt(self.breadth))

    def at(self, predicted: Array) -> Array:
        """Return the line's level at predicted levels (K,)."""
        return np.asarray(self.intercept + self.slope * predicted, dtype=np.float64)

    def error_at(self, predicted: Array) -> Array:
        """Return the line's standard error at predicted levels (K,)."""
        return self.scatter * np.sqrt(1.0 / self.setups + (predicted - self.center) ** 2 / self.breadth)

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of the slope (Student's t; degrees of freedom: setups minus 2)."""
        reach = float(stats.t.ppf(0.5 + 0.5 * level, self.setups - 2)) * self.slope_error
        return self.slope - reach, self.slope + reach


@dataclass(frozen=True, eq=False)
class Comparison:
    """Predicted and measured levels of one measure for K setups, in one unit.

    Attributes:
        measure: Name of the measure.
        setups: Numbers of the setups (K,).
        predicted: Levels predicted by the study (K,).
        measured: Levels measured on the rig (K,), averaged over repeated runs of a setup.
        runs: Number of rig runs of each setup (K,).
        run_to_run: Standard deviation of one rig run; 0 if not known.

    Raises:
        InputError: The shapes disagree, there are fewer than three setups, or all predicted or measured levels are
            equal.
    """

    measure: str
    setups: Integers
    predicted: Array
    measured: Array
    runs: Integers
    run_to_run: float = 0.0

    def __post_init__(self) -> None:
        shapes = {self.setups.shape, self.predicted.shape, self.measured.shape, self.runs.shape}
        if len(shapes) > 1 or self.setups.size < FEWEST:
            raise InputError(
                f"{self.measure}: predicted and measured levels need the same shape, with {FEWEST} or more setups; "
                f"their shapes are {shapes}"
            )
        for what, levels in (("predicted", self.predicted), ("measured", self.measured)):
            if not np.ptp(levels) > 0.0:
                raise InputError(
                    f"{self.measure}: all {what} levels are {levels[0]:g}, so that the setups cannot be ranked by this "
                    "measure; select setups that differ in it"
                )

    @cached_property
    def line(self) -> Line:
        """Best-fit line of the measured over the predicted levels."""
        slope, intercept, *_ = stats.linregress(self.predicted, self.measured)
        residual = self.measured - intercept - slope * self.predicted
        count, center = self.setups.size, float(self.predicted.mean())
        scatter = float(np.sqrt(residual @ residual / (count - 2)))
        breadth = float(np.sum((self.predicted - center) ** 2))
        return Line(float(slope), float(intercept), scatter, count, center, breadth)

    @cached_property
    def spearman(self) -> float:
        """Spearman's rank correlation: 1 if the rig ranks the setups as the study does."""
        return float(stats.spearmanr(self.predicted, self.measured).statistic)

    @cached_property
    def kendall(self) -> float:
        """Kendall's rank correlation tau-b: share of pairs in the same order minus share in the opposite order."""
        return float(stats.kendalltau(self.predicted, self.measured).statistic)

    @cached_property
    def attainable(self) -> float:
        """Spearman's rank correlation that 95 % of rig days would reach if the true levels were on the line.

        Run-to-run noise causes the difference from 1; the value is 1 if the run-to-run deviation is not known. The
        random numbers are seeded: the same data give the same value.
        """
        if self.run_to_run == 0.0:
            return 1.0
        line = self.line.at(self.predicted)
        noise = np.random.default_rng(0).normal(size=(_DAYS, line.size)) * self.run_to_run / np.sqrt(self.runs)
        own, days = (_standard(stats.rankdata(levels, axis=-1)) for levels in (line, line + noise))
        return float(np.quantile(days @ own, 1.0 - _BETTER))

    @property
    def band(self) -> float:
        """Half-width of the band about the line: two standard deviations of a run, or of the scatter if unknown."""
        return REACH * (self.run_to_run or self.line.scatter)

    @property
    def within(self) -> Flags:
        """Whether each measured level is in the band (K,)."""
        return np.asarray(np.abs(self.measured - self.line.at(self.predicted)) <= self.band, dtype=np.bool_)

    @property
    def level_error(self) -> float:
        """RMS of predicted/measured - 1 [%]."""
        return float(100.0 * np.sqrt(np.mean((self.predicted / self.measured - 1.0) ** 2)))

    @property
    def bias(self) -> float:
        """Mean of predicted/measured - 1 [%]."""
        return float(100.0 * np.mean(self.predicted / self.measured - 1.0))


def _standard(ranks: Array) -> Array:
    """Return rows (..., K) minus their mean and scaled to length 1, so that their products are correlations."""
    centered = ranks - ranks.mean(axis=-1, keepdims=True)
    return np.asarray(centered / np.linalg.norm(centered, axis=-1, keepdims=True), dtype=np.float64)


# ---- Verdicts on a comparison of a study with the rig and on a comparison of runs -----------------------------------

ABOUT = "prediction of the rig"

WRONG_RANK = Rule(
    "setups ranked otherwise than measured", ABOUT, Grade.NOT_USABLE,
    condition="rank correlation (Spearman) of a measure below --rank",
    why="a study is run to rank setups",
    remedy="do not choose by this measure; validate the car and the shocks on rig records (eightpost validate)",
)  # fmt: skip
WRONG_LEVEL = Rule(
    "levels otherwise than measured", ABOUT, Grade.NOT_USABLE,
    condition="RMS error of a measure's levels above --level",
    why="the limits are set by the user",
    remedy="use the measure only to rank setups, or validate the car on rig records",
)  # fmt: skip
PREDICTED = Rule(
    "ranked as measured", ABOUT, Grade.USABLE,
    condition="every measure is within --rank and --level",
    why="the limits are set by the user",
    remedy="nothing",
)  # fmt: skip
OLD_RUN = Rule(
    "run without a verdict", "run", Grade.UNKNOWN,
    condition="the result.json of a compared run contains no verdict, because an older version wrote it",
    why="whether the run can be used was not recorded",
    remedy="run it again",
)  # fmt: skip

RULES: tuple[Rule, ...] = (WRONG_RANK, WRONG_LEVEL, PREDICTED, OLD_RUN)


def comparison_verdict(comparisons: Sequence[Comparison], *, rank: float, level: float | None) -> Verdict:
    """Return the verdict on comparisons of a study with the rig.

    Args:
        comparisons: Comparison of each measure.
        rank: Minimum rank correlation (Spearman).
        level: Maximum level error [%]; None for no limit.
    """
    reasons = [reason for one in comparisons for reason in _faults(one, rank, level)]
    if not reasons:
        worst = min(comparisons, key=lambda one: one.spearman)
        levels = "" if level is None else f"; level errors up to {max(one.level_error for one in comparisons):.1f} %"
        figure = f"rank correlation {worst.spearman:.3f} or more; limit {rank:g}{levels}"
        reasons = [PREDICTED.reason("the study ranks setups as the rig does", figure=figure, origin=worst.measure)]
    return Verdict(reasons)


def _faults(one: Comparison, rank: float, level: float | None) -> Iterator[Reason]:
    if not one.spearman >= rank:
        noise = "; run-to-run noise alone can explain this" if one.spearman >= one.attainable else ""
        figure = f"rank correlation {one.spearman:.3f}; limit {rank:g}{noise}"
        yield WRONG_RANK.reason("the study ranks setups differently than the rig", figure=figure, origin=one.measure)
    if level is not None and not one.level_error <= level:
        figure = f"level error {one.level_error:.1f} %; limit {level:g} %"
        yield WRONG_LEVEL.reason("the study's levels differ from those of the rig", figure=figure, origin=one.measure)


def verdict_of_runs(documents: Mapping[str, Mapping[str, Any]]) -> Verdict:
    """Return the verdict on compared runs, given their result.json by folder."""
    return Verdict(
        replace(reason, origin=f"{folder}: {reason.origin}")
        for folder, document in documents.items()
        for reason in _of_run(document).reasons
    )


def _of_run(document: Mapping[str, Any]) -> Verdict:
    try:
        return Verdict.from_json(document.get("verdict"))
    except InputError:
        statement = "the run has no verdict"
        return Verdict([OLD_RUN.reason(statement, figure="0 reasons stated", origin="result.json")])


# ---- Measured runs of a study's setups ------------------------------------------------------------------------------

#: Number of samples by which a record may be shorter than the drive.
_MISSING = 2.0


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """One run on the rig.

    Attributes:
        file: Record of the run.
        setup: Number of the setup.
        drive: Name of the drive.
    """

    file: Path
    setup: int
    drive: str


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """Measures of R runs on one or several drives.

    Attributes:
        setups: Setup number of each run (R,).
        values: Values of each measure (R,) [SI]; NaN for runs on another drive.
        missing: Measures that cannot be computed from any run, with the channels that they need.
    """

    setups: NDArray[np.int64]
    values: Mapping[str, Array]
    missing: Mapping[str, str]


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

    Args:
        runs: Measured runs.
        study: Study that defines the measures.
        read: Function that returns the channels of a record.

    Raises:
        InputError: There are no runs, or a record is shorter than its drive.
    """
    if not runs:
        raise InputError("the list contains no measured runs")
    drives = {drive.name: drive for drive in study.drives}
    rows = [dict(_measures(read(run.file), drives[run.drive], study, run.file)) for run in runs]
    names = [measure.name for measure in study.measures]
    found = {name: np.array([row.get(name, np.nan) for row in rows]) for name in names}
    values = {name: column for name, column in found.items() if np.isfinite(column).any()}
    missing = {name: ", ".join(_rig_channels(study.measure(name), study)) for name in names if name not in values}
    return Measured(np.array([run.setup for run in runs], dtype=np.int64), values, missing)


def comparisons(result: StudyResult, measured: Measured) -> tuple[Comparison, ...]:
    """Compare every measure that was measured; the run-to-run deviation is pooled over setups with several runs.

    Raises:
        InputError: A setup was not run in the study, or fewer than three setups were measured.
    """
    if unknown := sorted(set(measured.setups.tolist()) - set(result.setups.tolist())):
        raise InputError(
            f"setup {unknown[0]} was measured but not run in the study; run it, or remove it from the list"
        )
    return tuple(_comparison(result, name, measured.setups, values) for name, values in measured.values.items())


def _comparison(result: StudyResult, name: str, setups: NDArray[np.int64], values: Array) -> Comparison:
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
            "has no record; the list needs a column `file` with the name of the record", path=path, line=line
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
    number = _number(cells["setup"]) if cells.get("setup") else None
    if not builds and number is not None:
        return space.setup(number).index
    found = space.find(builds).index
    if number is not None and found != number:
        raise InputError(
            f"setup {number} is {space.setup(number)}, but the line has {space.setup(found)}; correct the number or "
            "the builds"
        )
    return found


def _number(text: str) -> int:
    if not text.isdecimal():
        raise InputError(f"setup must be a number, not {text!r}")
    return int(text)


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
