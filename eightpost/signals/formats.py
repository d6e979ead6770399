"""Reading and writing of records in all formats; the suffix of the file name determines the format."""

from __future__ import annotations

import datetime
import html
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.array_types import Array, Stored
from eightpost.confined import read_confined
from eightpost.confined.readers import Signal
from eightpost.errors import FileFormatError
from eightpost.extras import is_installed, requirement
from eightpost.files import reading, sha256_of
from eightpost.signals.csv_file import read_delimited, text_records, write_csv
from eightpost.signals.faults import Origin
from eightpost.signals.logger_files import mapped, read_ld, read_rpc, read_vbo, read_xrk, write_rpc
from eightpost.signals.lvm_file import read_lvm
from eightpost.signals.mat_file import read_json, read_mat, read_script, write_mat
from eightpost.signals.parquet_file import read_parquet, write_parquet
from eightpost.signals.raw_record import (
    IN_MEMORY,
    TIME_NAMES,
    RawRecord,
    find_time,
    identity_map,
    mapped_series,
    tables_of,
)
from eightpost.signals.table_text import split_header
from eightpost.units import note_file

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eightpost.confined.readers import Sheet, Table, Written
    from eightpost.signals.raw_record import ChannelMap
    from eightpost.signals.timeseries import TimeSeries

# ---- Spreadsheets (.xlsx, .xls, .ods), read with python-calamine: every sheet with a table --------------------------

#: The library rounds dates and times of day to 1 ms. If that makes more than this share of the steps uneven, and they
#: are below this many seconds, the rounding changes a velocity by several percent.
_UNEVEN, _SHORT = 0.1, 0.02

_Clock = datetime.datetime | datetime.time | datetime.timedelta


def _read_spreadsheet(path: Path) -> tuple[RawRecord, ...]:
    """Read the tables of all sheets; line numbers in messages are row numbers of the sheet.

    Hidden sheets are read only if no other sheet has a table; a note names those that were left out.

    Raises:
        FileFormatError: python-calamine is not installed, the file cannot be read, no sheet has a table, or a column of
            dates or times of day is sampled too fast for a resolution of 1 ms.
    """
    if not is_installed("python_calamine"):
        raise FileFormatError(requirement("reading spreadsheets", "python_calamine", "files"), path=path)
    sheets: list[Sheet] = read_confined("eightpost.confined.readers:load_spreadsheet", path, kind="a spreadsheet")
    hidden = [sheet for sheet in sheets if sheet.is_hidden]
    records, faults = _tables([sheet for sheet in sheets if not sheet.is_hidden], path)
    if records:
        left_out = tuple(
            f"the sheet {sheet.name!r} is hidden and was not read" for sheet in hidden if _has_table(sheet, path)
        )
        return tuple(replace(record, notes=(*record.notes, *left_out)) for record in records)
    records, more = _tables(hidden, path)
    if not records:
        sheet_names = ", ".join(repr(sheet.name) for sheet in sheets)
        empty = FileFormatError(f"the sheets {sheet_names} are empty", path=path)
        raise next(iter((*faults, *more)), empty)
    return tuple(records)


def _tables(sheets: Sequence[Sheet], path: Path) -> tuple[list[RawRecord], list[FileFormatError]]:
    """Return the tables of sheets, and the errors of the sheets without one."""
    records: list[RawRecord] = []
    faults: list[FileFormatError] = []
    for sheet in sheets:
        _check_clocks(sheet.rows, sheet.name, path)
        try:
            records += text_records(["\t".join(map(_text, row)) for row in sheet.rows], path)
        except FileFormatError as error:
            faults.append(error)
    return records, faults


def _has_table(sheet: Sheet, path: Path) -> bool:
    try:
        return bool(_tables([sheet], path)[0])
    except FileFormatError:  # a table with a fault
        return True


def _check_clocks(rows: Sequence[Sequence[Any]], sheet: str, path: Path) -> None:
    """Check that dates and times of day of a sheet are not coarser than its samples."""
    for number in range(max(map(len, rows), default=0)):
        cells = (row[number] for row in rows if number < len(row))
        seconds = [_seconds(cell) for cell in cells if isinstance(cell, _Clock)]
        steps = [later - earlier for earlier, later in pairwise(seconds)]
        if not steps or not 0.0 < (step := median(steps)) < _SHORT:
            continue
        if sum(abs(one - step) > 1e-4 for one in steps) > _UNEVEN * len(steps):
            raise FileFormatError(
                f"sheet {sheet!r}, column {number + 1}: its dates or times of day are read to 1 ms, too coarse for "
                f"samples every {1e3 * step:.2g} ms or so; write elapsed seconds as numbers, or export the record as "
                "text",
                path=path,
            )


