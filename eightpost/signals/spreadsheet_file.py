"""Spreadsheets (.xlsx, .xls, .ods), read with python-calamine: every sheet with a table is read like a text file."""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Any

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.signals.csv_file import text_records
from eightpost.signals.raw_record import RawRecord


def read_spreadsheet(path: str | Path) -> tuple[RawRecord, ...]:
    """Read the tables of all sheets; line numbers in messages are row numbers of the sheet.

    Raises:
        FileFormatError: The file cannot be read, or no sheet has a table.
    """
    path = Path(path)
    sheets = read_confined("eightpost.confined.readers:load_spreadsheet", path, kind="a spreadsheet")
    records: list[RawRecord] = []
    faults: list[FileFormatError] = []
    for rows in sheets.values():
        try:
            records += text_records(["\t".join(map(_text, row)) for row in rows], path)
        except FileFormatError as error:
            faults.append(error)
    if not records:
        sheet_names = ", ".join(map(repr, sheets))
        raise faults[0] if faults else FileFormatError(f"the sheets {sheet_names} are empty", path=path)
    return tuple(records)


def _text(cell: Any) -> str:
    """Return a cell as text that the text reader reads to the same value."""
    if isinstance(cell, bool):
        return str(cell)
    if isinstance(cell, (int, float)):
        return repr(cell)
    if isinstance(cell, datetime.timedelta):
        return f"{cell.total_seconds():.9g}"
    if isinstance(cell, (datetime.datetime, datetime.time)):
        return cell.isoformat()
    return " ".join(str(cell).split())
