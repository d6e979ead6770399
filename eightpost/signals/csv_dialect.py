"""Layout of a text file: delimiter, preamble, header, row of units, first line of numbers."""

from __future__ import annotations

import csv
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eightpost.cells import plain_cell
from eightpost.errors import FileFormatError
from eightpost.signals.header import is_number, split_header, units_row

if TYPE_CHECKING:
    from pathlib import Path

#: Number of lines from which the layout is found.
_LAYOUT_LINES = 200
_DELIMITERS = (";", "\t", ",")


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of a delimited text file.

    Attributes:
        delimiter: Delimiter: `,`, `;` or a tab.
        names: Column names without units.
        units: Units of the columns as written in the file, None for columns without a unit.
        header_line: One-based line number of the header.
        unit_line: One-based line number of the units: a separate row, or the header.
        first_line: One-based line number of the first sample.
        padding: Number of columns without a name at the end of each line (a trailing delimiter).
    """

    delimiter: str
    names: tuple[str, ...]
    units: tuple[str | None, ...]
    header_line: int
    unit_line: int
    first_line: int
    padding: int


def find_layout(lines: list[str], path: Path, *, offset: int = 0) -> Layout:
    """Return the layout, found from the first lines of a file or of a block of it.

    The table is the last part of these lines in which every line has a number. The header is the last line before the
    table, or the line before that if there is a row of units in between.

    Args:
        lines: Lines of the file or block.
        path: Path of the file.
        offset: Number of lines of the file above the first of `lines`.

    Raises:
        FileFormatError: There is no table of numbers, or no header above it.
    """
    delimiter, rows = _delimiter(lines[:_LAYOUT_LINES], path)
    first = rows[-1]
    while first > 0 and (not lines[first - 1].strip() or _numbers_in(lines[first - 1], delimiter)):
        first -= 1
    above = [i for i in range(first - 1, -1, -1) if lines[i].strip()]
    if not above:
        what = "there is no header line above the numbers; add one such as `time [s],velocity [m/s],force [N]`"
        raise FileFormatError(what, path=path, line=offset + first + 1)
    width = Counter(len(split_cells(lines[i], delimiter)) for i in rows if i >= first).most_common(1)[0][0]
    header, unit_row, units = above[0], above[0], None
    if len(above) > 1 and len(split_cells(lines[above[1]], delimiter)) == width:
        units = units_row(split_cells(lines[header], delimiter))
        header = above[1] if units else header
    names = _header_cells(lines[header], delimiter, width, offset + header + 1, path)
    split = [(cell, None) if units else split_header(cell) for cell in names]
    stated = units[: len(names)] if units else [unit for _, unit in split]
    return Layout(
        delimiter=delimiter,
        names=tuple(name for name, _ in split),
        units=tuple(unit or None for unit in stated),
        header_line=offset + header + 1,
        unit_line=offset + unit_row + 1,
        first_line=offset + first + 1,
        padding=width - len(names),
    )


def _header_cells(text: str, delimiter: str, width: int, line: int, path: Path) -> list[str]:
    """Return the column names of a header line, at most `width`, without empty cells at the end."""
    cells = [plain_cell(cell) for cell in split_cells(text, delimiter)]
    while cells and not cells[-1]:
        cells.pop()
    if not 1 < len(cells) <= width:
        what = f"the header has {len(cells)} columns, but the lines of numbers have {width}"
        raise FileFormatError(what, path=path, line=line)
    if not all(cells):
        raise FileFormatError(f"column {cells.index('') + 1} has no name", path=path, line=line)
    return cells


def _delimiter(lines: list[str], path: Path) -> tuple[str, list[int]]:
    """Return the delimiter that gives the most lines with numbers, and the zero-based numbers of these lines."""
    best: tuple[str, list[int]] = ("", [])
    for delimiter in _DELIMITERS:
        rows = [i for i, line in enumerate(lines) if _numbers_in(line, delimiter) > 1]
        if len(rows) > len(best[1]):
            best = (delimiter, rows)
    if not best[1]:
        what = "there is no table with two or more columns of numbers; supported delimiters are `,`, `;` and tab"
        raise FileFormatError(what, path=path)
    return best


def split_cells(line: str, delimiter: str) -> list[str]:
    """Split a line into stripped cells, taking quotes into account; a line that is not valid CSV is one cell."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:  # a cell of more than 131,072 characters
        return [line.strip()]


def _numbers_in(line: str, delimiter: str) -> int:
    """Return the number of cells in a line that are numbers."""
    return sum(is_number(cell) for cell in split_cells(line, delimiter))
