"""Delimited text files of signals: layout, dialect, header, blocks of numbers, lines that are left out."""

from __future__ import annotations

import csv
import io
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import arro3.io
import numpy as np
from arro3.core import Array, DataType, Field, Schema, Table
from numpy.typing import NDArray

from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, plain_cell, quoted_cell, reading, safe_line
from eightpost.signals.faults import Origin
from eightpost.signals.parquet_file import samples_of
from eightpost.signals.raw_record import IN_MEMORY, Blocks, RawRecord
from eightpost.signals.table_text import (
    decimal_mark,
    decoded,
    has_three_decimals,
    is_number,
    numbers_with_groups,
    split_header,
    units_row,
    with_minus_signs,
    with_tabs,
    with_whole_headers,
    without_footer,
    without_spaces_before_quotes,
)
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


# ==== Reading and writing of delimited text files with preamble, header with units, and decimal comma ================

#: Texts of cells without a number.
_MISSING = frozenset(
    ("", "#N/A", "#N/A N/A", "#NA", "-1.#IND", "-1.#QNAN", "1.#IND", "1.#QNAN", "N/A", "NA", "NULL", "n/a", "null")
)
#: Maximum share of filled cells of a column without a name that is left out: it has remarks beside some samples.
_REMARKS = 0.5
Block = tuple[int, int, tuple[tuple[str, ...], ...]]
_LONGEST_LINE = 2**18  #: Maximum number of characters in a line, enough for about ten thousand channels.


def read_delimited(path: Path) -> tuple[RawRecord, ...]:
    """Read a delimited text file with one or several tables, each with its own header and preamble.

    Supported are preamble lines and footers; units in the header (`velocity [in/s]`, `Force (N)`, `x_mm`) or in a row
    under it; the delimiters `,`, `;`, tab and spaces; decimal points and commas, thousands separators; times of day;
    UTF-8, UTF-16, Shift-JIS and Latin-1. Without a header, the columns are named by their numbers. A table whose rows
    are channels is turned upright.

    Raises:
        FileFormatError: There is no table, or a line has another number of columns.
    """
    with reading(path):
        if path.stat().st_size > IN_MEMORY:
            with suppress(ValueError, FileFormatError):
                return (_read_numbers(path),)
        lines = _lines(path.read_bytes(), path)
    return text_records(lines, path, may_be_cut=True)


def _lines(content: bytes, path: Path) -> list[str]:
    """Return the lines of a text file, with tabs between columns that are separated by spaces."""
    text = decoded(content)
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if "\0" in text:
        number = next(number for number, line in enumerate(lines, 1) if "\0" in line)
        what = "it has a zero byte: it is not a text file, or was not copied completely"
        raise FileFormatError(what, path=path, line=number)
    longest = max(map(len, lines))
    if longest > _LONGEST_LINE:
        what = f"the line has {longest} characters, the limit is {_LONGEST_LINE}: this is not a table of channels"
        raise FileFormatError(what, path=path, line=1 + [len(line) for line in lines].index(longest))
    return with_tabs(with_whole_headers(without_spaces_before_quotes(lines)))


def text_records(lines: list[str], path: Path, *, may_be_cut: bool = False) -> tuple[RawRecord, ...]:
    """Return the tables in the lines of a text file, or in the rows of a spreadsheet as such lines.

    Raises:
        FileFormatError: A table cannot be read; see read_delimited.
    """
    lines, signs = with_minus_signs(lines)
    plain, notes = _without_comments(lines)
    if (first := _first_row_of_channels(plain)) is not None:
        table = [cells for line in plain[first:] if len(cells := _cells_of(line)) > 1]
        upright = [*plain[:first], *("\t".join(column) for column in zip(*table, strict=False))]
        record = _record(upright, _find_blocks(upright)[0], path, notes=notes, steps=signs, may_be_cut=False)
        rows = np.full(record.columns[0].size, first + 1)
        return (replace(record, origin=Origin(path, rows, first + 1)),)
    blocks = _find_blocks(plain)
    return tuple(
        _record(plain, block, path, notes=notes, steps=signs, may_be_cut=may_be_cut and block is blocks[-1])
        for block in blocks
    )


