"""Files of a study: page, CSV tables and workbook."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path, PurePath
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import xlsxwriter
import xlsxwriter.exceptions

from cosim.study.choice.robust import REACH, Spread
from cosim.study.choice.selection import Selection
from cosim.study.choice.sensitivity import Sensitivity, available_sensitivities
from cosim.study.measures import Measure
from cosim.study.report.page import Extras, page, write_figures
from cosim.study.report.sheet import (
    Background,
    Bound,
    Column,
    Indices,
    Origin,
    Scale,
    Sheet,
    Uncertainty,
    shown_columns,
)
from cosim.study.result import DONE, StudyResult
from cosim.study.study import Build, Parameters, Study, Vehicle
from cosim.study.verdict import study_verdict
from eightpost.array_types import Array
from eightpost.cells import safe_cell
from eightpost.errors import OutputError
from eightpost.files import atomic_path
from eightpost.signals import TimeSeries

# ---- Uncertainty of the measures of a study, setup by setup ---------------------------------------------------------


def uncertainty_of(result: StudyResult, band: Spread) -> Uncertainty:
    """Return the uncertainty of a result's setups according to a spread; NaN for setups that it does not contain."""
    places = np.searchsorted(result.setups, band.setups)
    sign = 1.0 if better_end(result, band.measure) == "low" else -1.0
    first = _place(band, result, int(result.ranking()[0]) if result.ranking().size else None)
    known = np.isfinite(band.values)
    best = int(np.nanargmin(sign * band.values)) if known.any() else None
    above, deviation = (np.zeros(known.size),) * 2 if best is None else band.difference(best)
    tied = np.zeros(len(result), dtype=np.bool_)
    tied[places] = known & ~(sign * above > REACH * deviation)
    return Uncertainty(
        _spread_out(result, places, REACH * band.deviation),
        _spread_out(result, places, _of_difference(band, first)),
        _spread_out(result, places, _of_difference(band, _place(band, result, result.baseline_row))),
        tied,
    )


def better_end(result: StudyResult, measure: str) -> Literal["low", "high"]:
    """Return whether low or high values of a measure are better: high if its weight in the objective is negative."""
    rewarded = any(term.measure == measure and term.weight < 0.0 for term in result.study.objective)
    return "high" if rewarded else "low"


def _place(band: Spread, result: StudyResult, row: int | None) -> int | None:
    """Return the position of a result's row in the spread; None if the spread does not contain it."""
    found = np.flatnonzero(band.setups == result.setups[row]) if row is not None else np.empty(0, dtype=np.int64)
    return int(found[0]) if found.size else None


def _of_difference(band: Spread, place: int | None) -> Array:
    if place is None:
        return np.full(band.setups.size, np.nan)
    return np.asarray(REACH * band.difference(place)[1], dtype=np.float64)


def _spread_out(result: StudyResult, places: np.ndarray[tuple[int], np.dtype[np.int64]], values: Array) -> Array:
    whole = np.full(len(result), np.nan)
    whole[places] = values
    return whole


# ---- Conversion of a study's result into the data of the report -----------------------------------------------------


def sheet_of(result: StudyResult, *, bands: Sequence[Spread] = (), trace_command: str = "") -> Sheet:
    """Return the report data of a result.

    Args:
        result: Result of the study.
        bands: Spreads of measures in SI, for the measures whose spread is known.
        trace_command: Command that computes the traces of a setup, with `{setup}` in place of its number.
    """
    uncertainties = {band.measure: uncertainty_of(result, band) for band in bands}
    builds = tuple(result.study.bank)
    return Sheet(
        corners=tuple(result.study.corners),
        builds=builds,
        numbers=result.setups,
        placed=_placed(result, builds),
        measures=tuple(
            _column(result, measure.name, uncertainties.get(measure.name)) for measure in _by_interest(result.study)
        ),
        allowed=result.feasible,
        coupling_error=_numbers(result.table, "coupling_error_percent"),
        objective=_objective(result),
        failures=_failures(result),
        marks=_texts(result.table, "marks"),
        baseline=result.baseline_row,
        background=background(result, trace_command),
    )


