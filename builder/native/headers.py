"""Location of the FMI 2.0 header files, which the importer must provide, not the FMU.

The headers are those in the wheel of FMPy (2-clause BSD licence); FMPy itself is not imported.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

from eightpost.errors import FmuError

NAMES = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")


def fmi_headers() -> Path:
    """Return the folder that contains the header files.

    Raises:
        FmuError: FMPy is not installed, or no longer contains the header files.
    """
    spec = importlib.util.find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise FmuError("fmpy, which contains the FMI header files, is not installed; reinstall eightpost")
    folder = Path(spec.origin).with_name("c-code")
    if missing := [name for name in NAMES if not (folder / name).is_file()]:
        raise FmuError(f"{folder}: {missing[0]} is missing; reinstall fmpy (pip install --force-reinstall fmpy)")
    return folder
