"""Layout of text files: delimiter, header, units, and several tables one below the other."""

from __future__ import annotations

import csv
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from eightpost.cells import plain_cell
from eightpost.errors import FileFormatError
from eightpost.signals.column_headers import is_number, split_header, units_row

# ---- Layout of a text file ------------------------------------------------------------------------------------------

#: Number of lines from which the layout is found.
_LAYOUT_LINES = 200
_DELIMITERS = (";", "\t", ",")


@dataclass(frozen=True, slots=True)
class Layout:
    """The layout of a delimited text file."""

    delimiter: str  #: Delimiter: `,`, `;` or a tab.
    names: tuple[str, ...]  #: Column names without units.
    units: tuple[str | None, ...]  #: Units of the columns as written in the file, None for columns without a unit.
    header_line: int | None  #: One-based line number of the header; None without one, when names are numbers from 1.
    unit_line: int | None  #: One-based line number of the units: a separate row, or the header.
    first_line: int  #: One-based line number of the first sample.
    padding: int  #: Number of columns without a name at the end of each line (a trailing delimiter).
    #: Number of cells of lines without the last columns, which only some lines have; 0 if all have them.
    short: int = 0

    def filled(self, line: str) -> str:
        """Return a line with empty cells for the last columns if it has none."""
        if not self.short or len(split_cells(line, self.delimiter)) != self.short:
            return line
        return line + self.delimiter * (len(self.names) - self.short)


def find_layout(lines: list[str], path: Path, *, offset: int = 0) -> Layout:
    """Return the layout, found from the first lines of a file or of a block of it.

    The table is the last part of these lines in which every line has a number. The header is the last line before the
    table, or the line before that if there is a row of units in between.

    Args:
        lines: Lines of the file or block.
        path: Path of the file.
        offset: Number of lines of the file above the first of `lines`.

    Raises:
        FileFormatError: There is no table of numbers, or its header has another number of columns.
    """
    delimiter, rows = _delimiter(lines[:_LAYOUT_LINES], path)
    first = rows[-1]
    while first > 0 and (not lines[first - 1].strip() or _numbers_in(lines[first - 1], delimiter)):
        first -= 1
    top = first
    first = _without_column_numbers(lines, first, delimiter)
    above = [i for i in range(top - 1, -1, -1) if lines[i].strip()]
    width = Counter(len(split_cells(lines[i], delimiter)) for i in rows if i >= first).most_common(1)[0][0]
    if not above or all(len(cells_of(lines[i])) < 2 for i in above):
        numbers = tuple(map(str, range(1, width + 1)))
        return Layout(delimiter, numbers, (None,) * width, None, None, offset + first + 1, 0)
    header, unit_row, units = above[0], above[0], None
    if len(above) > 1 and len(split_cells(lines[above[1]], delimiter)) == width:
        units = units_row(split_cells(lines[header], delimiter))
        header = above[1] if units else header
    full = len(split_cells(lines[header], delimiter))
    last = [cell for i in rows if i >= first and len(row := split_cells(lines[i], delimiter)) == full
            for cell in row[width:]]  # fmt: skip
    short = width if last and not any(map(is_number, last)) else 0  # marks of events in some lines only
    width = full if short else width
    names = _header_cells(lines[header], delimiter, width, offset + header + 1, path)
    split = [(cell, None) if units else split_header(cell) for cell in names]
    stated = [*units, *[""] * len(names)][: len(names)] if units else [unit for _, unit in split]
    return Layout(
        delimiter=delimiter,
        names=tuple(name for name, _ in split),
        units=tuple(unit or None for unit in stated),
        header_line=offset + header + 1,
        unit_line=offset + unit_row + 1,
        first_line=offset + first + 1,
        padding=width - len(names),
        short=short,
    )


def _without_column_numbers(lines: list[str], first: int, delimiter: str) -> int:
    """Return the index of the first sample: below a line of column numbers `1,2,3,4`, if the table begins with one."""
    start = first
    while start < len(lines) and not lines[start].strip():
        start += 1
    cells = split_cells(lines[start], delimiter) if start < len(lines) else []
    below = next((line for line in lines[start + 1 :] if line.strip()), "")
    is_count = len(cells) > 2 and cells == [str(number) for number in range(1, len(cells) + 1)]
    return start + 1 if is_count and _numbers_in(below, delimiter) else first


def _header_cells(text: str, delimiter: str, width: int, line: int, path: Path) -> list[str]:
    """Return the column names of a header line, at most `width`, without empty cells at the end."""
    cells = [plain_cell(cell) for cell in split_cells(text, delimiter)]
    while cells and not cells[-1]:
        cells.pop()
    if not 1 < len(cells) <= width:
        what = f"the header has {len(cells)} columns, but the lines of numbers have {width}"
        raise FileFormatError(what, path=path, line=line)
    return [cell or f"column {number}" for number, cell in enumerate(cells, 1)]


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


def cells_of(line: str) -> list[str]:
    """Split a line at the delimiter that gives the most cells."""
    return max((split_cells(line, delimiter) for delimiter in _DELIMITERS), key=len)


