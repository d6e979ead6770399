"""CSV tables in the layout of data-logging tools: a preamble of settings, a row of names, a row of units."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from cosim.study.report.packed import shown_columns
from cosim.study.report.sheet import Sheet
from eightpost.cells import safe_cell
from eightpost.files import atomic_path
from eightpost.signals import TimeSeries

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
    return _write(path, _settings(sheet), names, units, ranking_rows(sheet))


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


def _settings(sheet: Sheet) -> list[tuple[str, str]]:
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
