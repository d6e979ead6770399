"""Reading of MDF files with asammdf in the child process, because some damaged files crash asammdf."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray


class Signal(NamedTuple):
    """A numeric channel: name and unit as in the file, samples (N,) and times (N,) [s]."""

    name: str
    unit: str
    samples: NDArray[np.float64]
    times: NDArray[np.float64]


def load(path: Path) -> tuple[list[Signal], str]:
    """Return the numeric channels of a file and the comment in its header."""
    mdf = importlib.import_module("asammdf").MDF(path)  # an optional dependency without type hints
    try:
        return list(_numeric(mdf)), str(mdf.header.comment or "")
    finally:
        mdf.close()


def _numeric(mdf: Any) -> Iterator[Signal]:
    """Yield the channels with one number per sample; skip texts, arrays and time axes."""
    for signal in mdf.iter_channels(skip_master=True):
        if signal.samples.dtype.kind in "iuf" and signal.samples.ndim == 1:
            samples, times = (np.asarray(values, dtype=np.float64) for values in (signal.samples, signal.timestamps))
            yield Signal(str(signal.name), str(signal.unit).strip(), samples, times)