def _numbers_in(line: str, delimiter: str) -> int:
    """Return the number of cells in a line that are numbers."""
    return sum(is_number(cell) for cell in split_cells(line, delimiter))


# ---- Tables whose rows are channels ---------------------------------------------------------------------------------

#: Largest number of channels of such a table.
_MOST_CHANNELS = 60


def first_row_of_channels(lines: list[str]) -> int | None:
    """Return the index of the first line of a table whose rows are channels (`Velocity (mm/s),25,50`), or None.

    Every line with numbers begins with a name, and all its other cells are numbers. Long files have no such table.
    """
    if len(lines) > _LAYOUT_LINES:
        return None
    rows = [i for i, line in enumerate(lines) if sum(map(is_number, cells_of(line))) > 1]
    if not 2 <= len(rows) <= _MOST_CHANNELS or rows[-1] - rows[0] >= len(rows):
        return None
    table = [cells_of(lines[i]) for i in rows]
    named = all(not is_number(name) and name and all(map(is_number, cells)) for name, *cells in table)
    has_header = rows[0] > 0 and len(cells_of(lines[rows[0] - 1])) == len(table[0])
    return rows[0] if named and not has_header and len({len(cells) for cells in table}) == 1 else None


def with_upright_table(lines: list[str], first: int) -> list[str]:
    """Return lines in which the channels of the table from the line `first` on are columns, separated by tabs."""
    table = [cells_of(line) for line in lines[first:] if len(cells_of(line)) > 1]
    return [*lines[:first], *("\t".join(column) for column in zip(*table, strict=False))]


# ---- Blocks of a text file that contains several tables, one below the other, each with its own preamble ------------

#: First characters of a line of numbers; other lines may be headers.
_NUMBER_BEGINS = frozenset("0123456789-+., \t;\"'")
#: Minimum share of the first block's column names in a line that is the header of another block.
_SHARED = 0.5


@dataclass(frozen=True, slots=True)
class Block:
    """A part of a text file with one table."""

    start: int  #: Zero-based number of the first line.
    stop: int  #: Zero-based number of the line after the last line.
    preamble: tuple[tuple[str, ...], ...]  #: Lines above the header, one tuple of cells for each.


def find_blocks(lines: list[str]) -> tuple[Block, ...]:
    """Return the blocks of a text file; a second header below a table begins a new block.

    A header is a line of names above numbers, possibly with a row of units in between. Further headers share at least
    half of the names of the first header. The lines between the last line that begins with a number and the header are
    the block's preamble. A file without a header is returned as one block.
    """
    headers = _headers(lines)
    if not headers:
        return (Block(0, len(lines), ()),)
    starts = [0, *(_preamble_start(lines, header) for header in headers[1:])]
    stops = [*starts[1:], len(lines)]
    return tuple(
        Block(start, stop, _preamble(lines[start:header]))
        for start, stop, header in zip(starts, stops, headers, strict=True)
    )


def _headers(lines: list[str]) -> list[int]:
    """Return the zero-based line numbers of the headers."""
    found: list[int] = []
    first: set[str] = set()
    for i, line in enumerate(lines):
        if not line or line[0] in _NUMBER_BEGINS - {'"', "'"}:
            continue
        names = _names_above_numbers(lines, i)
        if names and (not found or len(names & first) >= _SHARED * len(first)):
            first = first or names
            found.append(i)
    return found


def _names_above_numbers(lines: list[str], row: int) -> set[str]:
    """Return the names in a header line, which is followed by a line of numbers; empty if it is not a header."""
    for delimiter in _DELIMITERS:
        cells = _cells(lines[row], delimiter)
        if len(cells) < 2 or not all(cells) or any(map(is_number, cells)):
            continue
        below = [_cells(line, delimiter) for line in lines[row + 1 : row + 6] if line.strip()][:2]
        if len(below) > 1 and units_row(below[0]):
            below = below[1:]
        if below and len(below[0]) <= len(cells) and sum(map(is_number, below[0])) >= 2:
            return {split_header(cell)[0].lower() for cell in cells}
    return set()


def _preamble_start(lines: list[str], header: int) -> int:
    """Return the number of the line after the last line above `header` that begins with a number."""
    start = header
    while start > 0 and not is_number(_first_cell(lines[start - 1])):
        start -= 1
    return start


def _first_cell(line: str) -> str:
    cells = [split_cells(line, delimiter) for delimiter in _DELIMITERS if delimiter in line]
    numbers = [row[0] for row in cells if row and is_number(row[0])]
    return numbers[0] if numbers else line


def _preamble(lines: list[str]) -> tuple[tuple[str, ...], ...]:
    """Split the lines of a preamble at the delimiter that occurs in most of them."""
    texts = [line for line in lines if line.strip(" \t,;")]
    counts = {delimiter: sum(delimiter in text for text in texts) for delimiter in _DELIMITERS}
    delimiter = max(counts, key=lambda mark: counts[mark])
    return tuple(tuple(_cells(text, delimiter)) for text in texts)


def _cells(line: str, delimiter: str) -> list[str]:
    """Split a line into cells, without empty cells at the end."""
    cells = split_cells(line, delimiter)
    while cells and not cells[-1]:
        cells.pop()
    return cells
