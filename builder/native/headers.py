"""The header files of the FMI standard, and where packages are installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from eightpost.errors import FmuError
from eightpost.extras import MissingExtraError

HEADERS = (
    "fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h",
    "fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h",
)  # fmt: skip


def headers_of(fmi: int) -> tuple[str, ...]:
    """Return the headers that the sources of an FMI version include; those of FMI 3.0 include both."""
    return HEADERS if fmi == 3 else HEADERS[:3]


def fmi_headers() -> Path:
    """Return the folder that contains the standard's header files; those of FMPy know no function prefix.

    Raises:
        MissingExtraError: The package that contains the header files is not installed.
        FmuError: It no longer contains them.
    """
    package = "fmu_manipulation_toolbox"
    folder = installed(package, "resources/fmi")
    if folder is None:
        raise MissingExtraError("building FMUs", package, "build")
    if missing := [name for name in HEADERS if not (folder / name).is_file()]:
        raise FmuError(f"{folder}: {missing[0]} is missing; pip install --force-reinstall {package}")
    return folder


def installed(package: str, name: str) -> Path | None:
    """Return a path in the folder of a package, which is not imported; None if the package is not installed."""
    spec = importlib.util.find_spec(package)
    return None if spec is None or spec.origin is None else Path(spec.origin).parent / name
