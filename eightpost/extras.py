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


#: Distributions with another name than that under which Python imports them.
_OTHER = {
    "PIL": "pillow", "arro3.core": "arro3-core", "arro3.io": "arro3-io", "markdown_it": "markdown-it-py",
    "fmu_manipulation_toolbox": "fmu-manipulation-toolbox", "python_calamine": "python-calamine",
    "typing_extensions": "typing-extensions",
}  # fmt: skip


def _named(*imported: str) -> dict[str, str]:
    """Return distributions by the names under which Python imports them."""
    return {name: _OTHER.get(name, name) for name in imported}


#: Distributions that every installation has, by the name under which Python imports them.
REQUIRED: Mapping[str, str] = _named(
    "arro3.core", "arro3.io", "typing_extensions", "click", "fmpy", "markupsafe", "numpy", "pint", "platformdirs",
    "pydantic", "rich", "scipy", "threadpoolctl",
)  # fmt: skip

#: Extras of pyproject.toml by name, without those for host programs and tests.
EXTRAS: Mapping[str, _Extra] = {
    "report": _Extra("pictures, pages and workbooks (of fits, identify, study, run --report ...)",
                     _named("jinja2", "matplotlib", "plotly", "xlsxwriter")),
    "aim": _Extra("logs of AiM (.xrk, .xrz)", _named("libxrk")),
    "app": _Extra("the window in the browser, eightpost app", _named("nicegui"), contains=("fit", "report")),
    "fit": _Extra("fits of laws with dynamics, identify, virtual rigs, and runs in a tenth of the time",
                  _named("llvmlite", "numba")),
    "files": _Extra("records in spreadsheets and LabVIEW files", _named("lvm_read", "nptdms", "python_calamine")),
    "build-local": _Extra("building FMUs for this platform with the system's C compiler",
                          _named("fmu_manipulation_toolbox", "latex2mathml", "markdown_it", "pythonfmu"),
                          contains=("report",)),
    "build": _Extra("building FMUs for all six platforms", _named("ziglang"), contains=("build-local",)),
    "check": _Extra("checking FMUs of any maker", _named("PIL", "fmu_manipulation_toolbox", "lief", "lxml")),
    "control": _Extra("exchange of models with python-control", _named("control")),
    "dask": _Extra("studies on a cluster", _named("dask", "distributed")),
    "mat73": _Extra("records in MATLAB 7.3 files", _named("h5py")),
    "mdf": _Extra("records in MDF 4 files", _named("asammdf")),
    "notebook": _Extra("tables of results as pandas and xarray objects", _named("ipykernel", "pandas", "xarray")),
    "optimise": _Extra("search of studies whose bank is too large to run every setup", _named("pymoo")),
    "uff": _Extra("frequency responses as universal files", _named("pyuff")),
}  # fmt: skip


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
