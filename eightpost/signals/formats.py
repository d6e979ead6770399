"""Reading and writing of records in all formats; the suffix of the file name determines the format."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from eightpost.errors import FileFormatError
from eightpost.files import reading, sha256_of
from eightpost.signals.confined_files import read_mdf, read_spreadsheet, read_tdms
from eightpost.signals.csv_file import read_delimited, write_csv
from eightpost.signals.logger_files import read_ld, read_rpc, read_vbo, read_xrk, write_rpc
from eightpost.signals.lvm_file import read_lvm
from eightpost.signals.mat_file import read_json, read_mat, read_script, write_mat
from eightpost.signals.parquet_file import read_parquet, write_parquet
from eightpost.signals.raw_record import RawRecord, find_time, identity_map, mapped_series
from eightpost.units import note_file

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eightpost.signals.raw_record import ChannelMap
    from eightpost.signals.timeseries import TimeSeries

# ---- Reading --------------------------------------------------------------------------------------------------------

#: Reader of the tables of a file, by its suffix.
_READERS: dict[str, Callable[[Path], tuple[RawRecord, ...]]] = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat"), read_delimited),
    **dict.fromkeys((".xlsx", ".xlsm", ".xls", ".ods"), read_spreadsheet),
    ".parquet": read_parquet, ".mat": read_mat, ".m": read_script, ".json": read_json, ".tdms": read_tdms,
    ".lvm": read_lvm, ".mf4": read_mdf, ".mdf": read_mdf, ".pvp": read_delimited,
    **dict.fromkeys((".rsp", ".drv", ".tim", ".rpc"), read_rpc), ".ld": read_ld, ".vbo": read_vbo,
    ".xrk": read_xrk, ".xrz": read_xrk,
}  # fmt: skip
#: First bytes of files of programs that do not document their layout, and the program. A text file .pvp is read.
_CLOSED = {".dctw": (b"", "CTW Probe"), ".pvp": (b"\xd0\xcf\x11\xe0", "the Shock program of Roehrig and MTS")}
#: Largest file whose tables are kept [bytes].
_KEPT = 2**24
#: Suffixes of files that can be read.
SUFFIXES = tuple(_READERS)


def read_record(path: str | Path) -> RawRecord:
    """Read the columns of a file with one table, without conversion.

    Args:
        path: Path of a file in one of the formats of docs/reference/dyno_files.md.

    Raises:
        FileFormatError: The file is missing, its format is unknown, it cannot be read, or it has several tables.
    """
    first, *others = records = read_records(path)
    if others:
        line = others[0].origin.header_line
        lengths = "; ".join(f"{', '.join(each.names[:8])}: {each.columns[0].size} rows" for each in records[:4])
        what = f"the file has {len(records)} tables, but one is needed ({lengths}); export all channels with one time"
        raise FileFormatError(what, path=path, line=line)
    return first


def read_records(path: str | Path) -> tuple[RawRecord, ...]:
    """Read all tables of a file without conversion; text, spreadsheets, LabVIEW, MDF and .mat may have several.

    Args:
        path: Path of a file in one of the formats of docs/reference/dyno_files.md.

    Raises:
        FileFormatError: The file is missing, its format is unknown, or it cannot be read.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if path.is_dir():
        raise FileFormatError("is a folder, not a file; name the files in it", path=path)
    if suffix not in (*_READERS, *_CLOSED):
        what = f"files with the suffix {path.suffix!r} cannot be read as records; supported: {', '.join(SUFFIXES)}"
        raise FileFormatError(what, path=path)
    size = _size_of(path)
    if suffix in _CLOSED and (beginning := _CLOSED[suffix])[0] == path.read_bytes()[: len(beginning[0])]:
        what = f"is a file of {beginning[1]}, whose layout is not documented: export time, displacement or velocity, "
        raise FileFormatError(f"{what}and force there as .csv, and read that file", path=path)
    records = _read_once(path, sha256_of(path)) if size <= _KEPT else _READERS[suffix](path)
    if suffix != ".parquet":  # those of this project are in SI units for every user
        note_file(records[0].units)
    return records


@lru_cache(maxsize=1)
def _read_once(path: Path, _digest: str) -> tuple[RawRecord, ...]:
    """Read a file, of which one verb asks twice: is it a table of peak velocities, or a record."""
    return _READERS[path.suffix.lower()](path)


def _size_of(path: Path) -> int:
    with reading(path):
        size = path.stat().st_size
    if size == 0:
        raise FileFormatError("is empty: it has 0 bytes; copy or export it again", path=path)
    return size


def read_series(
    path: str | Path, *, channel_map: ChannelMap | None = None, units: Mapping[str, str] | None = None
) -> TimeSeries:
    """Read a file with one table as a time series in SI.

    Without a channel map, every column is a channel with the name of the column (without the unit), and the column
    `time`, or with another usual name of it (`TIME_NAMES`), is the time.

    Args:
        path: Path of a file in one of the formats of docs/reference/dyno_files.md.
        channel_map: Columns to read, with channel names, units and signs.
        units: Units by channel name, for columns without a unit in the header.

    Raises:
        FileFormatError: The file cannot be read.
        DataError: The record has a fault; the subclass and the message say which fault and where.
    """
    record = read_record(path).bridged(channel_map.bridge if channel_map else 0)
    if channel_map is None:
        channel_map = identity_map(record, find_time(record))
    return mapped_series(record, channel_map, units=units)


# ---- Writing --------------------------------------------------------------------------------------------------------

_WRITERS: dict[str, Callable[[TimeSeries, Path], None]] = {
    ".csv": write_csv,
    ".txt": write_csv,
    ".parquet": write_parquet,
    ".mat": write_mat,
    **dict.fromkeys((".rsp", ".drv", ".tim", ".rpc"), write_rpc),
}


def write_series(series: TimeSeries, path: str | Path) -> None:
    """Write a series in SI as .csv, .txt, .parquet or .mat with full precision, or for a rig as .drv, .rsp or .tim.

    The file is replaced atomically. `write_csv`, `write_parquet`, `write_mat` and `write_rpc` have more options.

    Raises:
        FileFormatError: The suffix is unknown, or the file cannot be written.
    """
    path = Path(path)
    writer = _WRITERS.get(path.suffix.lower())
    if writer is None:
        raise FileFormatError(
            f"files with the suffix {path.suffix!r} cannot be written; supported: {', '.join(_WRITERS)}", path=path
        )
    writer(series, path)
