"""Parquet files of signals, and the header of all files that eightpost writes."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from eightpost import __version__
from eightpost.errors import FileFormatError
from eightpost.files import MALFORMED, atomic_path, check_schema, parse_json, reading
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import RawRecord
from eightpost.signals.table_text import named_with_unit

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


# ==== Tables: numeric columns between numpy and Arrow, and error messages that name the file =========================


def to_arrow(values: NDArray[Any]) -> pa.Array:
    """Return numbers as an Arrow array that shares their memory if they are contiguous."""
    values = np.ascontiguousarray(values)
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), values.size, [None, pa.py_buffer(values)])


def to_numpy(column: pa.ChunkedArray) -> NDArray[np.float64]:
    """Return a column of numbers as floats, with NaN for missing values."""
    if column.null_count or not column.num_chunks:
        return np.asarray(column.to_numpy(), dtype=np.float64)
    return np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks], dtype=np.float64)


#: Maximum number of cells in a table (2 GiB of numbers). A damaged or malicious file may declare any number.
MOST_CELLS = 2**28


def read_table(path: str | Path, *, schema: pa.Schema | None = None, advice: str = "") -> pa.Table:
    """Return a Parquet file's table with its metadata.

    Args:
        path: Path of the file.
        schema: Required columns, by name and type; None to accept any columns.
        advice: Advice for the user if the file does not exist.

    Raises:
        FileFormatError: The file cannot be read, is not a Parquet file, has other columns or too many cells.
    """
    path = Path(path)
    with _refusing(path, advice), pa.parquet.ParquetFile(path) as file:
        _check_size(path, file.metadata)
        table = file.read(use_threads=False)
        table.validate(full=True)
        if schema is not None:
            table = table.select(schema.names).cast(schema.with_metadata(table.schema.metadata))
    return table


def read_columns(path: str | Path, names: Sequence[str] | None) -> pa.Table:
    """Return some columns of a Parquet file as a table; None for all of them.

    Raises:
        FileFormatError: The file cannot be read, is not a Parquet file, or lacks a column.
    """
    path = Path(path)
    with _refusing(path, ""):
        table = pa.parquet.read_table(path, columns=names, use_threads=False, partitioning=None)
        table.validate(full=True)
        if names is not None and (missing := set(names) - set(table.column_names)):
            raise FileFormatError(f"has no column {min(missing)!r}", path=path)
    return table


def parquet_size(path: str | Path, *, advice: str = "") -> tuple[pa.Schema, int]:
    """Return the schema of a Parquet file with its metadata, and its number of rows.

    Raises:
        FileFormatError: The file cannot be read, is not a Parquet file, or has too many cells.
    """
    path = Path(path)
    with _refusing(path, advice), pa.parquet.ParquetFile(path) as file:
        _check_size(path, file.metadata)
        return file.schema_arrow, int(file.metadata.num_rows)


def _check_size(path: Path, metadata: pa.parquet.FileMetaData) -> None:
    cells = metadata.num_rows * metadata.num_columns
    if not 0 <= cells <= MOST_CELLS:
        declared = f"{metadata.num_rows} rows of {metadata.num_columns} columns; the limit is {MOST_CELLS} cells"
        raise FileFormatError(f"it declares {declared}; export a shorter record or fewer channels", path=path)


@contextmanager
def _refusing(path: Path, advice: str) -> Iterator[None]:
    """Turn all exceptions of pyarrow into an error that names the file."""
    with reading(path, advice=advice):
        try:
            yield
        except FileFormatError:
            raise
        except (pa.ArrowException, *MALFORMED) as error:
            what = f"not a readable Parquet file: {str(error).rstrip('.')}; copy or write it again"
            raise FileFormatError(what, path=path) from error


# ---- Parquet files with units, schema version, tool version and sources in the schema's metadata --------------------

_KEY = b"eightpost"


def read_parquet(path: Path) -> tuple[RawRecord, ...]:
    """Read a Parquet file written by eightpost, or any other whose numeric columns are named like CSV headers.

    Raises:
        FileFormatError: The file is not a Parquet file, or has a newer schema version.
    """
    table = read_table(path)
    stated = _header(table.schema, path).get("units", {})
    split = [
        (name, "s") if pa.types.is_duration(column.type) else named_with_unit(name, stated)
        for name, column in zip(table.column_names, table.columns, strict=True)
    ]
    names, units = zip(*split, strict=True) if split else ((), ())
    return (RawRecord(Origin(path), names, units, tuple(_vector(column) for column in table.columns)),)


def parquet_header(path: str | Path) -> dict[str, Any]:
    """Return eightpost's header of a Parquet file (tool version, sources, note); empty for files of other programs.

    Raises:
        FileFormatError: The file is not a Parquet file, or has a newer schema version.
    """
    path = Path(path)
    with _refusing(path, ""):
        schema = pa.parquet.read_schema(path)
    return _header(schema, path)


def _header(schema: pa.Schema, path: Path) -> dict[str, Any]:
    metadata = dict(schema.metadata or {})
    return parse_header(metadata[_KEY], path) if _KEY in metadata else {}


def _vector(column: Any) -> NDArray[Any]:
    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        return to_numpy(column)
    if pa.types.is_duration(column.type):
        return to_numpy(column.cast(pa.duration("ns")).cast(pa.int64())) * 1e-9
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
    columns = [to_arrow(series.time), *(to_arrow(row.astype(storage)) for row in series.values)]
    table = pa.table(columns, names=list(units))
    table = table.replace_schema_metadata({_KEY: time_series_header(units, sources=sources, note=note)})
    with atomic_path(path) as temporary:
        pa.parquet.write_table(table, temporary, compression="zstd", use_dictionary=False, use_byte_stream_split=True)
