"""Check at start-up that no user's file would be imported in place of a module that the commands need.

The command line imports this module before any other, so it uses only modules that Python itself has already loaded.
"""

import _signal  # type: ignore[import-not-found]  # part of the interpreter, which `signal` only wraps
import os
import sys
from collections.abc import Iterable

_ROOT = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))  # noqa: PTH120 - pathlib is not loaded yet
_OURS = ("builder", "cosim", "eightpost")

#: Packages that the commands import. Each of them is a folder, so a file NAME.py is never the real package.
THIRD_PARTY = (
    "arro3", "asammdf", "click", "control", "dask", "distributed", "fmpy", "fmu_manipulation_toolbox", "h5py", "jinja2",
    "latex2mathml", "libxrk", "lief", "llvmlite", "lxml", "markdown_it", "markupsafe", "matplotlib", "nicegui",
    "nptdms", "numba", "numpy", "pandas", "PIL", "pint", "platformdirs", "plotly", "pydantic", "pymoo",
    "python_calamine", "pythonfmu", "pyuff", "rich", "scipy", "xarray", "xlsxwriter", "ziglang",
)  # fmt: skip


def _clashing_files(path: Iterable[str]) -> list[str]:
    """Return the files on an import path that hide a module of the same name that the commands need."""
    folders = [os.path.realpath(folder) for folder in path]
    library = os.path.dirname(os.path.realpath(os.__file__))  # noqa: PTH120
    found = []
    for folder in _before(folders, _ROOT):
        found += _there(folder, [f"{name}{end}" for name in _OURS for end in (".py", f"{os.sep}__init__.py")])
    for folder in _before(folders, library):
        found += _there(folder, [f"{name}.py" for name in (*THIRD_PARTY, *sorted(sys.stdlib_module_names))])
    return list(dict.fromkeys(found))


def _before(folders: list[str], last: str) -> list[str]:
    return folders[: folders.index(last)] if last in folders else folders


def _there(folder: str, names: list[str]) -> list[str]:
    """Return those of the named files that exist in a folder."""
    try:
        content = set(os.listdir(folder))  # noqa: PTH208
    except OSError:  # there is no such folder, or it is an archive
        return []
    likely = (os.path.join(folder, name) for name in names if name.partition(os.sep)[0] in content)  # noqa: PTH118
    return [file for file in likely if os.path.isfile(file)]  # noqa: PTH113


def _refuse_clashes() -> None:
    """Exit with an error if a user's file hides a module.

    The folder that `python -m` puts first is removed from the import path before the check. PYTHONSAFEPATH makes Python
    child processes ignore their current folder as well.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    if _is_module() and not sys.flags.safe_path and os.path.realpath(sys.path[0]) != _ROOT:
        del sys.path[0]
    if clashes := _clashing_files(sys.path):
        sys.stderr.write(
            f"error: {', '.join(clashes)}: Python would import this in place of a module of the same name that "
            "eightpost needs; rename the file, or remove its folder from PYTHONPATH\n"
        )
        raise SystemExit(2)


def _is_module() -> bool:
    """Return whether this process was started as `python -m eightpost`."""
    started = getattr(sys.modules["__main__"], "__spec__", None)
    return started is not None and started.name == "eightpost.__main__"


def _is_script() -> bool:
    """Return whether this process was started as `eightpost`."""
    return os.path.basename(sys.argv[0]).removesuffix(".exe") == "eightpost"  # noqa: PTH119


def _end(_number: int, _frame: object) -> None:
    """End at Ctrl-C without a traceback; from when a command runs, it ends in its own way."""
    os._exit(1)


if _is_module() or _is_script():
    if _signal.getsignal(_signal.SIGINT) is _signal.default_int_handler:  # otherwise it is ignored
        _signal.signal(_signal.SIGINT, _end)
    _refuse_clashes()
