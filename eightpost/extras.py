"""Optional packages, grouped by what they are for (the extras of the distribution), and the error if one is missing.

`pip install eightpost` installs what is needed to run FMUs, and to fit shocks without dynamics. Every other package
belongs to an extra, is imported where it is used, inside `needs(...)`, and if it is missing the error names the extra
to install.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

from eightpost.errors import InputError


@dataclass(frozen=True, slots=True)
class _Extra:
    """One extra of the distribution."""

    purpose: str  #: Use of the extra.
    #: Distributions of the extra by the name under which Python imports them.
    packages: Mapping[str, str] = field(default_factory=dict)
    contains: tuple[str, ...] = ()  #: Names of other extras that are installed with it.


#: Distributions that every installation has, by the name under which Python imports them.
REQUIRED: Mapping[str, str] = {
    "arro3.core": "arro3-core", "arro3.io": "arro3-io", "typing_extensions": "typing-extensions",
} | {
    name: name
    for name in (
        "click", "fmpy", "markupsafe", "numpy", "pint", "platformdirs", "pydantic",
        "rich", "scipy", "threadpoolctl",
    )
}  # fmt: skip

#: Extras of pyproject.toml by name, without those for host programs and tests.
EXTRAS: Mapping[str, _Extra] = {
    "report": _Extra(
        "pictures, pages and workbooks (of fits, identify, study, run --report ...)",
        {"jinja2": "jinja2", "matplotlib": "matplotlib", "plotly": "plotly", "xlsxwriter": "xlsxwriter"},
    ),
    "aim": _Extra("logs of AiM (.xrk, .xrz)", {"libxrk": "libxrk"}),
    "app": _Extra("the window in the browser, eightpost app", {"nicegui": "nicegui"}, contains=("fit", "report")),
    "fit": _Extra(
        "fits of laws with dynamics, identify, virtual rigs, and runs in a tenth of the time",
        {"llvmlite": "llvmlite", "numba": "numba"},
    ),
    "files": _Extra(
        "records in spreadsheets and LabVIEW files",
        {"lvm_read": "lvm_read", "nptdms": "nptdms", "python_calamine": "python-calamine"},
    ),
    "build-local": _Extra(
        "building FMUs for this platform with the system's C compiler",
        {
            "fmu_manipulation_toolbox": "fmu-manipulation-toolbox",
            "latex2mathml": "latex2mathml",
            "markdown_it": "markdown-it-py",
            "pythonfmu": "pythonfmu",
        },
        contains=("report",),
    ),
    "build": _Extra("building FMUs for all six platforms", {"ziglang": "ziglang"}, contains=("build-local",)),
    "check": _Extra(
        "checking FMUs of any maker",
        {"PIL": "pillow", "fmu_manipulation_toolbox": "fmu-manipulation-toolbox", "lief": "lief", "lxml": "lxml"},
    ),
    "control": _Extra("exchange of models with python-control", {"control": "control"}),
    "dask": _Extra("studies on a cluster", {"dask": "dask", "distributed": "distributed"}),
    "mat73": _Extra("records in MATLAB 7.3 files", {"h5py": "h5py"}),
    "mdf": _Extra("records in MDF 4 files", {"asammdf": "asammdf"}),
    "notebook": _Extra(
        "tables of results as pandas and xarray objects",
        {"ipykernel": "ipykernel", "pandas": "pandas", "xarray": "xarray"},
    ),
    "optimise": _Extra("search of studies whose bank is too large to run every setup", {"pymoo": "pymoo"}),
    "uff": _Extra("frequency responses as universal files", {"pyuff": "pyuff"}),
}


class MissingExtraError(InputError, ModuleNotFoundError):
    """An optional package is not installed."""

    def __init__(self, purpose: str, name: str, extra: str) -> None:
        super().__init__(requirement(purpose, name, extra))
        self.name = name  #: Name under which Python imports it.
        self.extra = extra  #: Extra that installs it.


def install_command(extra: str) -> str:
    """Return the command that installs an extra."""
    return f'pip install "eightpost[{extra}]"'


def requirement(purpose: str, name: str, extra: str) -> str:
    """Return the sentence that something needs a package that is not installed, with the command that installs it.

    Args:
        purpose: Activity that needs the package, e.g. "reading MDF files".
        name: Name under which Python imports the package.
        extra: Extra that installs it.
    """
    return f"{purpose} needs {packages(extra)[name]}, which is not installed: {install_command(extra)}"


@contextmanager
def needs(extra: str, purpose: str) -> Iterator[None]:
    """Turn the failed import of a package of an extra in the block into the error that names the extra.

    An outer block replaces the extra that an inner one names: building FMUs needs pictures, but also more.

    Args:
        extra: Extra that installs the imported package.
        purpose: Activity that needs the package, e.g. "building FMUs".

    Raises:
        MissingExtraError: The package is not installed.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        name = (error.name or "").partition(".")[0]
        if name not in packages(extra):
            raise  # part of a damaged installation, or a module of this project
        raise MissingExtraError(purpose, name, extra) from error


def packages(extra: str) -> dict[str, str]:
    """Return the distributions of an extra and of those that it contains, by the name under which they are imported."""
    found = dict(EXTRAS[extra].packages)
    for other in EXTRAS[extra].contains:
        found |= packages(other)
    return found


def is_installed(name: str) -> bool:
    """Return whether a package can be imported, without importing it."""
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):  # ValueError: a module without a specification
        return False


def missing(extra: str) -> list[str]:
    """Return the distributions of an extra that are not installed."""
    return [distribution for name, distribution in packages(extra).items() if not is_installed(name)]
