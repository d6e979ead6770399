"""Blocks of a text file that contains several tables, one below the other, each with its own preamble."""

from __future__ import annotations

from dataclasses import dataclass

from eightpost.signals.csv_dialect import split_cells
from eightpost.signals.header import is_number, split_header, units_row

#: First characters of a line of numbers; other lines may be headers.
_NUMBER_BEGINS = frozenset("0123456789-+., \t;\"'")
#: Delimiters that a preamble may use, independent of the delimiter of its table.
_DELIMITERS = (";", "\t", ",")
#: Minimum share of the first block's column names in a line that is the header of another block.
_SHARED = 0.5


@dataclass(frozen=True, slots=True)
class Block:
    """A part of a text file with one table.

    Attributes:
        start: Zero-based number of the first line.
        stop: Zero-based number of the line after the last line.
        preamble: Lines above the header, one tuple of cells for each.
    """

    start: int
    stop: int
    preamble: tuple[tuple[str, ...], ...]


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
