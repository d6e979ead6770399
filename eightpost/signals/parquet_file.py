"""Parquet files of tables and of signals, and the header of all files that eightpost writes."""

from __future__ import annotations

import json
import os
import struct
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Literal

import arro3.core as arrow
import arro3.io
import numpy as np
from arro3.core import DataType
from numpy.typing import NDArray

from eightpost import __version__
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, check_schema, parse_json, reading
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import IN_MEMORY, Blocks, RawRecord
from eightpost.signals.table_text import named_with_unit
from eightpost.workers import supervision

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


# ==== Header: schema version, tool version, units and sources ========================================================

SCHEMA_VERSION = 1  #: Version of the time-series schema that this tool writes, and the newest that it reads.


def time_series_header(units: Mapping[str, str], *, sources: Mapping[str, str] | None = None, note: str = "") -> str:
    """Return the header of a time-series file as JSON.

    It has SI units by channel, SHA-256 digests by name of the files from which the series was made, and a note.
    """
    header = {
        "schema": "eightpost.time_series",
        "schema_version": SCHEMA_VERSION,
        "tool_version": __version__,
        "units": dict(units),
        "sources": dict(sources or {}),
        "note": note,
    }
    return json.dumps(header)


def parse_header(text: str | bytes, path: Path) -> dict[str, Any]:
    """Return the header of a file; refuse newer schema versions.

    Raises:
        FileFormatError: The text is not a header of eightpost, or has a newer schema version.
    """
    header = parse_json(text, path)
    version = header.get("schema_version") if isinstance(header, dict) else None
    units = header.get("units", {}) if isinstance(header, dict) else {}
    are_texts = isinstance(units, dict) and all(isinstance(unit, str) for unit in units.values())
    if type(version) is not int or not are_texts or type(header.get("note", "")) is not str:
        what = "its eightpost header cannot be read: it must have a schema_version, units by channel and a note"
        raise FileFormatError(what, path=path)
    check_schema(header, SCHEMA_VERSION, path, key="schema_version")
    return dict(header)