def _seconds(cell: _Clock) -> float:
    """Return the seconds since midnight, or of an elapsed time."""
    if isinstance(cell, datetime.timedelta):
        return cell.total_seconds()
    return 3600.0 * cell.hour + 60.0 * cell.minute + cell.second + 1e-6 * cell.microsecond


def _text(cell: Any) -> str:
    """Return a cell as text that the text reader reads to the same value."""
    if isinstance(cell, bool):
        return str(cell)
    if isinstance(cell, (int, float)):
        return repr(cell)
    if isinstance(cell, datetime.timedelta) and cell.total_seconds() >= 0.0:
        minutes, seconds = divmod(cell.total_seconds(), 60.0)
        return f"{minutes // 60.0:.0f}:{minutes % 60.0:02.0f}:{seconds:09.6f}"
    if isinstance(cell, (datetime.datetime, datetime.time)):
        return cell.isoformat()
    return " ".join(str(cell).split())


# ---- LabVIEW measurements in .tdms files, read with npTDMS ----------------------------------------------------------


def _read_tdms(path: Path) -> tuple[RawRecord, ...]:
    """Read a .tdms file: one table per group; without a column of time, a waveform's increment gives the time [s].

    Groups of single values become the preamble of the other tables. A channel with another increment or start than the
    others is left out with a note.

    Raises:
        FileFormatError: npTDMS is not installed, or the file cannot be read or has no channel of numbers.
    """
    if not is_installed("nptdms"):
        raise FileFormatError(requirement("reading TDMS files", "nptdms", "files"), path=path)
    tables: list[Table] = read_confined("eightpost.confined.readers:load_tdms", path, kind="a TDMS file")
    tables = [table for table in tables if table.columns]
    if not tables:
        raise FileFormatError("it contains no channel of numbers", path=path)
    settings = [table for table in tables if all(len(column) == 1 for _, _, column in table.columns)]
    facts = tuple(f"{name}: {float(column[0]):.9g} {unit}".strip()
                  for table in settings for name, unit, column in table.columns)  # fmt: skip
    samples = [table for table in tables if not any(table is one for one in settings)] or tables
    return tuple(_record(table._replace(preamble=(*table.preamble, *facts)), path) for table in samples)


def _record(table: Table, path: Path) -> RawRecord:
    """Return a table with a time column; only columns as long as the time are kept."""
    names, units, columns = [], [], []
    for name, unit, column in table.columns:
        plain, stated = (name, unit) if unit else split_header(name)
        names.append(plain)
        units.append(stated or None)
        columns.append(np.asarray(column, dtype=np.float64))
    if not {name.lower() for name in names} & set(TIME_NAMES) and table.step:
        names, units = ["time", *names], ["s", *units]
        columns = [np.asarray(table.start + table.step * np.arange(columns[0].size), dtype=np.float64), *columns]
    times = [i for i, name in enumerate(names) if name.lower() in TIME_NAMES] or [0]
    size = columns[times[0]].size
    others = [*table.others]
    others += [(name, f"it has {column.size} samples, and the time has {size}")
               for name, column in zip(names, columns, strict=True) if column.size != size]  # fmt: skip
    notes = tuple(f"the channel {name!r} was left out: {why}" for name, why in others)
    kept = [i for i, column in enumerate(columns) if column.size == size and names[i] not in dict(table.others)]
    names, units, columns = [names[i] for i in kept], [units[i] for i in kept], [columns[i] for i in kept]
    preamble = tuple((line,) for line in table.preamble)
    return RawRecord(Origin(path), tuple(names), tuple(units), tuple(columns), preamble, notes)


