"""CSV files of signals: dialect, header, blocks of numbers."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from eightpost.cells import plain_cell, quoted_cell, safe_line
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, reading
from eightpost.signals.faults import Origin
from eightpost.signals.parquet_file import to_arrow, to_numpy
from eightpost.signals.raw_record import RawRecord, is_number, split_header, units_row
from eightpost.signals.text_cleaning import decimal_mark, decoded, numbers_with_groups, with_tabs, without_footer
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


# ---- Layout of a text file ------------------------------------------------------------------------------------------

#: Number of lines from which the layout is found.
_LAYOUT_LINES = 200
_DELIMITERS = (";", "\t", ",")


@dataclass(frozen=True, slots=True)
class _Layout:
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


def _find_layout(lines: list[str], path: Path, *, offset: int = 0) -> _Layout:
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
    width = Counter(len(_split_cells(lines[i], delimiter)) for i in rows if i >= first).most_common(1)[0][0]
    header, unit_row, units = above[0], above[0], None
    if len(above) > 1 and len(_split_cells(lines[above[1]], delimiter)) == width:
        units = units_row(_split_cells(lines[header], delimiter))
        header = above[1] if units else header
    names = _header_cells(lines[header], delimiter, width, offset + header + 1, path)
    split = [(cell, None) if units else split_header(cell) for cell in names]
    stated = units[: len(names)] if units else [unit for _, unit in split]
    return _Layout(
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


def _split_cells(line: str, delimiter: str) -> list[str]:
    """Split a line into stripped cells, taking quotes into account; a line that is not valid CSV is one cell."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:  # a cell of more than 131,072 characters
        return [line.strip()]


def _numbers_in(line: str, delimiter: str) -> int:
    """Return the number of cells in a line that are numbers."""
    return sum(is_number(cell) for cell in _split_cells(line, delimiter))


# ---- Blocks of a text file that contains several tables, one below the other, each with its own preamble ------------

#: First characters of a line of numbers; other lines may be headers.
_NUMBER_BEGINS = frozenset("0123456789-+., \t;\"'")
#: Minimum share of the first block's column names in a line that is the header of another block.
_SHARED = 0.5


@dataclass(frozen=True, slots=True)
class _Block:
    """A part of a text file with one table.

    Attributes:
        start: Zero-based number of the first line.
        stop: Zero-based number of the line after the last line.
        preamble: Lines above the header, one tuple of cells for each.
    """

    start: int
    stop: int
    preamble: tuple[tuple[str, ...], ...]