# ==== Tables: columns as arrays, and error messages that name the file ===============================================


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of equal length by name, in the order of a schema.

    Missing values are NaN in a column of numbers and "" in one of texts. Integers keep their type unless one is
    missing, other numbers are float64; all other types are objects.
    """

    schema: arrow.Schema  #: Names, types and metadata of the columns, and metadata of the file.
    columns: Mapping[str, NDArray[Any]]  #: Values (N,) of each column.

    @classmethod
    def of_rows(cls, rows: Sequence[Mapping[str, Any]], schema: arrow.Schema) -> Table:
        """Return rows, given by column name, as a table; a value that a row lacks is missing."""
        return cls(schema, {field.name: _values([row.get(field.name) for row in rows], field.type) for field in schema})

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self.columns[name]

    def take(self, rows: NDArray[Any]) -> Table:
        """Return some rows, given by their numbers (K,) or by a flag for each row (N,)."""
        return replace(self, columns={name: values[rows] for name, values in self.columns.items()})

    def rows(self) -> list[dict[str, Any]]:
        """Return each row by column name."""
        every = zip(*(values.tolist() for values in self.columns.values()), strict=True)
        return [dict(zip(self.columns, row, strict=True)) for row in every]

    def select(self, schema: arrow.Schema) -> Table:
        """Return the columns of a schema.

        Raises:
            ValueError: A column is missing or has another type.
        """
        for field in schema:
            if field.name not in self.columns:
                raise ValueError(f"the column {field.name!r} is missing")
            if self.schema.field(field.name).type != field.type:
                raise ValueError(f"the column {field.name!r} does not have the type {_name(field.type)}")
        return Table(schema, {name: self.columns[name] for name in schema.names})


def joined(tables: Iterable[Table], schema: arrow.Schema) -> Table:
    """Return the rows of tables with the same columns, one table below the other."""
    parts = [Table.of_rows([], schema), *tables]
    return Table(schema, {name: np.concatenate([part[name] for part in parts]) for name in schema.names})


def _name(kind: DataType) -> str:
    return str(kind).strip().rpartition("<")[2].rstrip(">").lower()


def _is_text(kind: DataType) -> bool:
    return DataType.is_string(kind) or DataType.is_large_string(kind) or DataType.is_string_view(kind)


def _values(cells: list[Any], kind: DataType) -> NDArray[Any]:
    if _is_text(kind):
        return np.array([sys.intern(cell or "") for cell in cells], dtype=object)
    if DataType.is_integer(kind) and None not in cells:
        return np.array(cells, dtype=np.int64)
    return np.array(cells, dtype=np.float64 if DataType.is_numeric(kind) else object)


def _vector(column: arrow.Array | arrow.ChunkedArray) -> NDArray[Any]:
    """Return a column as integers, floats or objects; see Table."""
    kind = column.type
    if column.null_count or not len(column) or not (DataType.is_integer(kind) or DataType.is_floating(kind)):
        return _values(column.to_pylist(), kind)
    return column.to_numpy().astype(np.float64) if DataType.is_floating(kind) else column.to_numpy()


def _array(values: NDArray[Any], kind: DataType) -> arrow.Array:
    """Return a column as an Arrow array; NaN is a missing value."""
    if not DataType.is_numeric(kind):
        return arrow.Array(values.tolist(), kind)
    if DataType.is_floating(kind) and np.isnan(values).any():
        cells = values.astype(object)
        cells[np.isnan(values)] = None
        return arrow.Array(cells.tolist(), kind)
    return arrow.Array.from_numpy(np.ascontiguousarray(values)).cast(kind)


def write_table(table: Table, path: Path) -> None:
    """Write a table; an existing file is replaced only after the new one is complete."""
    arrays = [_array(table[field.name], field.type) for field in table.schema]
    write_arrow(arrow.Table.from_arrays(arrays, schema=table.schema), path)


def write_arrow(table: arrow.Table, path: str | Path, **options: Any) -> None:
    """Write an Arrow table, with options of arro3.io.write_parquet; see write_table."""
    stated = table.schema.metadata_str or None  # also where programs look that ignore Arrow's own schema
    with atomic_path(path) as temporary:
        arro3.io.write_parquet(table, temporary, compression="zstd(1)", key_value_metadata=stated, **options)


#: Maximum number of cells in a table (2 GiB of numbers), or one for each byte of a larger file. A damaged or malicious
#: file may declare any number.
MOST_CELLS = 2**28

#: Number of rows that are read before the number of cells is checked.
_ROWS = 2**16

_MAGIC = b"PAR1"  #: First and last bytes of a Parquet file.


def read_table(path: str | Path, *, advice: str = "") -> Table:
    """Return a Parquet file's table with its metadata.

    Args:
        path: Path of the file.
        advice: Advice for the user if the file does not exist.

    Raises:
        FileFormatError: The file cannot be read, is not a Parquet file, or has too many cells.
    """
    path = Path(path)
    with _opened(path, advice) as reader:
        content = arrow.Table.from_batches(list(_batches(reader, path)), schema=reader.schema)
    columns = zip(content.column_names, content.columns, strict=True)
    return Table(content.schema, {name: _vector(column) for name, column in columns})


def read_metadata(path: str | Path) -> dict[bytes, bytes]:
    """Return the metadata of a Parquet file.

    Raises:
        FileFormatError: The file cannot be read, or is not a Parquet file.
    """
    with _opened(Path(path), "") as reader:
        return dict(reader.schema.metadata)


def _batches(reader: arrow.RecordBatchReader, path: Path) -> Iterator[arrow.RecordBatch]:
    rows, width, most = 0, len(reader.schema), max(MOST_CELLS, path.stat().st_size)
    while True:
        with _SILENCE, _silent(), supervision.reading(str(path)):  # a damaged page ends the process
            batch = next(reader, None)
        if batch is None:
            return
        yield batch
        rows += batch.num_rows
        if rows * width > most:
            what = f"it has over {most} cells in {width} columns; export a shorter record or fewer channels"
            raise FileFormatError(what, path=path)


@contextmanager
def _opened(path: Path, advice: str) -> Iterator[arrow.RecordBatchReader]:
    """Open a Parquet file; exceptions of arro3 in the block become an error that names the file."""
    with reading(path, advice=advice):
        try:
            content = path.open("rb")
            with content:
                begin, size = content.read(4), content.seek(0, 2)
                content.seek(max(0, size - 4))
                if size < 12 or begin != _MAGIC or content.read() != _MAGIC:
                    raise ValueError("it does not begin and end with PAR1")
                _check_footer(content, size)
            with _SILENCE, _silent():
                reader = arro3.io.read_parquet(path, batch_size=_ROWS)
            yield reader
        except (FileFormatError, OSError, MemoryError):
            raise
        except BaseException as error:  # arro3 panics if the end of a file is damaged
            is_panic = type(error).__name__ == "PanicException"
            if not isinstance(error, Exception) and not is_panic:
                raise
            cause = "the description of its columns is damaged" if is_panic else str(error).rstrip(".")
            what = f"not a readable Parquet file: {cause}; copy or write it again"
            raise FileFormatError(what, path=path) from error


_SILENCE = threading.Lock()


@contextmanager
def _silent() -> Iterator[None]:
    """Discard what arro3 prints on standard error: each panic, before it is an exception."""
    try:
        stderr = os.dup(2)
    except OSError:  # a process without standard error
        yield
        return
    with open(os.devnull, "wb") as sink:  # noqa: PTH123 - os.devnull is no path on every platform
        os.dup2(sink.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)


# ==== Places of columns that a footer states, checked before arro3 reads them: a wrong one ends the process ===========

# The footer is a struct in Thrift's compact protocol (parquet-format, FileMetaData): its fields have numbers and types.

#: A value of Thrift: a number, a text, a list, or the fields of a struct by number.
_Value = int | float | bytes | list["_Value"] | dict[int, "_Value"]

#: Fields of FileMetaData, RowGroup and ColumnChunk that lead to the columns; the name in SchemaElement; size and places
#: in ColumnMetaData.
_SCHEMA, _ROW_GROUPS, _COLUMNS, _META_DATA, _NAME = 2, 4, 1, 3, 4
_SIZE, _DATA, _INDEX, _DICTIONARY = 7, 9, 10, 11

#: Deepest nesting of a footer; a damaged one may have any.
_DEEPEST = 20


class _Thrift:
    """A reader of values in the compact protocol, from the start of some bytes."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at, self._depth = content, 0, 0
        self._read: Mapping[int, Callable[[], _Value]] = {
            1: lambda: 1, 2: lambda: 0, 3: self._byte, 4: self._integer, 5: self._integer, 6: self._integer,
            7: lambda: float(struct.unpack("<d", self._bytes(8))[0]), 8: lambda: self._bytes(self._varint()),
            9: self._list, 10: self._list, 12: self.fields,
        }  # fmt: skip

    def fields(self) -> dict[int, _Value]:
        """Return the fields of a struct."""
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError("nested too deeply")
        found: dict[int, _Value] = {}
        number = 0
        while head := self._byte():
            number = number + (head >> 4) if head >> 4 else self._integer()
            found[number] = self._read[head & 15]()
        self._depth -= 1
        return found

    def _list(self) -> list[_Value]:
        head = self._byte()
        count, kind = head >> 4, head & 15
        read = self._byte if kind in (1, 2) else self._read[kind]
        return [read() for _ in range(self._varint() if count == 15 else count)]

    def _byte(self) -> int:
        return self._bytes(1)[0]

    def _bytes(self, count: int) -> bytes:
        found = self._content[self._at : self._at + count]
        if len(found) < count:
            raise ValueError("it ends early")
        self._at += count
        return found

    def _varint(self) -> int:
        value, shift = 0, 0
        while (byte := self._byte()) >= 128:
            value, shift = value | (byte & 127) << shift, shift + 7
        return value | byte << shift

    def _integer(self) -> int:
        value = self._varint()
        return value >> 1 ^ -(value & 1)


