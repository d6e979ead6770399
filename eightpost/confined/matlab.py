"""MATLAB files as scipy reads them. Runs in the child: scipy's reader ends the process over some damaged files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import scipy.io

from eightpost.errors import FileFormatError


def load(path: Path, simplify: bool) -> dict[str, Any]:
    """Return the variables of a file by name.

    Args:
        path: The file.
        simplify: Whether to turn structs into dicts and to drop dimensions of one.

    Raises:
        FileFormatError: The file is of version 7.3 (HDF5).
    """
    try:
        content = scipy.io.loadmat(path, simplify_cells=simplify)
    except NotImplementedError as error:
        what = "it is a MATLAB 7.3 (HDF5) file, which is not read; save it again with `save(..., '-v7')`"
        raise FileFormatError(what, path=path) from error
    return {name: value for name, value in content.items() if not name.startswith("__")}
