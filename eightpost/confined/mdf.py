"""MDF files as asammdf reads them. Runs in the child: asammdf ends the process over some damaged files."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Signal(NamedTuple):
    """A numeric channel: its name and unit as written, samples (N,) and times (N,) [s]."""

    name: str
    unit: str
    samples: NDArray[np.float64]
    times: NDArray[np.float64]


def load(path: Path) -> tuple[list[Signal], str]:
    """Return the numeric channels of a file and its header's comment."""
    mdf = importlib.import_module("asammdf").MDF(path)  # an extra, without types
    try:
        return list(_numeric(mdf)), str(mdf.header.comment or "")
    finally:
        mdf.close()


def _numeric(mdf: Any) -> Iterator[Signal]:
    """Yield the channels that are numbers over time; texts, arrays and time axes are passed over."""
    for signal in mdf.iter_channels(skip_master=True):
        if signal.samples.dtype.kind in "iuf" and signal.samples.ndim == 1:
            samples, times = (np.asarray(values, dtype=np.float64) for values in (signal.samples, signal.timestamps))
            yield Signal(str(signal.name), str(signal.unit).strip(), samples, times)
