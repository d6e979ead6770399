"""Workbook of the ranking, with sheets for the ranking, the units and the provenance."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import xlsxwriter
import xlsxwriter.exceptions

from cosim.study.report.csv_tables import Cell, ranking_rows
from cosim.study.report.packed import shown_columns
from cosim.study.report.sheet import Sheet
from eightpost.errors import OutputError
from eightpost.files import atomic_path


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
