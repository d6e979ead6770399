"""Comparison of predictions with measurements, and of runs with each other."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import with_config
from typing_extensions import TypedDict  # pydantic needs it before Python 3.12

from cosim.session.result import Result, SavedRun
from cosim.study.measures import Measure, available, channel_measures, ride_measures
from cosim.study.table import StudyResult
from eightpost import __version__, units
from eightpost.array_types import Array, Flags, Integers
from eightpost.display import Summarized, Summary, some
from eightpost.errors import FileFormatError, InputError
from eightpost.files import atomic_path, json_content
from eightpost.labelled import data_frame
from eightpost.schema import OPEN, document_of
from eightpost.signals import TimeSeries
from eightpost.verdict import Reason, Rules, Verdict, is_intact, sealed

if TYPE_CHECKING:
    import pandas as pd

    from eightpost.report.pictures import Axes, Figure, Picture

# ---- Comparison of measured with predicted levels -------------------------------------------------------------------

#: Half-width of a band, in standard deviations (Fig 7.7).
REACH = 2.0

#: Minimum number of setups for a best-fit line with an uncertainty.
FEWEST = 3

#: Number of simulated rig days for the attainable rank correlation, and share of them that must exceed it.
_DAYS, _BETTER = 2000, 0.95

#: Probability below the upper end of a 95 % interval.
_UPPER = 0.975


@dataclass(frozen=True, slots=True)
class Line:
    """Best-fit line by least squares: measured = intercept + slope * predicted."""

    slope: float  #: Slope [1].
    intercept: float  #: Intercept, in the unit of the measure.
    scatter: float  #: Standard deviation of the measured levels about the line.
    setups: int  #: Number of setups to which the line was fitted.
    center: float  #: Mean of the predicted levels.
    breadth: float  #: Sum of squares of the predicted levels about their mean.

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
        reach = float(scipy.stats.t.ppf(0.5 + 0.5 * level, self.setups - 2)) * self.slope_error
        return self.slope - reach, self.slope + reach


@dataclass(frozen=True, eq=False)
class Comparison:
    """Predicted and measured levels of one measure for K setups, in one unit.

    Raises:
        InputError: The shapes disagree, there are fewer than three setups, or all predicted or measured levels are
            equal.
    """

    measure: str  #: Name of the measure.
    setups: Integers  #: Numbers of the setups (K,).
    predicted: Array  #: Levels predicted by the study (K,).
    measured: Array  #: Levels measured on the rig (K,), averaged over repeated runs of a setup.
    runs: Integers  #: Number of rig runs of each setup (K,).
    run_to_run: float = 0.0  #: Standard deviation of one rig run; 0 if not known.
    #: 95 % interval of the true level of each setup (2, K), as the certainty of the study states it: lower ends, then
    #: upper ends. NaN where it is not known or already contains rig runs of the setup; None without a certainty.
    true: Array | None = None

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
        slope, intercept, *_ = scipy.stats.linregress(self.predicted, self.measured)
        residual = self.measured - intercept - slope * self.predicted
        count, center = self.setups.size, float(self.predicted.mean())
        scatter = float(np.sqrt(residual @ residual / (count - 2)))
        breadth = float(np.sum((self.predicted - center) ** 2))
        return Line(float(slope), float(intercept), scatter, count, center, breadth)

    @cached_property
    def spearman(self) -> float:
        """Spearman's rank correlation: 1 if the rig ranks the setups as the study does."""
        return float(scipy.stats.spearmanr(self.predicted, self.measured).statistic)

    @cached_property
    def kendall(self) -> float:
        """Kendall's rank correlation tau-b: share of pairs in the same order minus share in the opposite order."""
        return float(scipy.stats.kendalltau(self.predicted, self.measured).statistic)

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
        own, days = (_standard(scipy.stats.rankdata(levels, axis=-1)) for levels in (line, line + noise))
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
    def interval(self) -> Array:
        """95 % interval of the mean of each setup's rig runs (2, K): that of the true level, and run-to-run noise.

        NaN where it is not known. The run-to-run deviation is an estimate, so its part has Student's t distribution.
        """
        if self.true is None or self.run_to_run == 0.0:
            return np.full((2, self.setups.size), np.nan)
        noise = scipy.stats.norm.ppf(_UPPER) * usable_deviation(self.run_to_run, int(np.sum(self.runs - 1)))
        middle, half = self.true.mean(axis=0), 0.5 * np.ptp(self.true, axis=0)
        reach = np.hypot(half, noise / np.sqrt(self.runs))
        return np.stack([middle - reach, middle + reach])

    @property
    def judged(self) -> int:
        """Number of setups whose interval is known."""
        return int(np.isfinite(self.interval).all(axis=0).sum())

    @property
    def inside(self) -> Flags:
        """Whether each measured level is in its interval (K,); false where the interval is not known."""
        low, high = self.interval
        return np.asarray((low <= self.measured) & (self.measured <= high), dtype=np.bool_)

    @property
    def level_error(self) -> float:
        """RMS of predicted/measured - 1 [%]."""
        return float(100.0 * np.sqrt(np.mean((self.predicted / self.measured - 1.0) ** 2)))

    @property
    def bias(self) -> float:
        """Mean of predicted/measured - 1 [%]."""
        return float(100.0 * np.mean(self.predicted / self.measured - 1.0))


