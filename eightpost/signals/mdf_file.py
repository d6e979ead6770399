"""ASAM MDF files (.mf4, .mdf), read with asammdf, which is an optional dependency."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import TYPE_CHECKING

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.extras import is_installed, requirement
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import RawRecord
from eightpost.signals.time_axes import by_time, temperatures_at

if TYPE_CHECKING:
    from eightpost.confined.readers import Signal

#: Name of the time axis in the record.
_TIME = "time"


def read_mdf(path: str | Path) -> tuple[RawRecord, ...]:
    """Read the numeric channels of an MDF file: one table per time axis, which becomes its column `time` [s].

    Channel groups with the same sample times make one table. Tables with many channels come first, then long ones.
    Temperatures change slowly, so the first table has those of the other tables too, interpolated. The comment in the
    file's header becomes the preamble of each table.

    Raises:
        FileFormatError: asammdf is not installed or cannot read the file, or there is no numeric channel.
    """
    path = Path(path)
    if not is_installed("asammdf"):
        raise FileFormatError(requirement("reading MDF files", "asammdf", "mdf"), path=path)
    found, comment = read_confined("eightpost.confined.readers:load_mdf", path, kind="an MDF file that asammdf reads")
    signals: list[Signal] = [signal for signal in found if signal.name.lower() != _TIME]
    if not signals:
        raise FileFormatError("it contains no numeric channel", path=path)
    _check_sizes(signals, path)
    first, *others = by_time(signals)
    first = [*first, *temperatures_at(first[0].times, others)]
    return tuple(_table(table, path, comment) for table in (first, *others))


def _check_sizes(signals: list[Signal], path: Path) -> None:
    for signal in signals:
        if signal.samples.size != signal.times.size:
            what = f"it has {signal.samples.size} samples and {signal.times.size} times: the file is damaged"
            raise FileFormatError(what, path=path, channel=signal.name)


def _table(signals: list[Signal], path: Path, comment: str) -> RawRecord:
    names, units = (_TIME, *(signal.name for signal in signals)), ("s", *(signal.unit or None for signal in signals))
    columns = (signals[0].times, *(signal.samples for signal in signals))
    return RawRecord(Origin(path), names, units, columns, _lines(comment))


def _lines(comment: str) -> tuple[tuple[str, ...], ...]:
    """Return the lines of the header's comment, which MDF 4 may wrap in XML."""
    found = re.search(r"<TX>(.*?)</TX>", comment, flags=re.DOTALL)
    lines = html.unescape(found[1] if found else comment).splitlines()
    return tuple((line.strip(),) for line in lines if line.strip())
