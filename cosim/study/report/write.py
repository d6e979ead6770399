"""Files of a study's report: the page, figures for papers, a workbook, and tables as CSV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cosim.study.choice.robust import Spread
from cosim.study.choice.selection import Selection
from cosim.study.choice.sensitivity import Sensitivity, available_sensitivities
from cosim.study.report.csv_tables import write_ranking, write_traces
from cosim.study.report.figures import write_figures
from cosim.study.report.from_result import sheet_of
from cosim.study.report.page import Extras, page
from cosim.study.report.sheet import Sheet
from cosim.study.report.workbook import write_workbook
from cosim.study.result import StudyResult
from eightpost.files import atomic_path
from eightpost.signals import TimeSeries


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
