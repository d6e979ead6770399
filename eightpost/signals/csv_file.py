"""Delimited text files of signals: dialect, header, blocks of numbers."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from numpy.typing import NDArray

from eightpost.cells import quoted_cell, safe_line
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, reading
from eightpost.signals.faults import Origin
from eightpost.signals.left_out_lines import CUT_NOTE, comment_note, is_cut_off, without_comments
from eightpost.signals.parquet_file import to_arrow, to_numpy
from eightpost.signals.raw_record import RawRecord
from eightpost.signals.text_cleaning import (
    decimal_mark,
    decoded,
    has_three_decimals,
    numbers_with_groups,
    with_minus_signs,
    with_tabs,
    with_whole_headers,
    without_footer,
    without_spaces_before_quotes,
)
from eightpost.signals.text_layout import (
    Block,
    Layout,
    cells_of,
    find_blocks,
    find_layout,
    first_row_of_channels,
    split_cells,
    with_upright_table,
)
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


# ---- Delimited text files with preamble, header with units, and decimal comma ---------------------------------------

#: A format that no cell has, so that times of day and dates stay texts.
_NO_TIMES = "%%never%%"
#: Maximum share of filled cells of a column without a name that is left out: it has remarks beside some samples.
_REMARKS = 0.5
#: Maximum number of characters in a line, enough for about ten thousand channels.
_LONGEST_LINE = 2**18


def read_delimited(path: str | Path) -> tuple[RawRecord, ...]:
    """Read a delimited text file with one or several tables, each with its own header and preamble.

    Supported are preamble lines and footers; units in the header (`velocity [in/s]`, `Force (N)`, `x_mm`) or in a row
    under it; the delimiters `,`, `;`, tab and spaces; decimal points and commas, thousands separators; times of day;
    UTF-8, UTF-16, Shift-JIS and Latin-1. Without a header, the columns are named by their numbers. A table whose rows
    are channels is turned upright.

    Raises:
        FileFormatError: There is no table, or a line has another number of columns.
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
    return text_records(with_tabs(with_whole_headers(without_spaces_before_quotes(lines))), path, may_be_cut=True)


def text_records(lines: list[str], path: Path, *, may_be_cut: bool = False) -> tuple[RawRecord, ...]:
    """Return the tables in the lines of a text file, or in the rows of a spreadsheet as such lines.

    Args:
        lines: Lines of the file.
        path: Path of the file.
        may_be_cut: Whether the last line may have been cut off, as in a text file that was not copied completely.

    Raises:
        FileFormatError: A table cannot be read; see read_delimited.
    """
    lines, signs = with_minus_signs(lines)
    plain, comments = without_comments(lines, cells_of)
    notes = (comment_note(lines, comments),) if comments else ()
    if (first := first_row_of_channels(plain)) is not None:
        (block,) = find_blocks(upright := with_upright_table(plain, first))
        record = _record(upright, block, path, notes=notes, steps=signs, may_be_cut=False)
        rows = np.full(record.columns[0].size, first + 1)
        return (replace(record, origin=Origin(path, rows, first + 1)),)
    blocks = find_blocks(plain)
    return tuple(
        _record(plain, block, path, notes=notes, steps=signs, may_be_cut=may_be_cut and block is blocks[-1])
        for block in blocks
    )


def _record(
    lines: list[str], block: Block, path: Path, *, notes: tuple[str, ...], steps: tuple[str, ...], may_be_cut: bool
) -> RawRecord:
    """Parse one block of the file's lines."""
    layout = find_layout(lines[block.start : block.stop], path, offset=block.start)
    first = layout.first_line
    stop = (
        first
        - 1
        + without_footer(lines[first - 1 : block.stop], lambda line: split_cells(line, layout.delimiter) or [""])
    )
    numbers = np.array([i for i, line in enumerate(lines[first - 1 : stop], first) if line.strip()])
    if may_be_cut and numbers.size:
        ends = [split_cells(lines[i - 1], layout.delimiter)[-1] for i in numbers]
        if is_cut_off(ends, has_end=int(numbers[-1]) < len(lines)):
            notes = (*notes, CUT_NOTE.format(line=numbers[-1], cell=ends[-1]))
            numbers = numbers[:-1]
    rows = (layout.filled(lines[i - 1]) for i in numbers)
    columns, more = _columns("\n".join(rows), layout, numbers, path)
    origin = Origin(path, numbers, layout.unit_line)
    return RawRecord(origin, layout.names, layout.units, columns, block.preamble, notes, (*steps, *more))


def _columns(
    body: str, layout: Layout, numbers: NDArray[np.int64], path: Path
) -> tuple[tuple[NDArray[Any], ...], tuple[str, ...]]:
    """Return one vector (N,) for each named column, of type object if a cell is not a number, and notes."""
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
    if any(_filled(column) > _REMARKS for column in table.columns[named:]):
        what = f"the header names {named} columns, but the lines of numbers have {width}; name every column"
        raise FileFormatError(what, path=path, line=layout.header_line)
    columns = [_vector(column, decimal) for column in table.columns[:named]]
    unclear = [i for i, one in enumerate(columns) if one.dtype == object and decimal == "." and has_three_decimals(one)]
    for i in unclear:
        columns[i] = np.array([float(str(cell).replace(",", ".")) for cell in columns[i]])
    listed = ", ".join(repr(layout.names[i]) for i in unclear)
    note = f"the commas in the column {listed} are decimal: every number has three digits behind one"
    return tuple(columns), (note,) if unclear else ()


def _filled(column: Any) -> float:
    """Return the share of cells that are not empty."""
    if not pa.types.is_string(column.type):
        return 1.0 - float(column.null_count / len(column))
    return sum(bool(cell and cell.strip()) for cell in column.to_pylist()) / max(len(column), 1)


def _vector(column: Any, decimal: str) -> NDArray[Any]:
    """Return a column as numbers with NaN for empty cells, or as objects if it is not numeric."""
    if pa.types.is_null(column.type):
        return np.full(len(column), np.nan)
    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        return to_numpy(column)
    texts = np.array([str(cell) if cell is not None else "" for cell in column.to_pylist()], dtype=object)
    grouped = None if decimal == "." and has_three_decimals(texts) else numbers_with_groups(texts, decimal)
    return texts if grouped is None else grouped


def _ragged(body: str, layout: Layout, numbers: NDArray[np.int64], path: Path) -> FileFormatError | None:
    """Return an error for the first line with a wrong number of cells; slow, so used only after a failure."""
    width = len(layout.names) + layout.padding
    for line, number in zip(body.split("\n"), numbers, strict=True):
        count = len(split_cells(line, layout.delimiter))
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
    table = pa.table([to_arrow(vector) for vector in vectors], names=[str(i) for i in range(len(vectors))])
    with atomic_path(path) as temporary, temporary.open("wb") as stream:
        stream.write("".join(f"{line}\n" for line in (*map(safe_line, preamble), ",".join(header))).encode())
        pa.csv.write_csv(table, stream, pa.csv.WriteOptions(include_header=False))