def _record(
    lines: list[str], block: Block, path: Path, *, notes: tuple[str, ...], steps: tuple[str, ...], may_be_cut: bool
) -> RawRecord:
    """Parse one block of the file's lines."""
    start, end, preamble = block
    layout = _find_layout(lines[start:end], path, offset=start)
    first = layout.first_line
    cells: Sequence[list[str]] = _Cells(lines[first - 1 : end], layout.delimiter)
    if sum(map(len, lines)) <= IN_MEMORY:
        cells = list(cells)
    stop = first - 1 + without_footer(cells)
    numbers = np.array([i for i, line in enumerate(lines[first - 1 : stop], first) if line.strip()])
    if may_be_cut and numbers.size:
        ends = [cells[i - first][-1] for i in numbers]
        if _is_cut_off(ends, has_end=int(numbers[-1]) < len(lines)):
            note = (
                f"the last sample (line {numbers[-1]}) was left out: its last number {ends[-1]!r} has fewer digits "
                "than the others, so the file is probably not complete; export it again"
            )
            notes, numbers = (*notes, note), numbers[:-1]
    decimal = decimal_mark("\n".join(lines[i - 1] for i in numbers), layout.delimiter)
    columns, more = _columns(cells, layout, decimal, numbers, path)
    origin = Origin(path, numbers, layout.unit_line)
    return RawRecord(origin, layout.names, layout.units, columns, preamble, notes, (*steps, *more))


class _Cells(Sequence[list[str]]):
    """The cells of lines, which are split when they are used: all together take many times the memory of the lines."""

    def __init__(self, lines: Sequence[str], delimiter: str) -> None:
        self._lines, self._delimiter = lines, delimiter

    def __len__(self) -> int:
        return len(self._lines)

    def __getitem__(self, place: Any) -> Any:
        return _split_cells(self._lines[place], self._delimiter) or [""]


def _columns(
    cells: Sequence[list[str]], layout: Layout, decimal: str, numbers: NDArray[np.int64], path: Path
) -> tuple[tuple[NDArray[Any], ...], tuple[str, ...]]:
    """Return one vector (N,) for each named column, of type object if a cell is not a number, and notes.

    `cells` are those of all lines from the first sample on, of which the lines `numbers` (N,) are samples.
    """
    named = len(layout.names)
    width = named + layout.padding
    places = (numbers - layout.first_line).tolist()
    parts: list[list[NDArray[Any] | None]] = [[np.empty(0)] for _ in layout.names]
    remarks = np.zeros(layout.padding)
    for start in range(0, len(places), _ROWS):
        rows = [layout.filled(cells[i]) for i in places[start : start + _ROWS]]
        for row, number in zip(rows, numbers[start:], strict=False):
            if len(row) != width:
                what = f"the line has {len(row)} columns instead of {width}; check whether the file was truncated"
                raise FileFormatError(what, path=path, line=int(number))
        table = list(zip(*rows, strict=True))
        remarks += [sum(cell not in _MISSING for cell in column) for column in table[named:]]
        for own, column in zip(parts, table, strict=False):
            own.append(_numbers(column, decimal))
    if (remarks > _REMARKS * len(places)).any():
        what = f"the header names {named} columns, but the lines of numbers have {width}; name every column"
        raise FileFormatError(what, path=path, line=layout.header_line)
    columns = [
        np.concatenate(found)
        if len(found := [part for part in own if part is not None]) == len(own)
        else _texts([layout.filled(cells[i])[k] for i in places], decimal)
        for k, own in enumerate(parts)
    ]
    unclear = [i for i, one in enumerate(columns) if one.dtype == object and decimal == "." and has_three_decimals(one)]
    for i in unclear:
        columns[i] = np.array([float(str(cell).replace(",", ".")) for cell in columns[i]])
    listed = ", ".join(repr(layout.names[i]) for i in unclear)
    note = f"the commas in the column {listed} are decimal: every number has three digits behind one"
    return tuple(columns), (note,) if unclear else ()


def _numbers(cells: Sequence[str], decimal: str) -> NDArray[np.float64] | None:
    """Return a column as numbers with NaN for empty cells; None if one is not a plain number."""
    text = "".join(cells)
    if "_" not in text and (decimal == "." or "." not in text):  # Python would read 1_000
        plain = cells if decimal == "." else [cell.replace(",", ".") for cell in cells]
        with suppress(ValueError):  # the usual case, in a third of the time
            return np.fromiter(map(float, plain), np.float64, len(plain))
        with suppress(ValueError):
            return np.array([np.nan if cell in _MISSING else float(cell) for cell in plain])
    return None


