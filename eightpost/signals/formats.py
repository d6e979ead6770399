"""Reading and writing of records in all formats; the suffix of the file name determines the format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from eightpost.errors import FileFormatError
from eightpost.files import reading
from eightpost.signals.csv_file import read_csv, read_csv_blocks, write_csv
from eightpost.signals.mat_file import read_mat, write_mat
from eightpost.signals.mdf_file import read_mdf
from eightpost.signals.parquet_file import read_parquet, write_parquet
from eightpost.signals.raw_record import find_time, identity_map, mapped_series

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from eightpost.signals.channel_map import ChannelMap
    from eightpost.signals.raw_record import RawRecord
    from eightpost.signals.timeseries import TimeSeries

# ---- Reading --------------------------------------------------------------------------------------------------------

_READERS = {
    ".csv": read_csv, ".txt": read_csv, ".tsv": read_csv, ".parquet": read_parquet, ".mat": read_mat, ".mf4": read_mdf,
    ".mdf": read_mdf,
}  # fmt: skip
_TEXT = (".csv", ".txt", ".tsv")


def read_record(path: str | Path) -> RawRecord:
    """Read a file's columns without conversion.

    Raises:
        FileFormatError: The file is missing or its format is unknown.
    """
    path = Path(path)
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        what = f"files with the suffix {path.suffix!r} cannot be read; supported: {', '.join(_READERS)}"
        raise FileFormatError(what, path=path)
    with reading(path):
        path.stat()
    if not path.is_file():
        raise FileFormatError("is a folder, not a file", path=path)
    return reader(path)


def read_records(path: str | Path) -> tuple[RawRecord, ...]:
    """Read all tables of a text file without conversion; files in other formats have one table.

    Raises:
        FileFormatError: The file is missing or its format is unknown.
    """
    path = Path(path)
    return read_csv_blocks(path) if path.suffix.lower() in _TEXT and path.is_file() else (read_record(path),)


def read_series(
    path: str | Path, *, channel_map: ChannelMap | None = None, units: Mapping[str, str] | None = None
) -> TimeSeries:
    """Read a .csv, .txt, .parquet, .mat or .mf4 file as a time series in SI.

    Without a channel map, every column is a channel with the name of the column (without the unit), and the column
    `time` or `t` is the time.

    Args:
        path: Path of the file.
        channel_map: Columns to read, with channel names, units and signs.
        units: Units by channel name, for columns without a unit in the header.

    Raises:
        FileFormatError: The file cannot be read.
        DataError: The record has a fault; the subclass and the message say which fault and where.
    """
    record = read_record(path)
    if channel_map is None:
        channel_map = identity_map(record, find_time(record))
    return mapped_series(record, channel_map, units=units)


# ---- Writing --------------------------------------------------------------------------------------------------------

_WRITERS: dict[str, Callable[[TimeSeries, Path], None]] = {
    ".csv": write_csv,
    ".txt": write_csv,
    ".parquet": write_parquet,
    ".mat": write_mat,
}


def write_series(series: TimeSeries, path: str | Path) -> None:
    """Write a series in SI as .csv, .txt, .parquet or .mat, with full precision.

    The file is replaced atomically. `write_csv`, `write_parquet` and `write_mat` have more options.

    Raises:
        FileFormatError: The suffix is unknown.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise FileFormatError(
            f"files with the suffix {path.suffix!r} cannot be written; supported: {', '.join(_WRITERS)}", path=path
        )
    writer(series, path)
