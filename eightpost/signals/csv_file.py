"""Delimited text files with preamble, header with units, and decimal comma."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv

from eightpost.cells import quoted_cell, safe_line
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, reading
from eightpost.signals.arrow_columns import to_arrow, to_numpy
from eightpost.signals.csv_blocks import Block, find_blocks
from eightpost.signals.csv_dialect import Layout, find_layout, split_cells
from eightpost.signals.origin import Origin
from eightpost.signals.raw_record import RawRecord
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries


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
    lines = _text(content).replace("\r\n", "\n").replace("\r", "\n").split("\n")
    if b"\0" in content:
        number = next(number for number, line in enumerate(lines, 1) if "\0" in line)
        what = "it has a zero byte: it is not a text file, or was not copied completely"
        raise FileFormatError(what, path=path, line=number)
    longest = max(map(len, lines))
    if longest > _LONGEST_LINE:
        what = f"the line has {longest} characters, the limit is {_LONGEST_LINE}: this is not a table of channels"
        raise FileFormatError(what, path=path, line=1 + [len(line) for line in lines].index(longest))
    return tuple(_record(lines, block, path) for block in find_blocks(lines))


def _record(lines: list[str], block: Block, path: Path) -> RawRecord:
    """Parse one block of the file's lines."""
    layout = find_layout(lines[block.start : block.stop], path, offset=block.start)
    first = layout.first_line
    numbers = np.array([i for i, line in enumerate(lines[first - 1 : block.stop], first) if line.strip()])
    columns = _columns("\n".join(lines[i - 1] for i in numbers), layout, numbers, path)
    origin = Origin(path, numbers, layout.unit_line)
    return RawRecord(origin, layout.names, layout.units, columns, block.preamble)


def _text(content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _columns(body: str, layout: Layout, numbers: NDArray[np.int64], path: Path) -> tuple[NDArray[Any], ...]:
    """Return one vector (N,) for each named column of the table; of type object if a cell is not a number."""
    width = len(layout.names) + layout.padding
    decimal = "," if layout.delimiter != "," and "," in body else "."
    content = body.encode()
    try:
        table = pa.csv.read_csv(
            io.BytesIO(content),
            read_options=pa.csv.ReadOptions(
                column_names=[str(i) for i in range(width)], use_threads=False, block_size=len(content) + 2
            ),
            parse_options=pa.csv.ParseOptions(delimiter=layout.delimiter),
            convert_options=pa.csv.ConvertOptions(decimal_point=decimal),
        )
    except pa.ArrowException as error:
        raise _ragged(body, layout, numbers, path) or FileFormatError(str(error), path=path) from error
    named = len(layout.names)
    if any(column.null_count < len(column) for column in table.columns[named:]):
        what = f"the header names {named} columns, but the lines of numbers have {width}; name every column"
        raise FileFormatError(what, path=path, line=layout.header_line)
    return tuple(_vector(column) for column in table.columns[:named])


def _vector(column: Any) -> NDArray[Any]:
    """Return a column as numbers with NaN for empty cells, or as objects if it is not numeric."""
    if pa.types.is_null(column.type):
        return np.full(len(column), np.nan)
    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        return to_numpy(column)
    return np.array([str(cell) if cell is not None else "" for cell in column.to_pylist()], dtype=object)


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
