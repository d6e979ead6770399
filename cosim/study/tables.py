"""Tables of a study: CSV files in the layout of data-logging tools, and a workbook."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from cosim.study.sheet import Sheet, shown_columns
from eightpost.errors import OutputError
from eightpost.extras import needs
from eightpost.files import atomic_path, safe_cell
from eightpost.signals import TimeSeries

with needs("report", "writing workbooks"):
    import xlsxwriter
    import xlsxwriter.exceptions

# ---- CSV tables in the layout of data-logging tools -----------------------------------------------------------------

Cell = str | int | float


def write_ranking(sheet: Sheet, path: Path) -> Path:
    """Write all setups, best first, in the display units of the measures; failed setups have empty cells."""
    columns = shown_columns(sheet)
    names = ["rank", "setup", *sheet.corners, *(column.name for column in columns), "coupling error", "remark"]
    units = ["", "", *("" for _ in sheet.corners), *(column.scale.us.unit for column in columns), "%", ""]
    source = sheet.background
    settings = [
        ("Format", "eightpost setup study"),
        ("Study", source.title),
        ("Ranked by", source.objective or sheet.ranked_by.name),
        ("Constraints", "; ".join(map(str, source.constraints)) or "none"),
        *source.facts,
    ]
    return _write(path, settings, names, units, _ranking_rows(sheet))


def _ranking_rows(sheet: Sheet) -> Iterator[list[Cell]]:
    """Yield one row per setup, best first: rank, number, builds, values in display units, coupling error, remark."""
    columns, done = shown_columns(sheet), sheet.done
    for place, row in enumerate(sheet.order.tolist(), start=1):
        yield [
            place if done[row] else "",
            int(sheet.numbers[row]),
            *(sheet.builds[build] for build in sheet.placed[row]),
            *(_cell(column.scale.us(float(column.values[row]))) for column in columns),
            _cell(float(sheet.coupling_error[row])),
            sheet.remark(row),
        ]


def write_traces(sheet: Sheet, number: int, series: TimeSeries, path: Path) -> Path:
    """Write the traces of one setup in SI, in the layout of MoTeC i2's CSV export."""
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


#: Largest number of setups in the workbook; the CSV file has all of them.
MOST_ROWS = 20_000


def write_workbook(sheet: Sheet, path: Path) -> Path:
    """Write the workbook; text is never interpreted as a formula.

    Raises:
        OutputError: The file cannot be written.
    """
    # Rows are written to disk at once, so that the memory does not grow with their number.
    options = {"strings_to_formulas": False, "strings_to_urls": False, "constant_memory": True}
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
    columns, count = shown_columns(sheet), min(sheet.numbers.size, MOST_ROWS)
    heads = [f"{column.name} [{column.scale.us.unit}]" for column in columns]
    names = ["rank", "setup", *(corner.upper() for corner in sheet.corners), *heads, "coupling error [%]", "remark"]
    page = workbook.add_worksheet("Ranking")
    first = 2 + len(sheet.corners)
    digits = {k: _digits(column.scale.us(column.extremes[1])) for k, column in enumerate(columns, start=first)}
    _table(workbook, page, names, islice(_ranking_rows(sheet), count), digits)
    for k in digits:
        shades = {"type": "2_color_scale", "min_color": "#FFFFFF", "max_color": "#9CC3E6"}
        page.conditional_format(1, k, max(1, count), k, shades)
    page.freeze_panes(1, first)
    page.autofilter(0, 0, max(1, count), len(names) - 1)
    page.set_column(len(names) - 1, len(names) - 1, 40)


def _digits(value: float) -> str:
    """Return the number format that shows about four digits of values of this size."""
    size = abs(value)
    return "0" if size >= 1000.0 else "0.0" if size >= 100.0 else "0.00" if size >= 10.0 else "0.0000"


def _units(workbook: Any, sheet: Sheet) -> None:
    heads = ["measure", "unit here", "SI unit", "here = factor * SI + offset: factor", "offset", "least", "greatest"]
    rows: list[list[Cell]] = []
    for column in shown_columns(sheet):
        us, (least, greatest) = column.scale.us, column.extremes
        rows.append([column.name, us.unit, us.si, us.factor, us.offset, us(least), us(greatest)])
    _table(workbook, workbook.add_worksheet("Units"), heads, rows)


def _provenance(workbook: Any, sheet: Sheet) -> None:
    source = sheet.background
    words = [("Study", source.title), ("Objective", source.objective or "none"), *source.facts]
    words += [("Constraint", str(bound)) for bound in source.constraints] + [("Note", text) for text in source.notes]
    if sheet.numbers.size > MOST_ROWS:
        text = f"the ranking has the best {MOST_ROWS} of {sheet.numbers.size} setups; all of them are in ranking.csv"
        words.append(("Note", text))
    files = [(o.name, o.file, o.identity, o.digest, ", ".join(o.parameters)) for o in source.origins]
    page = workbook.add_worksheet("Provenance")
    _table(workbook, page, ["what", "value or file", "GUID", "SHA-256", "parameters set"], [*words, *files])
    page.set_column(1, 1, 60)
    page.set_column(2, 3, 68)


def _table(
    workbook: Any,
    page: Any,
    heads: Sequence[str],
    rows: Iterable[Sequence[Cell]],
    digits: Mapping[int, str] = MappingProxyType({}),
) -> None:
    """Write a table; `digits` has number formats by column, which must be known before the rows are written."""
    bold = workbook.add_format({"bold": True, "text_wrap": True, "valign": "top", "bottom": 1})
    page.write_row(0, 0, heads, bold)
    page.set_column(0, len(heads) - 1, 14)
    for k, form in digits.items():
        page.set_column(k, k, 14, workbook.add_format({"num_format": form}))
    for k, row in enumerate(rows, start=1):
        for column, cell in enumerate(row):
            if cell != "":
                write = page.write_string if isinstance(cell, str) else page.write_number
                write(k, column, cell)