def _find_blocks(lines: list[str]) -> tuple[_Block, ...]:
    """Return the blocks of a text file; a second header below a table begins a new block.

    A header is a line of names above numbers, possibly with a row of units in between. Further headers share at least
    half of the names of the first header. The lines between the last line that begins with a number and the header are
    the block's preamble. A file without a header is returned as one block.
    """
    headers = _headers(lines)
    if not headers:
        return (_Block(0, len(lines), ()),)
    starts = [0, *(_preamble_start(lines, header) for header in headers[1:])]
    stops = [*starts[1:], len(lines)]
    return tuple(
        _Block(start, stop, _preamble(lines[start:header]))
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
    cells = [_split_cells(line, delimiter) for delimiter in _DELIMITERS if delimiter in line]
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
    cells = _split_cells(line, delimiter)
    while cells and not cells[-1]:
        cells.pop()
    return cells


# ---- Delimited text files with preamble, header with units, and decimal comma ---------------------------------------

#: A format that no cell has, so that times of day and dates stay texts.
_NO_TIMES = "%%never%%"
#: Maximum number of characters in a line, enough for about ten thousand channels.
_LONGEST_LINE = 2**18


def read_csv(path: str | Path) -> RawRecord:
    """Read a delimited text file.

    Supported are preamble lines; units in the header (`velocity [in/s]`, `Force (N)`, `x_mm`) or in a row under it; the
    delimiters `,`, `;` and tab; the decimal comma with `;` and tab; UTF-8 and Latin-1.

    Raises:
        FileFormatError: There is no table or more than one, no header, or a line with another number of columns.
    """
    records = read_csv_blocks(path)
    if len(records) > 1:
        places = ", ".join(str(record.origin.header_line) for record in records)
        what = f"the file has {len(records)} tables (headers in lines {places}); keep one, or read all of them"
        raise FileFormatError(what, path=path, line=records[1].origin.header_line)
    return records[0]


def read_csv_blocks(path: str | Path) -> tuple[RawRecord, ...]:
    """Read a delimited text file that may contain several tables, each with its own header and preamble.

    Raises:
        FileFormatError: A table cannot be read; see read_csv.
    """
    path = Path(path)
    with reading(path):
        content = path.read_bytes()
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
    return text_records(with_tabs(lines), path)


def text_records(lines: list[str], path: Path) -> tuple[RawRecord, ...]:
    """Return the tables in the lines of a text file, or in the rows of a spreadsheet as such lines.

    Raises:
        FileFormatError: A table cannot be read; see read_csv.
    """
    return tuple(_record(lines, block, path) for block in _find_blocks(lines))


def _record(lines: list[str], block: _Block, path: Path) -> RawRecord:
    """Parse one block of the file's lines."""
    layout = _find_layout(lines[block.start : block.stop], path, offset=block.start)
    first = layout.first_line
    stop = (
        first
        - 1
        + without_footer(lines[first - 1 : block.stop], lambda line: _split_cells(line, layout.delimiter) or [""])
    )
    numbers = np.array([i for i, line in enumerate(lines[first - 1 : stop], first) if line.strip()])
    columns = _columns("\n".join(lines[i - 1] for i in numbers), layout, numbers, path)
    origin = Origin(path, numbers, layout.unit_line)
    return RawRecord(origin, layout.names, layout.units, columns, block.preamble)


def _columns(body: str, layout: _Layout, numbers: NDArray[np.int64], path: Path) -> tuple[NDArray[Any], ...]:
    """Return one vector (N,) for each named column of the table; of type object if a cell is not a number."""
    width = len(layout.names) + layout.padding
    decimal = decimal_mark(body, layout.delimiter)
    content = body.encode()
    try:
        table = pa.csv.read_csv(
            io.BytesIO(content),
            read_options=pa.csv.ReadOptions(
                column_names=[str(i) for i in range(width)], use_threads=False, block_size=len(content) + 2
            ),
            parse_options=pa.csv.ParseOptions(delimiter=layout.delimiter),
            convert_options=pa.csv.ConvertOptions(decimal_point=decimal, timestamp_parsers=[_NO_TIMES]),
        )
    except pa.ArrowException as error:
        raise _ragged(body, layout, numbers, path) or FileFormatError(str(error), path=path) from error
    named = len(layout.names)
    if any(column.null_count < len(column) for column in table.columns[named:]):
        what = f"the header names {named} columns, but the lines of numbers have {width}; name every column"
        raise FileFormatError(what, path=path, line=layout.header_line)
    return tuple(_vector(column, decimal) for column in table.columns[:named])


def _vector(column: Any, decimal: str) -> NDArray[Any]:
    """Return a column as numbers with NaN for empty cells, or as objects if it is not numeric."""
    if pa.types.is_null(column.type):
        return np.full(len(column), np.nan)
    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        return to_numpy(column)
    texts = np.array([str(cell) if cell is not None else "" for cell in column.to_pylist()], dtype=object)
    grouped = numbers_with_groups(texts, decimal)
    return texts if grouped is None else grouped


def _ragged(body: str, layout: _Layout, numbers: NDArray[np.int64], path: Path) -> FileFormatError | None:
    """Return an error for the first line with a wrong number of cells; slow, so used only after a failure."""
    width = len(layout.names) + layout.padding
    for line, number in zip(body.split("\n"), numbers, strict=True):
        count = len(_split_cells(line, layout.delimiter))
        if count != width:
            what = f"the line has {count} columns instead of {width}; check whether the file was truncated"
            return FileFormatError(what, path=path, line=int(number))
    return None


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
    table = pa.table([to_arrow(vector) for vector in vectors], names=[str(i) for i in range(len(vectors))])
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write("".join(f"{line}\n" for line in (*map(safe_line, preamble), ",".join(header))).encode())
        pa.csv.write_csv(table, stream, pa.csv.WriteOptions(include_header=False))
