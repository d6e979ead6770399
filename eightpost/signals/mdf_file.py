"""ASAM MDF files (.mf4, .mdf): the channels of one time axis. Read by asammdf, which is an extra."""

from __future__ import annotations

import html
import importlib
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.errors import FileFormatError
from eightpost.signals.origin import Origin
from eightpost.signals.raw_record import RawRecord

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

#: Name of the time axis in the record.
_TIME = "time"


def read_mdf(path: str | Path) -> RawRecord:
    """Read the numeric channels of an MDF file; their time axis is the column `time` [s].

    Channel groups may be several if their samples lie at the same times. The comment in the file's header is the
    record's preamble.

    Raises:
        FileFormatError: asammdf is not installed, it cannot read the file, there is no numeric channel, or the channels
            lie on several time axes.
    """
    path = Path(path)
    mdf = _opened(path)
    try:
        signals = list(_vectors(mdf))
        preamble = _comment(mdf)
    finally:
        mdf.close()
    if not signals:
        raise FileFormatError("there is no numeric channel in it", path=path)
    times = _common_time(signals, path)
    names = tuple(str(signal.name) for signal in signals)
    units = tuple(str(signal.unit).strip() or None for signal in signals)
    columns = tuple(signal.samples.astype(np.float64) for signal in signals)
    return RawRecord(Origin(path), (_TIME, *names), ("s", *units), (times, *columns), preamble)


def _opened(path: Path) -> Any:
    try:
        asammdf = importlib.import_module("asammdf")  # an extra, and it takes seconds to load
    except ImportError as error:
        what = "MDF files are read by asammdf, which is not installed: pip install 'eightpost[mdf]'"
        raise FileFormatError(what, path=path) from error
    try:
        return asammdf.MDF(path)
    except Exception as error:  # asammdf raises its own kind and whatever its parser meets
        raise FileFormatError(f"not an MDF file that asammdf reads: {error}", path=path) from error


def _comment(mdf: Any) -> tuple[tuple[str, ...], ...]:
    """Return the lines of the header's comment, which MDF 4 may wrap in XML."""
    text = str(mdf.header.comment or "")
    found = re.search(r"<TX>(.*?)</TX>", text, flags=re.DOTALL)
    lines = html.unescape(found[1] if found else text).splitlines()
    return tuple((line.strip(),) for line in lines if line.strip())


def _vectors(mdf: Any) -> Iterator[Any]:
    """Yield the channels that are numbers over time; texts, arrays and time axes are passed over."""
    for signal in mdf.iter_channels(skip_master=True):
        if signal.samples.dtype.kind in "iuf" and signal.samples.ndim == 1 and signal.name.lower() != _TIME:
            yield signal


def _common_time(signals: list[Any], path: Path) -> NDArray[np.float64]:
    """Return the time axis (N,) [s] that all channels share."""
    first = signals[0]
    times = np.asarray(first.timestamps, dtype=np.float64)
    for signal in signals[1:]:
        if not np.array_equal(signal.timestamps, times):
            what = (
                f"it has {len(signal)} samples on a time axis of its own, {first.name!r} has {len(first)}; export the "
                "channels on one raster (asammdf: MDF.resample), so that nobody guesses between samples"
            )
            raise FileFormatError(what, path=path, channel=str(signal.name))
    return times
