"""Parquet files with units, schema version, tool version and sources in the schema's metadata."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from eightpost.files import atomic_path
from eightpost.signals.arrow_columns import to_arrow, to_numpy
from eightpost.signals.header import split_header
from eightpost.signals.origin import Origin
from eightpost.signals.parquet_table import read_metadata, read_table
from eightpost.signals.provenance import parse_header, time_series_header
from eightpost.signals.raw_record import RawRecord

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries

_KEY = b"eightpost"


def read_parquet(path: str | Path) -> RawRecord:
    """Read a Parquet file written by eightpost, or any other whose numeric columns are named like CSV headers.

    Raises:
        FileFormatError: The file is not a Parquet file, or has a newer schema version.
    """
    path = Path(path)
    table = read_table(path)
    header = _header(dict(table.schema.metadata or {}), path)
    split = [_named(name, header) for name in table.column_names]
    names, units = tuple(name for name, _ in split), tuple(unit for _, unit in split)
    return RawRecord(Origin(path), names, units, tuple(_vector(column) for column in table.columns))


def parquet_header(path: str | Path) -> dict[str, Any]:
    """Return eightpost's header of a Parquet file (tool version, sources, note); empty for files of other programs.

    Raises:
        FileFormatError: The file is not a Parquet file, or has a newer schema version.
    """
    return _header(read_metadata(path), Path(path))


def _header(metadata: Mapping[bytes, bytes], path: Path) -> dict[str, Any]:
    return parse_header(metadata[_KEY], path) if _KEY in metadata else {}


def _named(name: str, header: Mapping[str, Any]) -> tuple[str, str | None]:
    units = header.get("units", {})
    return (name, units[name]) if name in units else split_header(name)


def _vector(column: Any) -> NDArray[Any]:
    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type):
        return to_numpy(column)
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