def usable_deviation(estimate: float, freedom: int) -> float:
    """Return the deviation of the normal distribution that has the 95 % interval of an estimated deviation.

    A deviation that was estimated from few repeats may be far too small, so its interval is that of Student's t.
    """
    return estimate * float(scipy.stats.t.ppf(_UPPER, freedom) / scipy.stats.norm.ppf(_UPPER))


def _standard(ranks: Array) -> Array:
    """Return rows (..., K) minus their mean and scaled to length 1, so that their products are correlations."""
    centered = ranks - ranks.mean(axis=-1, keepdims=True)
    return np.asarray(centered / np.linalg.norm(centered, axis=-1, keepdims=True), dtype=np.float64)


# ---- Verdicts on a comparison of a study with the rig and on a comparison of runs -----------------------------------

ABOUT = "prediction of the rig"

RULES = Rules.read(Path(__file__).with_suffix(".txt"))


def comparison_verdict(comparisons: Sequence[Comparison], *, rank: float, level: float | None) -> Verdict:
    """Return the verdict on comparisons of a study with the rig.

    Args:
        rank: Minimum rank correlation (Spearman).
        level: Maximum level error [%]; None for no limit.
    """
    rows = list[tuple[str, str, str, str]]()
    for one in comparisons:
        if not one.spearman >= rank:
            noise = "; run-to-run noise alone can explain this" if one.spearman >= one.attainable else ""
            statement = "the study ranks setups differently than the rig"
            figure = f"rank correlation {one.spearman:.3f}; limit {rank:g}{noise}"
            rows.append(("setups ranked otherwise than measured", statement, figure, one.measure))
        if level is not None and not one.level_error <= level:
            statement = "the study's levels differ from those of the rig"
            figure = f"level error {one.level_error:.1f} %; limit {level:g} %"
            rows.append(("levels otherwise than measured", statement, figure, one.measure))
    if not rows:
        worst = min(comparisons, key=lambda one: one.spearman)
        levels = "" if level is None else f"; level errors up to {max(one.level_error for one in comparisons):.1f} %"
        figure = f"rank correlation {worst.spearman:.3f} or more; limit {rank:g}{levels}"
        rows = [("ranked as measured", "the study ranks setups as the rig does", figure, worst.measure)]
    return Verdict(RULES.reason(*row) for row in rows)


def _of_run(label: str, run: Result | SavedRun) -> Iterator[Reason]:
    """Yield the reasons of the verdict on a run, with its label in their origins."""
    none = "run without a verdict", "the run has no verdict", "0 reasons stated", "result.json"
    for reason in run.verdict.reasons or (RULES.reason(*none),):
        yield replace(reason, origin=f"{label}: {reason.origin}")


