"""LabVIEW measurements: .tdms (npTDMS) and .lvm (lvm_read)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.extras import is_installed, requirement
from eightpost.signals.channel_map import TIME_NAMES
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import RawRecord, split_header

if TYPE_CHECKING:
    from eightpost.confined.readers import Table


def read_tdms(path: str | Path) -> tuple[RawRecord, ...]:
    """Read a .tdms file: one table per group; a waveform's increment gives the time.

    Raises:
        FileFormatError: The package that reads it is not installed, or the file cannot be read or has no channel of
            numbers.
    """
    _check_reader(path, "nptdms", "reading TDMS files")
    return _records(Path(path), "load_tdms", "a TDMS file")


def read_lvm(path: str | Path) -> tuple[RawRecord, ...]:
    """Read a .lvm file: one table per segment.

    Raises:
        FileFormatError: The package that reads it is not installed, or the file cannot be read or has no channel of
            numbers.
    """
    _check_reader(path, "lvm_read", "reading LabVIEW measurements (.lvm)")
    return _records(Path(path), "load_lvm", "a LabVIEW measurement (.lvm)")


def _check_reader(path: str | Path, name: str, purpose: str) -> None:
    if not is_installed(name):
        raise FileFormatError(requirement(purpose, name, "files"), path=path)


def _records(path: Path, function: str, kind: str) -> tuple[RawRecord, ...]:
    tables: list[Table] = read_confined(f"eightpost.confined.readers:{function}", path, kind=kind)
    records = tuple(_record(table, path) for table in tables if table.columns)
    if not records:
        raise FileFormatError("it contains no channel of numbers", path=path)
    return records


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
    kept = [i for i, column in enumerate(columns) if column.size == columns[times[0]].size]
    preamble = tuple((line,) for line in table.preamble)
    return RawRecord(
        Origin(path),
        tuple(names[i] for i in kept),
        tuple(units[i] for i in kept),
        tuple(columns[i] for i in kept),
        preamble,
    )
