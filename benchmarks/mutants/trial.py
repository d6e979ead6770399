"""A trial: the tests of an area on a copy of the checkout, in which one source is changed."""

from __future__ import annotations

import compileall
import hashlib
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path

from benchmarks.mutants.area_tests import ROOT, Area, loading
from benchmarks.mutants.mutant import Mutant

#: Third-party packages that most tests import. numba is not included, because it reads its environment only once.
_LOADED = (
    "__main__", "control", "filelock", "fmpy", "hypothesis.strategies", "jinja2", "lxml.etree", "numpy", "pint",
    "arro3.io", "pydantic", "pytest", "scipy.integrate", "scipy.optimize", "scipy.signal", "scipy.stats",
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
        arguments = [*_OPTIONS, *loading([*area.plugins, "own_tree"]), *area.tests]
        with self._changed(mutant), tempfile.TemporaryDirectory() as scratch:
            environment = {  # neither byte code nor numba's machine code of changed sources is cached
                "PYTHONPATH": str(self.folder),
                "PYTHONDONTWRITEBYTECODE": "1",
                "EIGHTPOST_CACHE": str(self.cache),
                "NUMBA_CACHE_DIR": f"{scratch}/numba",
                "HYPOTHESIS_STORAGE_DIRECTORY": f"{scratch}/hypothesis",
                "PYTEST_DEBUG_TEMPROOT": scratch,
            }
            status, output = run_pytest(arguments, self.folder, environment, limit)
        return Trial(_outcome(status, output), time.monotonic() - begin, output)

    @contextmanager
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


@dataclass(frozen=True)
class Record:
    """A mutant that was tried."""

    key: str  #: Key of the mutant.
    area: str  #: Name of the area.
    file: str  #: Path relative to the root of the checkout.
    line: int  #: Line number of the change, from 1.
    outcome: Outcome  #: Result for the mutant.
    seconds: float  #: Duration of the trial [s].
    tests: str  #: Digest of the tests that were run.
    diff: str  #: The change as a patch.
    note: str = ""  #: Reason why a mutant is equivalent, or the first test that detected it.

    @classmethod
    def of(cls, mutant: Mutant, outcome: Outcome, *, seconds: float = 0.0, tests: str = "", note: str = "") -> Record:
        """Return the record of a mutant."""
        place = (mutant.key, mutant.area, mutant.file, mutant.line)
        return cls(*place, outcome, round(seconds, 1), tests, mutant.diff, note)


def digest_of_tests(area: Area, root: Path) -> str:
    """Return a digest of the tests of an area and their fixtures in a checkout."""
    digest = hashlib.sha256("\0".join(area.tests).encode())
    paths = {root / test.partition("::")[0] for test in area.tests}
    for path in sorted(path for path in paths if path.exists()):
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path, *path.parent.glob("conftest.py")]:
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


#: File of the records in the folder of a campaign.
_RECORDS = "records.jsonl"


def read_records(folder: Path) -> dict[str, Record]:
    """Return the last record of each mutant by its key."""
    path = folder / _RECORDS
    if not path.exists():
        return {}
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {line["key"]: Record(**line | {"outcome": Outcome(line["outcome"])}) for line in lines}


def append_record(folder: Path, record: Record) -> None:
    """Add a record."""
    with (folder / _RECORDS).open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(record)) + "\n")
