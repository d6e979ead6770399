"""Table of a study in a Parquet file: written row group by row group, read column by column."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from eightpost.errors import FileFormatError, InputError
from eightpost.files import atomic_path
from eightpost.signals.parquet_file import parquet_size, read_columns, read_table

#: Largest size of a table that is read into memory as a whole [bytes]; larger ones are read column by column.
IN_MEMORY = 32 * 2**20

#: Size of a cell of a table in memory [bytes].
_CELL = 8


@dataclass(frozen=True, slots=True)
class StoredTable:
    """Table in a Parquet file, of which each column is read when it is asked for.

    It has those attributes of a pyarrow.Table that the study uses.
    """

    path: Path  #: Path of the file.
    schema: pa.Schema  #: Columns, and metadata of the file.
    num_rows: int  #: Number of rows.
    #: Size of the file [bytes] and time of its last change [ns], by which a replaced file is noticed.
    size: tuple[int, int]

    @property
    def column_names(self) -> list[str]:
        """Names of the columns."""
        names: list[str] = self.schema.names
        return names

    def __getitem__(self, name: str) -> pa.ChunkedArray:
        """Read a column.

        Raises:
            FileFormatError: The file was replaced or removed since it was opened, or is damaged.
            KeyError: There is no such column.
        """
        if name not in self.schema.names:
            raise KeyError(name)
        return self._read([name])[name]

    def take(self, rows: object) -> pa.Table:
        """Return some rows of all columns."""
        return self.read().take(rows)

    def read(self) -> pa.Table:
        """Return the whole table."""
        return self._read(None)

    def _read(self, names: list[str] | None) -> pa.Table:
        if not self.path.is_file() or _identity(self.path) != self.size:
            raise FileFormatError("was replaced or removed while it was used; run the command again", path=self.path)
        return read_columns(self.path, names)


def open_table(path: Path, *, advice: str = "name the results.parquet of a study") -> pa.Table | StoredTable:
    """Return a table with its metadata: in memory if it is small, else column by column.

    Args:
        path: Path of the file.
        advice: Advice for the user if the file does not exist.

    Raises:
        FileFormatError: The file does not exist, or is not a Parquet file.
    """
    size = _identity(path) if path.is_file() else (0, 0)
    schema, rows = parquet_size(path, advice=advice)
    if rows * len(schema) * _CELL <= IN_MEMORY:
        return read_table(path, advice=advice)
    return StoredTable(path, schema, rows, size)


def write_tables(path: Path, schema: pa.Schema, tables: Iterable[pa.Table]) -> None:
    """Write tables as row groups of one file, one after the other; an existing file is replaced when it is complete.

    Args:
        path: Path of the file.
        schema: Columns, and metadata of the file.
        tables: Tables in the order of their setups.

    Raises:
        InputError: Two rows have the same setup number, or the setups are not in order.
    """
    last = -1
    with (
        atomic_path(path) as temporary,
        pyarrow.parquet.ParquetWriter(temporary, schema, compression="zstd") as writer,
    ):
        for table in tables:
            numbers = np.concatenate([[last], table["setup"].to_numpy()])
            if np.any(np.diff(numbers) <= 0):
                raise InputError(f"{path}: two rows have the same setup number, or they are not in order")
            last = int(numbers[-1])
            writer.write_table(table.replace_schema_metadata(schema.metadata))


def _identity(path: Path) -> tuple[int, int]:
    found = path.stat()
    return found.st_size, found.st_mtime_ns
