"""Reading of Parquet files as tables, with error messages that name the file."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet

from eightpost.errors import FileFormatError
from eightpost.files import MALFORMED, reading

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


def read_metadata(path: str | Path) -> dict[bytes, bytes]:
    """Return the metadata of a Parquet file's schema.

    Raises:
        FileFormatError: The file cannot be read, or is not a Parquet file.
    """
    path = Path(path)
    with _refusing(path, ""):
        return dict(pa.parquet.read_schema(path).metadata or {})


def _check_size(path: Path, metadata: pa.parquet.FileMetaData) -> None:
    cells = metadata.num_rows * metadata.num_columns
    if not 0 <= cells <= MOST_CELLS:
        what = (
            f"it declares {metadata.num_rows} rows of {metadata.num_columns} columns; the limit is {MOST_CELLS} cells"
        )
        raise FileFormatError(f"{what}; export a shorter record or fewer channels", path=path)


@contextmanager
def _refusing(path: Path, advice: str) -> Iterator[None]:
    """Turn all exceptions of pyarrow into an error that names the file."""
    with reading(path, advice=advice):
        try:
            yield
        except FileFormatError:
            raise
        except (pa.ArrowException, *MALFORMED) as error:
            raise FileFormatError(f"not a readable Parquet file: {error}", path=path) from error
