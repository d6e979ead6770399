"""Report of a study: conversion of its result, and the files that are written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path, PurePath
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute

from cosim.report.origin import Origin
from cosim.study.certainty import OBJECTIVE, Certainty, Levels
from cosim.study.choice.selection import Selection
from cosim.study.choice.sensitivity import available_sensitivities
from cosim.study.measures import Measure
from cosim.study.report.answer import tied_rows
from cosim.study.report.page import page
from cosim.study.report.sheet import AimPage, Background, Bound, Column, Extras, Scale, Sheet, Uncertainty, Weighted
from cosim.study.report.shock_pages import ShockCurve
from cosim.study.report.tables import write_ranking, write_traces, write_workbook
from cosim.study.result import StudyResult
from cosim.study.stored_table import StoredTable
from cosim.study.study import Build, Parameters, Study, Term, Vehicle
from cosim.study.verdict import study_verdict
from eightpost.array_types import Array
from eightpost.report.numbers import Display
from eightpost.report.page import write_page
from eightpost.signals import TimeSeries

# ---- Uncertainty of the measures of a study, setup by setup ---------------------------------------------------------


def _uncertainty_of(levels: Levels | None) -> Uncertainty | None:
    """Return the uncertainty of a measure; None if it is not known."""
    if levels is None or not levels.is_known:
        return None
    low, high = levels.interval()
    return Uncertainty(low, high, levels.best, tied_rows(levels.best))


def _better_end(result: StudyResult, measure: str) -> Literal["low", "high"]:
    """Return whether low or high values of a measure are better: high if its weight in the objective is negative."""
    rewarded = any(term.measure == measure and term.weight < 0.0 for term in result.study.objective)
    return "high" if rewarded else "low"


# ---- Conversion of a study's result into the data of the report -----------------------------------------------------


def sheet_of(result: StudyResult, *, certainty: Certainty | None = None, trace_command: str = "") -> Sheet:
    """Return the report data of a result.

    Args:
        result: Result of the study.
        certainty: Certainty of the study; None if it was not computed.
        trace_command: Command that computes the traces of a setup, with `{setup}` in place of its number.
    """
    levels = certainty.levels if certainty else {}
    builds = tuple(result.study.bank)
    return Sheet(
        corners=tuple(result.study.corners),
        builds=builds,
        numbers=result.setups,
        placed=result.places(builds),
        measures=tuple(
            _column(result, measure.name, levels.get(measure.name)) for measure in _by_interest(result.study)
        ),
        allowed=result.feasible,
        coupling_error=_numbers(result.table, "coupling_error_percent"),
        objective=_objective(result, levels.get(OBJECTIVE)),
        failures=_failures(result),
        marks=_texts(result.table, "marks"),
        baseline=result.baseline_row,
        certainty=certainty,
        terms=tuple(_weighted(result, term) for term in result.study.objective),
        background=background(result, trace_command, certainty),
    )


def background(result: StudyResult, trace_command: str, certainty: Certainty | None = None) -> Background:
    """Return objective, constraints, notes, settings and files of a result."""
    study = result.study
    terms = " + ".join(f"{term.weight:g} × ({term.measure} [{term.unit}])" for term in study.objective)
    return Background(
        title=study.name or "Setup study",
        objective=terms,
        constraints=tuple(_bounds(result)),
        notes=tuple(_notes(result)),
        facts=tuple(_facts(result)),
        origins=tuple(_origins(result)),
        trace_command=trace_command,
        verdict=study_verdict(result, certainty),
    )


def _by_interest(study: Study) -> list[Measure]:
    """Return the measures in display order: objective, constraints, others, and last those that depend on a mean."""
    names = (*(term.measure for term in study.objective), *(bound.measure for bound in study.constraints))
    named = [study.measure(name) for name in dict.fromkeys(names)]
    others = [measure for measure in study.measures if measure not in named]
    return [*named, *sorted(others, key=lambda measure: measure.absolute)]


def _column(result: StudyResult, name: str, levels: Levels | None) -> Column:
    scale = Scale.of(result.unit(name), result.display(name))
    return Column(name, scale, result.values(name), _better_end(result, name), _uncertainty_of(levels))


def _objective(result: StudyResult, levels: Levels | None) -> Column | None:
    values = result.objective
    return None if values is None else Column(OBJECTIVE, Scale.of("1"), values, uncertainty=_uncertainty_of(levels))


def _weighted(result: StudyResult, term: Term) -> Weighted:
    own = result.unit(term.measure)
    return Weighted(term.measure, term.weight, Display.of(own, term.unit or own))


def _numbers(table: pa.Table | StoredTable, name: str) -> Array:
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)


def _texts(table: pa.Table | StoredTable, name: str) -> dict[int, str]:
    texts = table[name]
    given = np.flatnonzero(pa.compute.not_equal(texts, "").fill_null(False))
    return {row: texts[row].as_py() for row in given.tolist()}


def _failures(result: StudyResult) -> dict[int, str]:
    messages = result.table["message"]
    return {row: messages[row].as_py() or "it did not finish" for row in np.flatnonzero(~result.done).tolist()}


def _bounds(result: StudyResult) -> Iterator[Bound]:
    for constraint in result.study.constraints:
        name = constraint.measure
        scale = Scale.of(result.unit(name), result.display(name))
        if isfinite(constraint.at_least):
            yield Bound(name, "at least", constraint.at_least, scale)
        if isfinite(constraint.at_most):
            yield Bound(name, "at most", constraint.at_most, scale)


def _notes(result: StudyResult) -> Iterator[str]:
    if result.partial:
        total = len(result.study.space)
        yield f"The study is not complete: {len(result)} of {total} setups were run. Levels and ranks are of these."
    if not result.study.vehicle.means_trusted:
        yield "The vehicle's response to constant inputs is not trusted, so the study has no measures of means."


def _facts(result: StudyResult) -> Iterator[tuple[str, str]]:
    study, seconds = result.study, _numbers(result.table, "seconds")
    yield "Setups", f"{len(result)} of {len(study.space)}, from {len(study.bank)} builds"
    if study.alike:
        yield "Corners with the same build", "; ".join(" and ".join(group) for group in study.alike)
    for drive in study.drives:
        yield f"Drive {drive.name}", f"{drive.file}, from {drive.start:g} to {drive.start + drive.stop:g} s"
    yield "Settling, left out of every measure", f"{study.settling:g} s"
    yield "Target coupling error", f"{study.accuracy:g} % of each signal's standard deviation"
    yield "Record step of the measured signals", f"{1e3 * study.record_step:g} ms"
    yield from _settings(result.provenance.settings)
    for name, one in result.provenance.above_band.items():
        yield f"Power of {name} above {one.high:.3g} Hz, where the vehicle was not identified", f"{one.share:.1%}"
    yield "Total wall time of all runs", f"{np.nansum(seconds):.4g} s"
    yield "Digest of the study", result.provenance.digest
    yield "Computed by", f"eightpost {result.provenance.tool_version}"


def _settings(settings: Mapping[str, Any], within: str = "") -> Iterator[tuple[str, str]]:
    """Yield settings and nested settings, one row each."""
    for name, value in settings.items():
        words = f"{within}{name.replace('_', ' ')}"
        if isinstance(value, Mapping):
            yield from _settings(value, f"{words}: ")
        else:
            values = value if isinstance(value, list | tuple) else (value,)
            yield words.capitalize(), "; ".join(f"{one:.6g}" if isinstance(one, float) else str(one) for one in values)


def _origins(result: StudyResult) -> Iterator[Origin]:
    """Yield the vehicle, the builds, the drives, and the other files that were read."""
    study, source = result.study, result.provenance
    guids, digests = _by_name(source.guids), _by_name(source.digests)
    models: dict[str, Vehicle | Build] = {
        "vehicle": study.vehicle,
        **{f"build {name}": build for name, build in study.bank.items()},
    }
    files: dict[str, tuple[PurePath, Parameters]] = {
        what: (model.fmu, model.parameters) for what, model in models.items()
    }
    files |= {f"drive {drive.name}": (drive.file, {}) for drive in study.drives}
    known = {str(file) for file, _ in files.values()}
    files |= {f"file {PurePath(path).name}": (PurePath(path), {}) for path in source.digests if path not in known}
    for what, (file, parameters) in files.items():
        identity, digest = (found.get(str(file)) or found.get(file.name, "") for found in (guids, digests))
        changed = tuple(f"{name} = {value}" for name, value in parameters.items())
        yield Origin(what, file.name, identity, "", digest, changed)


def _by_name(known: Mapping[str, str]) -> dict[str, str]:
    """Return values by path, and also by file name if only one path has that name."""
    names = [PurePath(path).name for path in known]
    single = {PurePath(path).name: value for path, value in known.items() if names.count(PurePath(path).name) == 1}
    return single | dict(known)


# ---- Files of a study's report --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ReportPaths:
    """The files of a report."""

    page: Path  #: The page.
    workbook: Path  #: Ranking, units and provenance as a workbook.
    ranking: Path  #: The ranking as CSV.
    #: CSV files with the traces of the best setup and the baseline by setup number, if traces were given.
    traces: Mapping[int, Path]


def write_study_report(
    result: StudyResult,
    out_dir: str | Path,
    *,
    traces: Mapping[int, TimeSeries] | None = None,
    selection: Selection | None = None,
    certainty: Certainty | None = None,
    curves: Mapping[str, ShockCurve] | None = None,
    shock_pages: Mapping[str, str] | None = None,
    aim: AimPage | None = None,
    trace_command: str = "",
) -> ReportPaths:
    """Write all files of a study's report without running a simulation.

    Args:
        result: Result of the study.
        out_dir: Output folder; existing files of the same names are replaced, each after the new file is complete.
        traces: Time traces of some setups by setup number.
        selection: Setups to confirm on the rig.
        certainty: Certainty of the study.
        curves: Curves of the shocks, by build.
        shock_pages: Pages of the shocks relative to the folder, by build.
        aim: Page of the curves to aim at.
        trace_command: Command that computes the traces of a setup, with `{setup}` in place of its number.
    """
    sheet, folder = sheet_of(result, certainty=certainty, trace_command=trace_command), Path(out_dir)
    chosen = selection.chosen if selection else ()
    extras = Extras(traces or {}, available_sensitivities(result), chosen, curves or {}, shock_pages or {}, aim)
    return ReportPaths(
        page=write_page(folder / "report.html", page(sheet, extras)),
        workbook=write_workbook(sheet, folder / "ranking.xlsx"),
        ranking=write_ranking(sheet, folder / "ranking.csv"),
        traces={
            number: write_traces(sheet, number, series, folder / "traces" / f"setup_{number}.csv")
            for number, series in extras.traces.items()
            if sheet.row(number) in (sheet.order[0], sheet.baseline)
        },
    )
