"""Functions that read MATLAB files (scipy) and MDF files (asammdf) in the child: some damaged files crash both."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.errors import FileFormatError


def load_matlab(path: Path, simplify: bool) -> dict[str, Any]:
    """Return the variables of a file by name.

    Args:
        path: Path of the file.
        simplify: Whether to convert structs to dicts and to drop dimensions of length one.

    Raises:
        FileFormatError: The file is of version 7.3 (HDF5).
    """
    import scipy.io  # noqa: PLC0415 -- not needed for MDF files

    try:
        content = scipy.io.loadmat(path, simplify_cells=simplify)
    except NotImplementedError as error:
        what = "MATLAB 7.3 (HDF5) files are not supported; save it again with `save(..., '-v7')`"
        raise FileFormatError(what, path=path) from error
    return {name: value for name, value in content.items() if not name.startswith("__")}


class Signal(NamedTuple):
    """A numeric channel: name and unit as in the file, samples (N,) and times (N,) [s]."""

    name: str
    unit: str
    samples: NDArray[np.float64]
    times: NDArray[np.float64]


def load_mdf(path: Path) -> tuple[list[Signal], str]:
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