def background(result: StudyResult, trace_command: str) -> Background:
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
        verdict=study_verdict(result),
    )


def _placed(result: StudyResult, builds: tuple[str, ...]) -> Indices:
    places = {build: k for k, build in enumerate(builds)}
    columns = [[places[build] for build in result.builds(corner)] for corner in result.study.corners]
    return np.array(columns, dtype=np.int64).T.reshape(len(result), len(columns))


def _by_interest(study: Study) -> list[Measure]:
    """Return the measures in display order: objective, constraints, others, and last those that depend on a mean."""
    names = (*(term.measure for term in study.objective), *(bound.measure for bound in study.constraints))
    named = [study.measure(name) for name in dict.fromkeys(names)]
    others = [measure for measure in study.measures if measure not in named]
    return [*named, *sorted(others, key=lambda measure: measure.absolute)]


def _column(result: StudyResult, name: str, uncertainty: Uncertainty | None) -> Column:
    scale = Scale.of(result.unit(name), result.display(name))
    return Column(name, scale, result.values(name), better_end(result, name), uncertainty)


def _objective(result: StudyResult) -> Column | None:
    values = result.objective
    return None if values is None else Column("objective", Scale.of("1"), values)


def _numbers(table: pa.Table, name: str) -> Array:
    return np.asarray(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)


def _texts(table: pa.Table, name: str) -> dict[int, str]:
    return {row: text for row, text in enumerate(table[name].to_pylist()) if text}


def _failures(result: StudyResult) -> dict[int, str]:
    rows = zip(result.table["status"].to_pylist(), result.table["message"].to_pylist(), strict=True)
    return {row: message or "it did not finish" for row, (status, message) in enumerate(rows) if status != DONE}


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
        yield Origin(
            what, file.name, identity, digest, tuple(f"{name} = {value}" for name, value in parameters.items())
        )


def _by_name(known: Mapping[str, str]) -> dict[str, str]:
    """Return values by path, and also by file name if only one path has that name."""
    names = [PurePath(path).name for path in known]
    single = {PurePath(path).name: value for path, value in known.items() if names.count(PurePath(path).name) == 1}
    return single | dict(known)


# ---- CSV tables in the layout of data-logging tools -----------------------------------------------------------------

Cell = str | int | float


def write_ranking(sheet: Sheet, path: Path) -> Path:
    """Write all setups, best first, in the display units of the measures; failed setups have empty cells.

    Args:
        sheet: Report data.
        path: The file.

    Returns:
        The file.
    """
    columns = shown_columns(sheet)
    names = ["rank", "setup", *sheet.corners, *(column.name for column in columns), "coupling error", "remark"]
    units = ["", "", *("" for _ in sheet.corners), *(column.scale.us.unit for column in columns), "%", ""]
    return _write(path, _csv_tables_settings(sheet), names, units, ranking_rows(sheet))


def ranking_rows(sheet: Sheet) -> list[list[Cell]]:
    """Return one row per setup, best first: rank, number, builds, values in display units, coupling error, remark."""
    columns = shown_columns(sheet)
    return [
        [
            place if sheet.done[row] else "",
            int(sheet.numbers[row]),
            *(sheet.builds[build] for build in sheet.placed[row]),
            *(_cell(column.scale.us(float(column.values[row]))) for column in columns),
            _cell(float(sheet.coupling_error[row])),
            sheet.remark(row),
        ]
        for place, row in enumerate(sheet.order.tolist(), start=1)
    ]


