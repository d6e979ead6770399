"""LabVIEW measurements in .tdms files, read with npTDMS."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.extras import is_installed, requirement
from eightpost.signals.channel_map import TIME_NAMES
from eightpost.signals.column_headers import split_header
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import RawRecord

if TYPE_CHECKING:
    from eightpost.confined.readers import Table


def read_tdms(path: str | Path) -> tuple[RawRecord, ...]:
    """Read a .tdms file: one table per group; without a column of time, a waveform's increment gives the time [s].

    Groups of single values become the preamble of the other tables. A channel with another increment or start than the
    others is left out with a note.

    Raises:
        FileFormatError: npTDMS is not installed, or the file cannot be read or has no channel of numbers.
    """
    path = Path(path)
    if not is_installed("nptdms"):
        raise FileFormatError(requirement("reading TDMS files", "nptdms", "files"), path=path)
    tables: list[Table] = read_confined("eightpost.confined.readers:load_tdms", path, kind="a TDMS file")
    tables = [table for table in tables if table.columns]
    if not tables:
        raise FileFormatError("it contains no channel of numbers", path=path)
    facts = tuple(_fact(*column) for table in tables if _is_settings(table) for column in table.columns)
    samples = [table for table in tables if not _is_settings(table)] or tables
    return tuple(_record(table._replace(preamble=(*table.preamble, *facts)), path) for table in samples)


def _is_settings(table: Table) -> bool:
    """Return whether a group has single values: settings of the test, not samples."""
    return all(len(column) == 1 for _, _, column in table.columns)


def _fact(name: str, unit: str, column: NDArray[np.float64]) -> str:
    return f"{name}: {float(column[0]):.9g} {unit}".strip()


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
    kept = [i for i in kept if names[i] not in dict(table.others)]
    preamble = tuple((line,) for line in table.preamble)
    notes = tuple(f"the channel {name!r} was left out: {why}" for name, why in table.others)
    notes += tuple(
        f"the channel {names[i]!r} was left out: it has {columns[i].size} samples, and the time has "
        f"{columns[times[0]].size}"
        for i in range(len(columns))
        if columns[i].size != columns[times[0]].size
    )
    return RawRecord(
        Origin(path),
        tuple(names[i] for i in kept),
        tuple(units[i] for i in kept),
        tuple(columns[i] for i in kept),
        preamble,
        notes,
    )
