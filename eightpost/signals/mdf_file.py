"""ASAM MDF files (.mf4, .mdf) with one time axis, read with asammdf, which is an optional dependency."""

from __future__ import annotations

import html
import importlib.util
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import RawRecord

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.confined.readers import Signal

#: Name of the time axis in the record.
_TIME = "time"


def read_mdf(path: str | Path) -> RawRecord:
    """Read the numeric channels of an MDF file; their time axis becomes the column `time` [s].

    The file may have several channel groups if all have the same sample times. The comment in the file's header becomes
    the preamble of the record.

    Raises:
        FileFormatError: asammdf is not installed or cannot read the file, there is no numeric channel, or the channels
            have different time axes.
    """
    path = Path(path)
    if importlib.util.find_spec("asammdf") is None:
        what = "reading MDF files needs asammdf, which is not installed: pip install 'eightpost[mdf]'"
        raise FileFormatError(what, path=path)
    found, comment = read_confined("eightpost.confined.readers:load_mdf", path, kind="an MDF file that asammdf reads")
    signals: list[Signal] = [signal for signal in found if signal.name.lower() != _TIME]
    if not signals:
        raise FileFormatError("it contains no numeric channel", path=path)
    times = _common_time(signals, path)
    names, units = (_TIME, *(signal.name for signal in signals)), ("s", *(signal.unit or None for signal in signals))
    return RawRecord(Origin(path), names, units, (times, *(signal.samples for signal in signals)), _lines(comment))


def _lines(comment: str) -> tuple[tuple[str, ...], ...]:
    """Return the lines of the header's comment, which MDF 4 may wrap in XML."""
    found = re.search(r"<TX>(.*?)</TX>", comment, flags=re.DOTALL)
    lines = html.unescape(found[1] if found else comment).splitlines()
    return tuple((line.strip(),) for line in lines if line.strip())


def _common_time(signals: list[Signal], path: Path) -> NDArray[np.float64]:
    """Return the time axis (N,) [s] that all channels share."""
    first = signals[0]
    for signal in signals:
        if signal.samples.size != signal.times.size:
            what = f"it has {signal.samples.size} samples and {signal.times.size} times: the file is damaged"
            raise FileFormatError(what, path=path, channel=signal.name)
        if not np.array_equal(signal.times, first.times):
            what = (
                f"it has {signal.times.size} samples, and its time axis differs from that of {first.name!r} with "
                f"{first.times.size} samples; export all channels on one time axis (asammdf: MDF.resample), because "
                "eightpost does not interpolate between samples here"
            )
            raise FileFormatError(what, path=path, channel=signal.name)
    return first.times