def write_traces(sheet: Sheet, number: int, series: TimeSeries, path: Path) -> Path:
    """Write the traces of one setup in SI, in the layout of MoTeC i2's CSV export.

    Args:
        sheet: Report data for the preamble.
        number: Number of the setup.
        series: Traces of the setup.
        path: The file.

    Returns:
        The file.
    """
    row = sheet.row(number)
    settings = [
        ("Format", "MoTeC CSV File"),
        ("Vehicle", sheet.background.title),
        ("Comment", f"setup {number}" + ("" if row is None else f": {sheet.fitted(row)}")),
        ("Sample Rate", f"{series.sample_rate:.9g}", "Hz"),
        ("Duration", f"{series.duration:.9g}", "s"),
    ]
    rows = np.column_stack([series.time, series.values.T]).tolist()
    return _write(path, settings, ["Time", *series.names], ["s", *series.units], rows)


def _csv_tables_settings(sheet: Sheet) -> list[tuple[str, str]]:
    source = sheet.background
    return [
        ("Format", "eightpost setup study"),
        ("Study", source.title),
        ("Ranked by", source.objective or sheet.ranked_by.name),
        ("Constraints", "; ".join(map(str, source.constraints)) or "none"),
        *source.facts,
    ]


def _cell(value: float) -> Cell:
    return value if np.isfinite(value) else ""


