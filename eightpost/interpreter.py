"""Python child processes with the import path of this process, independent of the current folder."""

from __future__ import annotations

import os
import sys
from pathlib import Path

#: Folder of the packages eightpost, builder and cosim.
ROOT = Path(__file__).resolve().parents[1]


def import_path() -> list[str]:
    """Return this process's import path for a child: absolute, and without the current folder.

    Python searches the current folder first (`python -m`, `python -c`, a notebook), and a user's file there may have
    the name of a module.
    """
    here = Path.cwd()
    entries = [here / entry for entry in sys.path]
    kept = [str(entry) for entry in entries if entry != here or entry.resolve() == ROOT]
    return list(dict.fromkeys(kept if str(ROOT) in kept else [*kept, str(ROOT)]))


def python_command(module: str, *arguments: str) -> list[str]:
    """Return the command that runs a module in a new interpreter with this process's import path.

    The new process ends when this one ends.
    """
    code = (
        f"import sys; sys.path[:] = {import_path()!r}; "
        f"from eightpost.processes import end_with; end_with({os.getpid()}); import runpy; "
        f"runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    )
    return [sys.executable, "-P", "-c", code, *arguments]