def _check_footer(file: BinaryIO, size: int) -> None:
    """Check that the columns of a Parquet file, which ends after `size` bytes, are inside it.

    Raises:
        ValueError: They are not, or the footer cannot be read.
    """
    file.seek(size - 8)
    length = int.from_bytes(file.read(4), "little")
    try:
        file.seek(size - 8 - length)
        footer = _Thrift(file.read(length)).fields()
        names = [one.get(_NAME) for one in _listed(footer, _SCHEMA) if isinstance(one, dict)]
        if any(isinstance(name, bytes) and b"\0" in name for name in names):
            raise ValueError("the name of a column has a NUL")
        for group in _listed(footer, _ROW_GROUPS):
            for column in _listed(group, _COLUMNS):
                stated = column.get(_META_DATA, {}) if isinstance(column, dict) else {}
                if isinstance(stated, dict) and not _is_inside(stated, size):
                    raise ValueError("a column is outside the file")
    except (KeyError, OSError, ValueError) as error:
        raise ValueError("the description of its columns is damaged") from error


def _is_inside(column: Mapping[int, _Value], size: int) -> bool:
    length, *places = (column.get(number, 0) for number in (_SIZE, _DATA, _INDEX, _DICTIONARY))
    found = [at for at in (length, *places) if isinstance(at, int) and 0 <= at <= size]
    return len(found) == 1 + len(places) and min(filter(None, found[1:]), default=0) + found[0] <= size