def _texts(cells: Sequence[str], decimal: str) -> NDArray[Any]:
    """Return a column that is not of plain numbers: as numbers if they have thousands separators, else as objects."""
    texts = np.array(cells, dtype=object)
    grouped = None if decimal == "." and has_three_decimals(texts) else numbers_with_groups(texts, decimal)
    return texts if grouped is None else grouped


# ---- A large file with nothing but numbers below its header, read by a library block by block -----------------------

#: Beginning of a file in which its layout is found [bytes], its end in which there may be empty lines, and rows of a
#: block.
_HEAD, _END, _ROWS = 2**20, 64, 2**14


class _Translated(io.RawIOBase):
    """A file of numbers with decimal points instead of another mark; it counts its line breaks."""

    def __init__(self, stream: BinaryIO, decimal: str) -> None:
        self._stream, self.breaks, self.end = stream, 0, b""
        self._table = bytes.maketrans(b",.", b".?") if decimal == "," else None

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes."""
        content = self._stream.read(size)
        self.breaks += content.count(b"\n")
        self.end = (self.end + content)[-_END:]
        return content.translate(self._table)


def _read_numbers(path: Path) -> RawRecord:
    """Return the table of a file.

    Raises:
        ValueError: The file has, or may have, something else than numbers below its header.
        FileFormatError: Its beginning is not that of a table.
    """
    with path.open("rb") as stream, tempfile.SpooledTemporaryFile(IN_MEMORY) as file:
        head = stream.read(_HEAD)
        lines, signs = with_minus_signs(_lines(head[: head.rfind(b"\n")], path))
        lines, notes = _without_comments(lines)
        ((_, _, preamble),) = _find_blocks(lines)
        layout = _find_layout(lines, path)
        first, names = layout.first_line, layout.names
        decimal = decimal_mark("\n".join(lines[first - 1 :]), layout.delimiter)
        has_more = signs or notes or layout.padding or layout.short or b"\r" in head.replace(b"\r\n", b"")
        is_short = len(lines) <= _LAYOUT_LINES
        if has_more or is_short or decimal == layout.delimiter or _first_row_of_channels(lines) is not None:
            raise ValueError("it is not a plain table")
        stream.seek(len(head) - len(head.split(b"\n", first - 1)[-1]))
        numbers, blocks = _Translated(stream, decimal), Blocks(len(names), file)
        digits: list[NDArray[np.int16]] = []
        for rows, ends in _blocks(numbers, len(names), layout.delimiter):
            digits.append(np.array([_digits(cell) for cell in ends], dtype=np.int16))
            blocks.add(rows)
        columns = blocks.columns()
    all_digits = np.concatenate(digits)
    empty = numbers.end[len(numbers.end.rstrip()) :].count(b"\n")
    has_gaps = numbers.breaks - empty + 1 != len(all_digits) or all(np.isnan(row[-1]) for row in rows)
    if has_gaps or _is_shorter(all_digits, ends[-1], lambda: np.asarray(columns[-1]), has_end=empty > 0):
        raise ValueError("it has empty lines, or its last number is cut off")
    origin = Origin(path, np.arange(first, first + len(all_digits)), layout.unit_line)
    return RawRecord(origin, names, layout.units, columns, preamble)


def _blocks(numbers: _Translated, count: int, delimiter: str) -> Iterator[tuple[list[NDArray[Any]], list[str]]]:
    """Yield the columns of successive lines, and the texts of the last one."""
    kinds = [*[DataType.float64()] * (count - 1), DataType.utf8()]
    schema = Schema([Field(str(i), kind, nullable=True) for i, kind in enumerate(kinds)])
    try:
        for batch in arro3.io.read_csv(numbers, schema, has_header=False, delimiter=delimiter, batch_size=_ROWS):
            ends = [str(cell or "").strip() for cell in batch.columns[-1].to_pylist()]
            last = _numbers(ends, ".")
            if last is None:
                raise ValueError("a cell is not a plain number")
            yield [*map(samples_of, batch.columns[:-1]), last], ends
    except Exception as error:
        if type(error) is not Exception:  # which arro3 raises
            raise
        raise ValueError("a line has another number of cells, or a cell is not a plain number") from error


def write_csv(
    series: TimeSeries,
    path: str | Path,
    *,
    units: Mapping[str, str] | None = None,
    decimals: Mapping[str, int] | None = None,
    titles: Mapping[str, str] | None = None,
    preamble: Sequence[str] = (),
) -> None:
    """Write a series as comma-separated text with the units in brackets in the header.

    Args:
        series: Series to write.
        path: Path of the file, which is replaced atomically.
        units: Units in the file, by channel name or `time`; default SI.
        decimals: Number of digits after the decimal point, by channel name; default full precision.
        titles: Column titles, by channel name; default the channel name.
        preamble: Lines before the header.

    Raises:
        UnknownUnitError: A unit is unknown or has another dimension than the channel.
        FileFormatError: The file cannot be written.
    """
    units, decimals, titles = units or {}, decimals or {}, titles or {}
    columns = {"time": ("s", series.time)}
    columns |= {n: (u, row) for n, u, row in zip(series.names, series.units, series.values, strict=True)}
    header, vectors = [], []
    for name, (unit, values) in columns.items():
        written = units.get(name, unit)
        converted = convert(values, unit, written)
        header.append(quoted_cell(f"{titles.get(name, name)} [{written}]"))
        # Adding zero turns -0.0, which rounding may give, into 0.0.
        vectors.append(converted if name not in decimals else np.round(converted, decimals[name]) + 0.0)
    arrays = [Array.from_numpy(np.ascontiguousarray(vector)) for vector in vectors]
    table = Table.from_arrays(arrays, names=[str(i) for i in range(len(arrays))])
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write("".join(f"{line}\n" for line in (*map(safe_line, preamble), ",".join(header))).encode())
        arro3.io.write_csv(table, stream, header=False)


# ==== Layout: delimiter, header, units, and several tables one below the other =======================================

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

    def filled(self, cells: list[str]) -> list[str]:
        """Return the cells of a line with empty ones for the last columns if it has none."""
        return cells + [""] * (len(self.names) - self.short) if self.short and len(cells) == self.short else cells


def _find_layout(lines: list[str], path: Path, *, offset: int = 0) -> Layout:
    """Return the layout, found from the first lines of a file or of a block of it.

    The table is the last part of these lines in which every line has a number. The header is the last line before the
    table, or the line before that if there is a row of units in between.

    `offset` is the number of lines of the file above the first of `lines`.
    """
    delimiter, rows = _delimiter(lines[:_LAYOUT_LINES], path)
    first = rows[-1]
    while first > 0 and (not lines[first - 1].strip() or _numbers_in(lines[first - 1], delimiter)):
        first -= 1
    top = first
    first = _without_column_numbers(lines, first, delimiter)
    above = [i for i in range(top - 1, -1, -1) if lines[i].strip()]
    width = Counter(len(_split_cells(lines[i], delimiter)) for i in rows if i >= first).most_common(1)[0][0]
    if not above or all(len(_cells_of(lines[i])) < 2 for i in above):
        numbers = tuple(map(str, range(1, width + 1)))
        return Layout(delimiter, numbers, (None,) * width, None, None, offset + first + 1, 0)
    header, unit_row, units = above[0], above[0], None
    if len(above) > 1 and len(_split_cells(lines[above[1]], delimiter)) == width:
        units = units_row(_split_cells(lines[header], delimiter))
        header = above[1] if units else header
    full = len(_split_cells(lines[header], delimiter))
    last = [cell for i in rows if i >= first and len(row := _split_cells(lines[i], delimiter)) == full
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
    cells = _split_cells(lines[start], delimiter) if start < len(lines) else []
    below = next((line for line in lines[start + 1 :] if line.strip()), "")
    is_count = len(cells) > 2 and cells == [str(number) for number in range(1, len(cells) + 1)]
    return start + 1 if is_count and _numbers_in(below, delimiter) else first


def _header_cells(text: str, delimiter: str, width: int, line: int, path: Path) -> list[str]:
    """Return the column names of a header line, at most `width`, without empty cells at the end."""
    cells = [plain_cell(cell) for cell in _split_cells(text, delimiter)]
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


#: Length of a line without long cells, and characters that the module csv treats specially.
_SHORT, _SPECIAL = 2**16, re.compile(r'["\r\n]')


def _split_cells(line: str, delimiter: str) -> list[str]:
    """Split a line into stripped cells, taking quotes into account; a line that is not valid CSV is one cell."""
    if line and len(line) < _SHORT and not _SPECIAL.search(line):
        return [cell.strip() for cell in line.split(delimiter)]  # the same, in a third of the time
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:  # a cell of more than 131,072 characters
        return [line.strip()]


def _cells_of(line: str) -> list[str]:
    """Split a line at the delimiter that gives the most cells."""
    return max((_split_cells(line, delimiter) for delimiter in _DELIMITERS), key=len)


def _numbers_in(line: str, delimiter: str) -> int:
    """Return the number of cells in a line that are numbers."""
    return sum(is_number(cell) for cell in _split_cells(line, delimiter))


_MOST_CHANNELS = 60  #: Largest number of channels of a table whose rows are channels.


def _first_row_of_channels(lines: list[str]) -> int | None:
    """Return the index of the first line of a table whose rows are channels (`Velocity (mm/s),25,50`), or None.

    Every line with numbers begins with a name, and all its other cells are numbers.
    """
    numbered = (i for i, line in enumerate(lines[:_LAYOUT_LINES]) if sum(map(is_number, _cells_of(line))) > 1)
    rows = list(islice(numbered, _MOST_CHANNELS + 1))
    if not 2 <= len(rows) <= _MOST_CHANNELS or rows[-1] - rows[0] >= len(rows):
        return None
    table = [_cells_of(lines[i]) for i in rows]
    named = all(not is_number(name) and name and all(map(is_number, cells)) for name, *cells in table)
    has_header = rows[0] > 0 and len(_cells_of(lines[rows[0] - 1])) == len(table[0])
    return rows[0] if named and not has_header and len({len(cells) for cells in table}) == 1 else None


# ---- Blocks of a text file that contains several tables, one below the other, each with its own preamble ------------

#: First characters of a line of numbers; other lines may be headers.
_NUMBER_BEGINS = frozenset("0123456789-+., \t;\"'")
_SHARED = 0.5  #: Minimum share of the first block's column names in a line that is the header of another block.


def _find_blocks(lines: list[str]) -> list[Block]:
    """Return the blocks of a text file with one table each; a second header below a table begins a new block.

    A block is the numbers of its first line and of the line after its last one, and the cells of its preamble's lines.
    A header is a line of names above numbers, possibly with a row of units in between. Further headers share at least
    half of the names of the first header. The lines between the last line that begins with a number and the header are
    the block's preamble. A file without a header is returned as one block.
    """
    headers = _headers(lines)
    if not headers:
        return [(0, len(lines), ())]
    starts = [0]
    for header in headers[1:]:  # below the last line above it that begins with a number
        starts.append(next((i for i in range(header, 0, -1) if _begins_with_number(lines[i - 1])), 0))
    spans = zip(starts, [*starts[1:], len(lines)], headers, strict=True)
    return [(start, stop, _preamble(lines[start:header])) for start, stop, header in spans]


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
        rows = [len(row) <= len(cells) and sum(map(is_number, row)) >= 2 for row in below]
        if rows[:1] == [True] or (rows[1:] == [True] and units_row(below[0])):
            return {split_header(cell)[0].lower() for cell in cells}
    return set()


def _begins_with_number(line: str) -> bool:
    cells = (_split_cells(line, delimiter)[0] for delimiter in _DELIMITERS if delimiter in line)
    return any(map(is_number, cells)) or is_number(line)


def _preamble(lines: list[str]) -> tuple[tuple[str, ...], ...]:
    """Split the lines of a preamble at the delimiter that occurs in most of them."""
    texts = [line for line in lines if line.strip(" \t,;")]
    counts = {delimiter: sum(delimiter in text for text in texts) for delimiter in _DELIMITERS}
    delimiter = max(counts, key=lambda mark: counts[mark])
    return tuple(tuple(_cells(text, delimiter)) for text in texts)


def _cells(line: str, delimiter: str) -> list[str]:
    """Split a line into cells, without empty cells at the end."""
    cells = _split_cells(line, delimiter)
    while cells and not cells[-1]:
        cells.pop()
    return cells


# ==== Lines that are left out with a note: comments among the samples, a last sample that was cut off ================

_COMMENT = re.compile(r"\s*(?:#|%|//)")
_SHOWN = 60  #: Maximum number of characters of a comment in a note.


def _without_comments(lines: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """Return lines in which comments between two lines of numbers are empty, and a note on these comments.

    A comment with as many cells as the numbers around it may be a header, and is kept.
    """
    places: list[int] = []
    kept = list(lines)
    for i in (i for i, line in enumerate(lines) if _COMMENT.match(line)):
        before, after = _neighbour(lines, i, -1), _neighbour(lines, i, 1)
        if not before or not after:
            continue
        cells = [_cells_of(line) for line in (before, lines[i], after)]
        if all(sum(map(is_number, row)) > 1 for row in (cells[0], cells[2])) and len(cells[1]) < len(cells[0]):
            places.append(i)
            kept[i] = ""
    if not places:
        return kept, ()
    first = lines[places[0]].strip()
    shown = first if len(first) <= _SHOWN else f"{first[:_SHOWN]}..."
    return kept, (
        f"{len(places)} comment lines among the samples were left out, the first is line {places[0] + 1}: {shown!r}; "
        "if it states a change of the test, fit the parts alone (--set segment)",
    )


def _neighbour(lines: Sequence[str], start: int, step: int) -> str:
    """Return the next line that is not empty and not a comment; empty at the end of the file."""
    place = start + step
    while 0 <= place < len(lines) and (not lines[place].strip() or _COMMENT.match(lines[place])):
        place += step
    return lines[place] if 0 <= place < len(lines) else ""


# ---- A sample that was cut off --------------------------------------------------------------------------------------

_MARKS = re.compile(r"[eE].*|\D")
_DIGITS = re.compile(r"[^eE]*?(?:[.,](?P<decimals>\d*))?(?:[eE][+-]?(?P<exponent>\d*))?")
_FEWEST_ROWS = 50  #: Minimum number of rows of a table whose last row can be judged; peak-velocity tables are shorter.
_RARE = 0.01  #: Share of the numbers that may have even fewer digits: programs leave out zeros at the end.
#: A short number at the end is cut off if it is this many times farther from its predecessors' line than any other.
_FAR = 2.0


def _is_cut_off(cells: Sequence[str], *, has_end: bool) -> bool:
    """Return whether the last of the numbers that end each row was cut off: it has fewer digits than all above it.

    If the file ends with a line end, only a change of a fixed number of decimals counts, because the program that
    wrote the file ended it. Without one, the digits of an exponent count too, and so does the value of a number with
    few digits: it is cut off if it is at least twice as far from the line through its two predecessors as any other.
    """

    def values() -> NDArray[Any] | None:
        return _numbers([cell.replace(",", ".") for cell in cells], ".")

    digits = np.array([_digits(cell) for cell in cells])
    return len(cells) >= _FEWEST_ROWS and _is_shorter(digits, cells[-1], values, has_end=has_end)


def _is_shorter(
    digits: NDArray[np.integer], last: str, values: Callable[[], NDArray[Any] | None], *, has_end: bool
) -> bool:
    """Return whether the last of numbers was cut off, from the digits (N, 3) and, if needed, the values (N,) of all."""
    if not is_number(last):
        return False
    above = np.sort(digits[:-1], axis=0)
    decimals, exponent, size = digits[-1]
    least, most = above[0 if has_end else round(_RARE * len(above))], above[-1]
    if has_end:
        return bool(decimals < least[0] == most[0])
    if decimals < least[0] or exponent < least[1]:
        return True
    if size >= max(digits[-2, 2], np.median(digits[:, 2])) or (known := values()) is None:
        return False
    bends = np.abs(np.diff(known, 2))
    return bool(bends[-1] > _FAR * bends[:-1].max())


def _digits(cell: str) -> tuple[int, int, int]:
    """Return the number of decimals, of the digits of the exponent, and of those of the rest without leading zeros."""
    match, size = _DIGITS.fullmatch(cell), len(_MARKS.sub("", cell).lstrip("0"))
    return (len(match["decimals"] or ""), len(match["exponent"] or ""), size) if match else (0, 0, size)