# ---- Response measures of runs --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False, repr=False)
class RunComparison(Summarized):
    """Response measures of runs; the first run is the baseline."""

    runs: Mapping[str, TimeSeries]  #: Recorded channels of each run without the settling time, by label.
    measures: tuple[Measure, ...]  #: Measures that all runs have.
    verdict: Verdict  #: Verdict on all runs, with the run in the origin of each reason.

    def values(self, measure: Measure) -> list[float]:
        """Return a measure of every run in its display unit."""
        return [units.convert(measure.of(one), measure.unit(one), self.display(measure)) for one in self.runs.values()]

    def display(self, measure: Measure) -> str:
        """Return the unit in which a measure is shown to this user."""
        return units.shown_unit(measure.unit(next(iter(self.runs.values()))), measure.display)

    def change(self, measure: Measure) -> float | None:
        """Return the change of a measure from the first run to the last [%]; None if it is 0 in the first run."""
        first, *_, last = self.values(measure)
        return 100.0 * (last / first - 1.0) if first else None

    def _summary(self) -> Summary:
        changes = {one.name: self.change(one) for one in self.measures}
        known = sorted(((name, c) for name, c in changes.items() if c is not None), key=lambda item: -abs(item[1]))
        return Summary.of(
            f"Comparison of {len(self.runs)} runs",
            ("runs", some(self.runs)),
            ("verdict", self.verdict.headline),
            ("measures", str(len(self.measures))),
            *((name, f"{change:+.2f} %") for name, change in known[:5]),
        )

    def to_pandas(self) -> pd.DataFrame:
        """Return a row for each measure: unit, value in each run, change from the first run to the last [%].

        Raises:
            MissingExtraError: pandas is not installed.
        """
        rows = [self.values(measure) for measure in self.measures]
        columns: dict[str, Any] = {"unit": [self.display(measure) for measure in self.measures]}
        columns |= {label: [row[k] for row in rows] for k, label in enumerate(self.runs)}
        columns["change"] = [self.change(measure) for measure in self.measures]
        return data_frame(columns, [measure.name for measure in self.measures], "measure", {"change": "%"})

    def plot(self) -> Picture:
        """Return a picture of the change of each measure from the first run to the others."""
        from eightpost.report.pictures import Picture  # noqa: PLC0415 -- matplotlib takes long to load

        return Picture(changes(self.runs, self.measures))


def compare_runs(runs: Mapping[str, Result | SavedRun], vehicle: str = "car") -> RunComparison:
    """Compare runs by the ride measures of a vehicle, or channel by channel if they lack its channels.

    Args:
        runs: Two or more runs by label; the first is the baseline.

    Raises:
        InputError: There are fewer than two runs, or they have no channel in common.
    """
    if len(runs) < 2:
        raise InputError("compare needs at least two runs; the first is the baseline")
    settled = {label: one.settled() if isinstance(one, Result) else one.series for label, one in runs.items()}
    series = tuple(settled.values())
    measures = available(ride_measures(vehicle), *series) or available(channel_measures(series[0]), *series)
    if not measures:
        raise InputError(f"{next(iter(runs))} and the other runs have no channel in common")
    verdict = Verdict(reason for label, run in runs.items() for reason in _of_run(label, run))
    return RunComparison(settled, measures, verdict)


# ---- JSON file of the comparisons of measured with predicted levels -------------------------------------------------


#: Newest schema of these files that can be read; it is also the one that is written.
SCHEMA = 1


