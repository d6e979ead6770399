"""The FMI 2.0 header files, which the standard wants to be the importer's and not the FMU's.

They are those that fmpy's wheel carries (2-clause BSD licence); fmpy itself is not imported.
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

from eightpost.errors import FmuError

NAMES = ("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h")


def fmi_headers() -> Path:
    """Return the folder that holds them.

    Raises:
        FmuError: fmpy is not installed, or carries them no longer.
    """
    spec = importlib.util.find_spec("fmpy")
    if spec is None or spec.origin is None:
        raise FmuError("fmpy is not installed, and it carries the FMI header files; install eightpost again")
    folder = Path(spec.origin).with_name("c-code")
    if missing := [name for name in NAMES if not (folder / name).is_file()]:
        raise FmuError(f"{folder}: there is no {missing[0]}; install fmpy again (pip install --force-reinstall fmpy)")
    return folder