def _read_mdf(path: Path) -> tuple[RawRecord, ...]:
    """Read the numeric channels of an MDF file: one table per time axis, which becomes its column `time` [s].

    Channel groups with the same sample times make one table. Tables with many channels come first, then long ones.
    Temperatures change slowly, so the first table has those of the other tables too, interpolated. The comment in the
    file's header becomes the preamble of each table.

    Raises:
        FileFormatError: asammdf is not installed or cannot read the file, or there is no numeric channel.
    """
    if not is_installed("asammdf"):
        raise FileFormatError(requirement("reading MDF files", "asammdf", "mdf"), path=path)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        target, kind = Path(folder, "samples"), "an MDF file that asammdf reads"
        found, comment = read_confined("eightpost.confined.readers:load_mdf", path, target, kind=kind)
        content = mapped(target) if any(one.size for one in found) else b""

    def samples(one: Written) -> Array:
        return np.frombuffer(content, one.kind, one.size, one.place).astype(np.float64)

    channels: list[Written] = [one for one in found if one.name.lower() != "time"]
    if not channels:
        raise FileFormatError("it contains no numeric channel", path=path)
    for one in channels:
        if one.size != one.times.size:
            what = f"it has {one.size} samples and {one.times.size} times: the file is damaged"
            raise FileFormatError(what, path=path, channel=one.name)
    signals = [Signal(one.name, one.unit, Stored(one.size, partial(samples, one)), one.times) for one in channels]
    text = re.search(r"<TX>(.*?)</TX>", comment, flags=re.DOTALL)  # MDF 4 may wrap the comment in XML
    lines = html.unescape(text[1] if text else comment).splitlines()
    return tables_of(signals, path, tuple((line.strip(),) for line in lines if line.strip()))


# ---- Reading --------------------------------------------------------------------------------------------------------

#: Reader of the tables of a file, by its suffix.
_READERS: dict[str, Callable[[Path], tuple[RawRecord, ...]]] = {
    **dict.fromkeys((".csv", ".txt", ".tsv", ".dat"), read_delimited),
    **dict.fromkeys((".xlsx", ".xlsm", ".xls", ".ods"), _read_spreadsheet),
    ".parquet": read_parquet, ".mat": read_mat, ".m": read_script, ".json": read_json, ".tdms": _read_tdms,
    ".lvm": read_lvm, ".mf4": _read_mdf, ".mdf": _read_mdf, ".pvp": read_delimited,
    **dict.fromkeys((".rsp", ".drv", ".tim", ".rpc"), read_rpc), ".ld": read_ld, ".vbo": read_vbo,
    ".xrk": read_xrk, ".xrz": read_xrk,
}  # fmt: skip
#: First bytes of files of programs that do not document their layout, and the program. A text file .pvp is read.
_CLOSED = {".dctw": (b"", "CTW Probe"), ".pvp": (b"\xd0\xcf\x11\xe0", "the Shock program of Roehrig and MTS")}
SUFFIXES = tuple(_READERS)  #: Suffixes of files that can be read.


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
    with reading(path):  # a name that is too long is an error of the system
        is_folder = path.is_dir()
    if is_folder:
        raise FileFormatError("is a folder, not a file; name the files in it", path=path)
    if suffix not in (*_READERS, *_CLOSED):
        what = f"files with the suffix {path.suffix!r} cannot be read as records; supported: {', '.join(SUFFIXES)}"
        raise FileFormatError(what, path=path)
    with reading(path):
        size = path.stat().st_size
    if size == 0:
        raise FileFormatError("is empty: it has 0 bytes; copy or export it again", path=path)
    if suffix in _CLOSED and (beginning := _CLOSED[suffix])[0] == path.read_bytes()[: len(beginning[0])]:
        what = f"is a file of {beginning[1]}, whose layout is not documented: export time, displacement or velocity, "
        raise FileFormatError(f"{what}and force there as .csv, and read that file", path=path)
    records = _read_once(path, sha256_of(path))
    if size > IN_MEMORY and not any(isinstance(column, Stored) for column in records[0].columns):
        _read_once.cache_clear()
    if suffix != ".parquet":  # those of this project are in SI units for every user
        note_file(records[0].units)
    return records


@lru_cache(maxsize=1)
def _read_once(path: Path, _digest: str) -> tuple[RawRecord, ...]:
    """Read a file, of which one verb asks twice: is it a table of peak velocities, or a record."""
    records = _READERS[path.suffix.lower()](path)
    return records if path.stat().st_size > IN_MEMORY else tuple(record.loaded() for record in records)


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
