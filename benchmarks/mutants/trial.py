"""A trial: the tests of an area on a copy of the checkout, in which one source is changed."""

from __future__ import annotations

import compileall
import contextlib
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from benchmarks.mutants.areas import ROOT, Area
from benchmarks.mutants.mutant import Mutant
from benchmarks.mutants.run_pytest import run_pytest

_OPTIONS = ("-x", "-q", "--no-header", "--tb=line", "--assert=plain", "-p", "no:cacheprovider", "--hypothesis-seed=0")

#: Modification time of all sources in a copy, before that of any change: byte code of unchanged sources stays valid.
_LONG_AGO = 1e9


class Outcome(StrEnum):
    """The outcome for a mutant."""

    KILLED = "killed"
    SURVIVED = "survived"
    TIMEOUT = "timeout"
    """The tests exceeded the time limit, which also counts as killed."""
    INVALID = "invalid"
    """The compiler rejects the source."""
    EQUIVALENT = "equivalent"


@dataclass(frozen=True)
class Trial:
    """The result of the tests of an area."""

    outcome: Outcome  #: Result for the mutant.
    seconds: float  #: Duration [s].
    output: str  #: Text that pytest printed.


@dataclass(frozen=True)
class Tree:
    """A copy of the checkout, for one trial at a time."""

    folder: Path  #: Folder of the copy.
    cache: Path  #: Folder of compiled FMUs; its keys are digests of the sources, so that trials can share it.

    def try_mutant(self, area: Area, mutant: Mutant | None, limit: float) -> Trial:
        """Run the tests of an area, with or without a change.

        Args:
            area: Area whose tests are run.
            mutant: Change to make; None runs the tests on the unchanged sources.
            limit: Time limit [s].
        """
        begin = time.monotonic()
        with self._changed(mutant), tempfile.TemporaryDirectory() as scratch:
            environment = self._environment(Path(scratch))
            status, output = run_pytest(self._arguments(area), self.folder, environment, limit)
        return Trial(_outcome(status, output), time.monotonic() - begin, output)

    @contextlib.contextmanager
    def _changed(self, mutant: Mutant | None) -> Iterator[None]:
        if mutant is None:
            yield
            return
        path = self.folder / mutant.file
        path.write_text(mutant.after, encoding="utf-8")
        try:
            yield
        finally:
            path.write_text(mutant.before, encoding="utf-8")
            os.utime(path, (_LONG_AGO, _LONG_AGO))

    def _arguments(self, area: Area) -> list[str]:
        plugins = [
            part for name in (*area.plugins, "own_tree") for part in ("-p", f"benchmarks.mutants.plugins.{name}")
        ]
        return [*_OPTIONS, *plugins, *area.tests]

    def _environment(self, scratch: Path) -> dict[str, str]:
        """Return the environment, in which neither byte code nor numba's machine code of changed sources is cached."""
        return {
            "PYTHONPATH": str(self.folder),
            "PYTHONDONTWRITEBYTECODE": "1",
            "EIGHTPOST_CACHE": str(self.cache),
            "NUMBA_CACHE_DIR": str(scratch / "numba"),
            "HYPOTHESIS_STORAGE_DIRECTORY": str(scratch / "hypothesis"),
            "PYTEST_DEBUG_TEMPROOT": str(scratch),
        }


def copy_tree(folder: Path, cache: Path, root: Path = ROOT) -> Tree:
    """Copy the tracked and new files of the checkout into a folder."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=root, capture_output=True, text=True, check=True,
    )  # fmt: skip
    for name in filter(None, listed.stdout.split("\0")):
        if (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(root / name, folder / name)
            os.utime(folder / name, (_LONG_AGO, _LONG_AGO))
    for package in ("builder", "cosim", "eightpost"):
        compileall.compile_dir(folder / package, quiet=2)
    return Tree(folder, cache)


def _outcome(status: int | None, output: str) -> Outcome:
    if status is None:
        return Outcome.TIMEOUT
    if status == 0:
        return Outcome.SURVIVED
    return Outcome.INVALID if "could not compile it for" in output else Outcome.KILLED