def _write(
    path: Path,
    settings: Iterable[Sequence[str]],
    names: Sequence[str],
    units: Sequence[str],
    rows: Iterable[Sequence[Cell]],
) -> Path:
    """Write text in quotes and numbers without; lines end with CR LF (RFC 4180)."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, quoting=csv.QUOTE_NONNUMERIC)
        writer.writerows(_safe(row) for row in (*settings, (), names, units))
        writer.writerows(map(_safe, rows))
    return path


def _safe(row: Sequence[Cell]) -> list[Cell]:
    return [safe_cell(cell) if isinstance(cell, str) else cell for cell in row]


# ---- Workbook of the ranking, with sheets for the ranking, the units and the provenance -----------------------------


def write_workbook(sheet: Sheet, path: Path) -> Path:
    """Write the workbook; text is never interpreted as a formula.

    Args:
        sheet: Report data.
        path: The file.

    Returns:
        The file.
    """
    options = {"strings_to_formulas": False, "strings_to_urls": False}
    try:
        with atomic_path(path) as temporary, xlsxwriter.Workbook(temporary, options) as workbook:
            _ranking(workbook, sheet)
            _units(workbook, sheet)
            _provenance(workbook, sheet)
    except xlsxwriter.exceptions.XlsxWriterException as error:  # wraps the operating system's error
        raise OutputError(f"{path}: cannot be written ({error}); free disk space, or choose another folder") from error
    return path


def _ranking(workbook: Any, sheet: Sheet) -> None:
    """Write one row per setup below a frozen header row, with filters and shading by level (white: the minimum)."""
    columns, rows = shown_columns(sheet), ranking_rows(sheet)
    heads = [f"{column.name} [{column.scale.us.unit}]" for column in columns]
    names = ["rank", "setup", *(corner.upper() for corner in sheet.corners), *heads, "coupling error [%]", "remark"]
    page = workbook.add_worksheet("Ranking")
    _table(workbook, page, names, rows)
    first = 2 + len(sheet.corners)
    for k, column in enumerate(columns, start=first):
        page.set_column(k, k, 14, workbook.add_format({"num_format": _digits(column.scale.us(column.extremes[1]))}))
        shades = {"type": "2_color_scale", "min_color": "#FFFFFF", "max_color": "#9CC3E6"}
        page.conditional_format(1, k, max(1, len(rows)), k, shades)
    page.freeze_panes(1, first)
    page.autofilter(0, 0, max(1, len(rows)), len(names) - 1)
    page.set_column(len(names) - 1, len(names) - 1, 40)


def _digits(value: float) -> str:
    """Return the number format that shows about four digits of values of this size."""
    size = abs(value)
    return "0" if size >= 1000.0 else "0.0" if size >= 100.0 else "0.00" if size >= 10.0 else "0.0000"


def _units(workbook: Any, sheet: Sheet) -> None:
    heads = [
        "measure",
        "unit here",
        "SI unit",
        "here = factor * SI + offset: factor",
        "offset",
        "least",
        "greatest",
    ]
    rows: list[list[Cell]] = []
    for column in shown_columns(sheet):
        us, (least, greatest) = column.scale.us, column.extremes
        rows.append([column.name, us.unit, column.scale.si, us.factor, us.offset, us(least), us(greatest)])
    _table(workbook, workbook.add_worksheet("Units"), heads, rows)


def _provenance(workbook: Any, sheet: Sheet) -> None:
    source = sheet.background
    words = [("Study", source.title), ("Objective", source.objective or "none"), *source.facts]
    words += [("Constraint", str(bound)) for bound in source.constraints] + [("Note", text) for text in source.notes]
    files = [(o.what, o.file, o.identity, o.digest, ", ".join(o.parameters)) for o in source.origins]
    page = workbook.add_worksheet("Provenance")
    _table(workbook, page, ["what", "value or file", "GUID", "SHA-256", "parameters set"], [*words, *files])
    page.set_column(1, 1, 60)
    page.set_column(2, 3, 68)


def _table(workbook: Any, page: Any, heads: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    bold = workbook.add_format({"bold": True, "text_wrap": True, "valign": "top", "bottom": 1})
    page.write_row(0, 0, heads, bold)
    page.set_column(0, len(heads) - 1, 14)
    for k, row in enumerate(rows, start=1):
        page.write_row(k, 0, row)


# ---- Files of a study's report --------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ReportPaths:
    """The files of a report.

    Args:
        page: The page.
        workbook: Ranking, units and provenance as a workbook.
        ranking: The ranking as CSV.
        traces: CSV files with the traces of the best setup and the baseline by setup number, if traces were given.
        figures: Figures for papers, as PNG and SVG.
    """

    page: Path
    workbook: Path
    ranking: Path
    traces: Mapping[int, Path]
    figures: tuple[Path, ...]


def write_study_report(
    result: StudyResult,
    out_dir: str | Path,
    *,
    traces: Mapping[int, TimeSeries] | None = None,
    sensitivities: Sequence[Sensitivity] | None = None,
    selection: Selection | None = None,
    bands: Sequence[Spread] | None = None,
    trace_command: str = "",
) -> ReportPaths:
    """Write all files of a study's report without running a simulation.

    Args:
        result: Result of the study.
        out_dir: Output folder; existing files of the same names are replaced, each after the new file is complete.
        traces: Time traces of some setups by setup number.
        sensitivities: Sensitivities of the measures; computed from the table if None.
        selection: Setups to confirm on the rig.
        bands: Spreads of measures in SI.
        trace_command: Command that computes the traces of a setup, with `{setup}` in place of its number.
    """
    sheet = sheet_of(result, bands=bands or (), trace_command=trace_command)
    terms = available_sensitivities(result) if sensitivities is None else sensitivities
    return write_sheet(sheet, out_dir, Extras(traces or {}, terms, selection.chosen if selection else ()))


def write_sheet(sheet: Sheet, out_dir: str | Path, extras: Extras) -> ReportPaths:
    """Write all files of a report from its data."""
    folder = Path(out_dir)
    return ReportPaths(
        page=_write_page(sheet, folder / "report.html", extras),
        workbook=write_workbook(sheet, folder / "ranking.xlsx"),
        ranking=write_ranking(sheet, folder / "ranking.csv"),
        traces={
            number: write_traces(sheet, number, series, folder / "traces" / f"setup_{number}.csv")
            for number, series in extras.traces.items()
            if sheet.row(number) in (sheet.order[0], sheet.baseline)
        },
        figures=write_figures(sheet, folder / "figures"),
    )


def _write_page(sheet: Sheet, path: Path, extras: Extras) -> Path:
    content = page(sheet, extras)
    with atomic_path(path) as temporary:
        temporary.write_text(content, encoding="utf-8")
    return path
