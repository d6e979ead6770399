"""Reading of MATLAB files with scipy in the child process, because some damaged files crash scipy's reader."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import scipy.io

from eightpost.errors import FileFormatError


def load(path: Path, simplify: bool) -> dict[str, Any]:
    """Return the variables of a file by name.

    Args:
        path: Path of the file.
        simplify: Whether to convert structs to dicts and to drop dimensions of length one.

    Raises:
        FileFormatError: The file is of version 7.3 (HDF5).
    """
    try:
        content = scipy.io.loadmat(path, simplify_cells=simplify)
    except NotImplementedError as error:
        what = "MATLAB 7.3 (HDF5) files are not supported; save it again with `save(..., '-v7')`"
        raise FileFormatError(what, path=path) from error
    return {name: value for name, value in content.items() if not name.startswith("__")}