def write_comparisons(
    comparisons: Sequence[Comparison], units: Mapping[str, str], path: str | Path, verdict: Verdict
) -> None:
    """Write comparisons as JSON, levels in SI."""
    measures = [_entry(one, units[one.measure]) for one in comparisons]
    heading = {"schema": SCHEMA, "kind": "comparison", "tool": f"eightpost {__version__}", "verdict": verdict.to_json()}
    document = sealed({**heading, "measures": measures})
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(document, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def write_and_plot(
    comparisons: Sequence[Comparison],
    result: StudyResult,
    folder: Path,
    verdict: Verdict,
    selected: Mapping[str, Collection[int]],
) -> Path:
    """Write comparison.json, and comparison.png with the measures of the selection, or else of the objective.

    Args:
        selected: Setups that were selected for each measure; empty if there is no selection.

    Returns:
        The picture.
    """
    write_comparisons(comparisons, result.provenance.measure_units, folder / "comparison.json", verdict)
    first = selected or dict.fromkeys(term.measure for term in result.study.objective)
    drawn = [one for one in comparisons if one.measure in first] or list(comparisons)
    _plot_comparisons(drawn, folder / "comparison.png", result, selected)
    return folder / "comparison.png"


@with_config(OPEN)
class _Measure(TypedDict):
    """Entries of a measure that are read."""

    measure: str
    runs: list[int]
    run_to_run: float


@with_config(OPEN)
class _Document(TypedDict):
    """Entries of a comparison that are read."""

    measures: list[_Measure]


def read_run_to_run(path: str | Path) -> dict[str, float]:
    """Return the standard deviation of one rig run by measure [SI], as a comparison found it from repeated runs.

    It is increased for the number of repeats; see `usable_deviation`.

    Raises:
        FileFormatError: The file is not a comparison, was edited after it, or no setup was run twice.
    """
    path, advice = Path(path), "`eightpost study compare --measured` writes it"
    stated = json_content(path, advice=advice)
    document = document_of(_Document, stated, path, "comparison", SCHEMA, advice)
    repeats = [(entry, sum(runs - 1 for runs in entry["runs"])) for entry in document["measures"]]
    deviations = {
        entry["measure"]: usable_deviation(entry["run_to_run"], freedom) if freedom > 0 else 0.0
        for entry, freedom in repeats
    }
    if not is_intact(stated):
        raise FileFormatError(
            "was edited after the comparison; run `eightpost study compare --measured` again", path=path
        )
    if not any(deviations.values()):
        raise FileFormatError("contains no run-to-run deviation, because no setup was run twice on the rig", path=path)
    return deviations


def _entry(comparison: Comparison, unit: str) -> dict[str, Any]:
    return {
        "measure": comparison.measure,
        "unit": unit,
        "setups": comparison.setups.tolist(),
        "runs": comparison.runs.tolist(),
        "predicted": comparison.predicted.tolist(),
        "measured": comparison.measured.tolist(),
        "run_to_run": comparison.run_to_run,
        "spearman": comparison.spearman,
        "spearman_attainable": comparison.attainable,
        "kendall": comparison.kendall,
        "slope": comparison.line.slope,
        "slope_interval_95": list(comparison.line.interval()),
        "intercept": comparison.line.intercept,
        "scatter": comparison.line.scatter,
        "band": comparison.band,
        "within_band": int(comparison.within.sum()),
        "interval_95": [[None if np.isnan(end) else end for end in row] for row in comparison.interval.tolist()],
        "within_interval": int(comparison.inside.sum()),
        "judged": comparison.judged,
        "level_error_percent": comparison.level_error,
        "bias_percent": comparison.bias,
    }


# ---- Plot of measured and predicted levels (Fig 7.7) ----------------------------------------------------------------

_PREDICTED, _MEASURED = "#1f77b4", "#d95f02"


def _plot_comparisons(
    comparisons: Sequence[Comparison], path: str | Path, result: StudyResult, selected: Mapping[str, Collection[int]]
) -> None:
    """Draw for every measure the levels by setup with bars of two standard deviations, and measured over predicted.

    Setups that were `selected` for a measure have filled markers, the others hollow ones.
    """
    from eightpost.report.pictures import new_figure, panels_of, save  # noqa: PLC0415 -- matplotlib takes long to load

    figure = new_figure(11, 3.4 * len(comparisons) + 0.4)
    panels = panels_of(figure, 2 * len(comparisons), 2, width_ratios=(1.3, 1.0))
    for trend, scatter, comparison in zip(panels[::2], panels[1::2], comparisons, strict=True):
        unit = result.display(comparison.measure)
        factor = units.conversion(result.unit(comparison.measure), unit)[0]
        own = np.isin(comparison.setups, list(selected.get(comparison.measure, comparison.setups)))
        _trend(trend, comparison, factor)
        _scatter(scatter, comparison, factor, own)
        trend.set_ylabel(f"{comparison.measure} [{unit}]", fontsize=9)
        scatter.set_xlabel(f"predicted [{unit}]", fontsize=9)
        scatter.set_ylabel(f"measured [{unit}]", fontsize=9)
    panels[-2].set_xlabel("setup, by predicted level", fontsize=9)
    for panel in panels[:2]:
        panel.legend(frameon=False, fontsize=8)
    save(figure, path)


def _trend(axes: Axes, comparison: Comparison, factor: float) -> None:
    order = np.argsort(comparison.predicted, kind="stable")
    places = np.arange(order.size)
    axes.plot(places, factor * comparison.predicted[order], "s", color=_PREDICTED, ms=5, label="predicted")
    label = f"measured, ± 2 sigma of {'a run' if comparison.run_to_run else 'the scatter'}"
    measured, band = factor * comparison.measured[order], factor * comparison.band
    axes.errorbar(places, measured, band, fmt="o", color=_MEASURED, ms=5, capsize=3, label=label)
    axes.set_xticks(places, [str(number) for number in comparison.setups[order]], rotation=90, fontsize=7)
    axes.grid(alpha=0.3)


def _scatter(axes: Axes, comparison: Comparison, factor: float, own: NDArray[np.bool_]) -> None:
    ends = np.linspace(comparison.predicted.min(), comparison.predicted.max(), 50)
    line = comparison.line.at(ends)
    axes.plot(factor * ends, factor * line, color="black", lw=1.0, label=f"best fit, slope {comparison.line.slope:.3g}")
    for sign in (-1.0, 1.0):
        band = line + sign * comparison.band
        axes.plot(factor * ends, factor * band, "--", color="black", lw=0.8, label="± 2 sigma" if sign > 0.0 else None)
    sure = 2.0 * comparison.line.error_at(ends)
    axes.fill_between(factor * ends, factor * (line - sure), factor * (line + sure), color="black", alpha=0.12, lw=0)
    for kept, fill in ((own, "full"), (~own, "none")):
        predicted, measured = factor * comparison.predicted[kept], factor * comparison.measured[kept]
        axes.plot(predicted, measured, "o", color=_MEASURED, fillstyle=fill)
    ranks = f"Spearman {comparison.spearman:.3f}\nKendall {comparison.kendall:.3f}"
    axes.text(0.03, 0.97, ranks, transform=axes.transAxes, va="top", fontsize=8)
    axes.grid(alpha=0.3)


# ==== Plot of response measures of several runs ======================================================================


def changes(runs: Mapping[str, TimeSeries], measures: Sequence[Measure], *, title: str = "Response measures") -> Figure:
    """Return a figure of each measure's change from the first run to the others in percent, without those of zero."""
    from eightpost.report.pictures import COLORS, new_figure  # noqa: PLC0415 -- matplotlib takes long to load

    labels = list(runs)
    baseline = runs[labels[0]]
    kept = [m for m in measures if m.statistic == "rms" and m.of(baseline) > 0.0]
    figure = new_figure(9, 0.33 * len(kept) + 1.6)
    axes = figure.subplots()
    positions = np.arange(len(kept))
    height = 0.8 / max(1, len(labels) - 1)
    for k, label in enumerate(labels[1:]):
        change = [100.0 * (m.of(runs[label]) / m.of(baseline) - 1.0) for m in kept]
        axes.barh(positions + k * height, change, height=0.9 * height, color=COLORS[(1 + k) % len(COLORS)], label=label)
    axes.set_yticks(positions + 0.4 - height / 2, [m.name for m in kept])
    axes.invert_yaxis()
    axes.axvline(0.0, color="black", lw=0.8)
    axes.set_xlabel(f"change from {labels[0]} [%]")
    axes.grid(axis="x", alpha=0.3)
    axes.legend(frameon=False)
    figure.suptitle(title)
    return figure