def _listed(value: _Value, number: int) -> list[_Value]:
    found = value.get(number, []) if isinstance(value, dict) else []
    return found if isinstance(found, list) else []


# ---- Parquet files with units, schema version, tool version and sources in the schema's metadata --------------------

_KEY = b"eightpost"


def read_parquet(path: Path) -> tuple[RawRecord, ...]:
    """Read a Parquet file written by eightpost, or any other whose numeric columns are named like CSV headers.

    Raises:
        FileFormatError: The file is not a Parquet file, or has a newer schema version.
    """
    with tempfile.SpooledTemporaryFile(IN_MEMORY) as file, _opened(path, "") as reader:
        stated = _header(reader.schema.metadata, path).get("units", {})
        split = [
            (field.name, "s") if DataType.is_duration(field.type) else named_with_unit(field.name, stated)
            for field in reader.schema
        ]
        blocks = Blocks(len(split), file)
        for batch in _batches(reader, path):
            blocks.add(map(samples_of, batch.columns))
        columns = blocks.columns()
    names, units = zip(*split, strict=True) if split else ((), ())
    return (RawRecord(Origin(path), names, units, columns),)


def parquet_header(path: str | Path) -> dict[str, Any]:
    """Return eightpost's header of a Parquet file (tool version, sources, note); empty for files of other programs.

    Raises:
        FileFormatError: The file is not a Parquet file, or has a newer schema version.
    """
    return _header(read_metadata(path), Path(path))


def _header(metadata: Mapping[bytes, bytes], path: Path) -> dict[str, Any]:
    return parse_header(metadata[_KEY], path) if _KEY in metadata else {}


def samples_of(column: arrow.Array) -> NDArray[Any]:
    """Return a column as numbers with NaN for missing ones, or as objects if it is not numeric."""
    if DataType.is_duration(column.type):
        return _vector(column.cast(DataType.duration("ns")).cast(DataType.int64())) * 1e-9
    if DataType.is_floating(column.type) and not column.null_count:
        return column.to_numpy()
    if DataType.is_numeric(column.type):
        return _vector(column).astype(np.float64)
    return np.array([str(cell) for cell in column.to_pylist()], dtype=object)


def write_parquet(
    series: TimeSeries,
    path: str | Path,
    *,
    sources: Mapping[str, str] | None = None,
    note: str = "",
    storage: Literal["float64", "float32"] = "float64",
) -> None:
    """Write a series as Parquet.

    Args:
        series: Series to write.
        path: Path of the file, which is replaced atomically.
        sources: SHA-256 digests by name of the files from which the series was made.
        note: Description of the data for the user.
        storage: Number type of the channels; time is always float64.
    """
    units = {"time": "s", **dict(zip(series.names, series.units, strict=True))}
    vectors = [series.time, *(row.astype(storage) for row in series.values)]
    arrays = [arrow.Array.from_numpy(np.ascontiguousarray(vector)) for vector in vectors]
    header = {_KEY: time_series_header(units, sources=sources, note=note).encode()}
    table = arrow.Table.from_arrays(arrays, names=list(units), metadata=header)
    write_arrow(table, path, dictionary_enabled=False, encoding="byte_stream_split")
