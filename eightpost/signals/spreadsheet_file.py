"""Spreadsheets (.xlsx, .xls, .ods), read with python-calamine: every sheet with a table is read like a text file."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.extras import is_installed, requirement
from eightpost.signals.csv_file import text_records
from eightpost.signals.raw_record import RawRecord

if TYPE_CHECKING:
    from eightpost.confined.readers import Sheet

#: The library rounds dates and times of day to 1 ms. If that makes more than this share of the steps uneven, and they
#: are below this many seconds, the rounding changes a velocity by several percent.
_UNEVEN, _SHORT = 0.1, 0.02

_Clock = datetime.datetime | datetime.time | datetime.timedelta


def read_spreadsheet(path: str | Path) -> tuple[RawRecord, ...]:
    """Read the tables of all sheets; line numbers in messages are row numbers of the sheet.

    Hidden sheets are read only if no other sheet has a table; a note names those that were left out.

    Raises:
        FileFormatError: python-calamine is not installed, the file cannot be read, no sheet has a table, or a column of
            dates or times of day is sampled too fast for a resolution of 1 ms.
    """
    path = Path(path)
    if not is_installed("python_calamine"):
        raise FileFormatError(requirement("reading spreadsheets", "python_calamine", "files"), path=path)
    sheets: list[Sheet] = read_confined("eightpost.confined.readers:load_spreadsheet", path, kind="a spreadsheet")
    hidden = [sheet for sheet in sheets if sheet.is_hidden]
    records, faults = _tables([sheet for sheet in sheets if not sheet.is_hidden], path)
    if records:
        left_out = tuple(
            f"the sheet {sheet.name!r} is hidden and was not read" for sheet in hidden if _has_table(sheet, path)
        )
        return tuple(replace(record, notes=(*record.notes, *left_out)) for record in records)
    records, more = _tables(hidden, path)
    if not records:
        sheet_names = ", ".join(repr(sheet.name) for sheet in sheets)
        empty = FileFormatError(f"the sheets {sheet_names} are empty", path=path)
        raise next(iter((*faults, *more)), empty)
    return tuple(records)


def _tables(sheets: Sequence[Sheet], path: Path) -> tuple[list[RawRecord], list[FileFormatError]]:
    """Return the tables of sheets, and the errors of the sheets without one."""
    records: list[RawRecord] = []
    faults: list[FileFormatError] = []
    for sheet in sheets:
        _check_clocks(sheet.rows, sheet.name, path)
        try:
            records += text_records(["\t".join(map(_text, row)) for row in sheet.rows], path)
        except FileFormatError as error:
            faults.append(error)
    return records, faults


def _has_table(sheet: Sheet, path: Path) -> bool:
    try:
        return bool(_tables([sheet], path)[0])
    except FileFormatError:  # a table with a fault
        return True


def _check_clocks(rows: Sequence[Sequence[Any]], sheet: str, path: Path) -> None:
    """Check that dates and times of day of a sheet are not coarser than its samples."""
    for number in range(max(map(len, rows), default=0)):
        cells = (row[number] for row in rows if number < len(row))
        seconds = [_seconds(cell) for cell in cells if isinstance(cell, _Clock)]
        steps = [later - earlier for earlier, later in pairwise(seconds)]
        if not steps or not 0.0 < (step := median(steps)) < _SHORT:
            continue
        if sum(abs(one - step) > 1e-4 for one in steps) > _UNEVEN * len(steps):
            raise FileFormatError(
                f"sheet {sheet!r}, column {number + 1}: its dates or times of day are read to 1 ms, too coarse for "
                f"samples every {1e3 * step:.2g} ms or so; write elapsed seconds as numbers, or export the record as "
                "text",
                path=path,
            )


def _seconds(cell: _Clock) -> float:
    """Return the seconds since midnight, or of an elapsed time."""
    if isinstance(cell, datetime.timedelta):
        return cell.total_seconds()
    return 3600.0 * cell.hour + 60.0 * cell.minute + cell.second + 1e-6 * cell.microsecond


def _text(cell: Any) -> str:
    """Return a cell as text that the text reader reads to the same value."""
    if isinstance(cell, bool):
        return str(cell)
    if isinstance(cell, (int, float)):
        return repr(cell)
    if isinstance(cell, datetime.timedelta) and cell.total_seconds() >= 0.0:
        minutes, seconds = divmod(cell.total_seconds(), 60.0)
        return f"{minutes // 60.0:.0f}:{minutes % 60.0:02.0f}:{seconds:09.6f}"
    if isinstance(cell, (datetime.datetime, datetime.time)):
        return cell.isoformat()
    return " ".join(str(cell).split())
