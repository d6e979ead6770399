"""Execution of pytest in a process forked from one that has already imported third-party packages, which saves time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from benchmarks.mutants.areas import ROOT

#: Third-party packages that most tests import. numba is not included, because it reads its environment only once.
_LOADED = (
    "__main__", "control", "filelock", "fmpy", "hypothesis.strategies", "jinja2", "lxml.etree", "numpy", "pint",
    "pyarrow.parquet", "pydantic", "pytest", "scipy.integrate", "scipy.optimize", "scipy.signal", "scipy.stats",
    "threadpoolctl",
)  # fmt: skip

_server = multiprocessing.get_context("forkserver")
_server.set_forkserver_preload(list(_LOADED))


def run_pytest(
    arguments: Sequence[str], folder: Path, environment: Mapping[str, str], limit: float
) -> tuple[int | None, str]:
    """Run pytest; return its exit code (None if it exceeded the time limit) and its output.

    Args:
        arguments: Arguments of pytest.
        folder: Folder to run in, whose packages are imported.
        environment: Environment variables to set.
        limit: Time limit [s], after which pytest and its child processes are killed.
    """
    with tempfile.NamedTemporaryFile() as printed:
        process = _server.Process(target=_in_child, args=(arguments, str(folder), dict(environment), printed.name))
        process.start()
        try:
            process.join(limit)
            status = process.exitcode
        finally:
            assert process.pid is not None
            with suppress(ProcessLookupError):  # the process has its own group since os.setsid
                os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            process.join()
        return status, Path(printed.name).read_text(encoding="utf-8", errors="replace")


def _in_child(arguments: Sequence[str], folder: str, environment: Mapping[str, str], printed: str) -> None:
    os.setsid()
    os.chdir(folder)
    os.environ.update(environment)
    sys.dont_write_bytecode = True
    sys.path[:] = [folder, *(path for path in sys.path if Path(path).resolve() != ROOT)]
    file = os.open(printed, os.O_WRONLY)
    for standard in (1, 2):
        os.dup2(file, standard)
    import pytest  # noqa: PLC0415 -- it is loaded where the process comes from

    sys.exit(pytest.main(list(arguments)))
