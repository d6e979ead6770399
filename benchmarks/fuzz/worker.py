"""Work of a process that creates mutants, reads them, and reports the outcome of each; a crash is a finding."""

from __future__ import annotations

import contextlib
import faulthandler
import io
import os
import shutil
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from random import Random

from benchmarks.fuzz.readers import Reader, readers
from eightpost.errors import InputError

#: Outcomes of a mutant; all but the first two are defects.
OUTCOMES = ("refused", "accepted", "unnamed", "traceback", "crash", "memory", "hang")
SOUND = REFUSED, ACCEPTED = OUTCOMES[:2]
UNNAMED, TRACEBACK, CRASH, MEMORY, HANG = OUTCOMES[2:]
#: Memory limits for reading one mutant [bytes]: resident memory, and address space in addition to that.
_RESIDENT, _ADDRESSES = 2**30, 3 * 2**30
#: One mutant in this number does not change the content: a missing file, a folder, a link to itself.
_PLACES = 40


def make_mutant(reader: Reader, number: int, seed: int, path: Path) -> None:
    """Replace the sample at `path` with mutant `number` of a campaign with `seed`."""
    rng = Random(f"{seed}/{reader.name}/{number}")
    if number % _PLACES == _PLACES - 1:
        kind = rng.randrange(4)
        if kind == 0:
            path.chmod(0)
            return
        path.unlink()
        if kind == 1:
            path.mkdir()
        elif kind == 2:
            path.symlink_to(path.name)  # a loop
        return
    path.write_bytes(rng.choice(reader.changes)(rng, path.read_bytes()))


@contextlib.contextmanager
def in_place(samples: Path, sample: str) -> Iterator[Path]:
    """Provide the path of a sample in a copy of the samples' folder, which also contains files that it refers to."""
    with tempfile.TemporaryDirectory(prefix="fuzz_") as folder:
        copy = Path(folder) / "s"
        shutil.copytree(samples, copy)
        yield copy / sample


def read_mutant(reader: Reader, path: Path) -> tuple[str, str]:
    """Read a mutant; return the outcome and the error message."""
    names = (path.name, str(path.parent), *reader.neighbours)  # the message may name a file that this one names
    try:
        with warnings.catch_warnings(action="ignore"), contextlib.redirect_stdout(io.StringIO()):
            reader.read(path)
    except InputError as error:
        text = f"{type(error).__name__}: {error}"[:2000]
        return (REFUSED if any(name in str(error) for name in names) else UNNAMED), text
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return TRACEBACK, traceback.format_exc(limit=-12)[-6000:]
    return ACCEPTED, ""


def work(said: Connection, printed: str, samples: Path, seed: int, jobs: list[tuple[str, int, int]]) -> None:
    """Try the mutants of jobs (reader, first number, number after the last); send two messages for each.

    Args:
        said: Connection to which `(reader, number)` is sent before a mutant is read, and its outcome after that.
        printed: File for what this process prints, such as the stack of a crash.
        samples: Folder of the valid samples.
        seed: Seed of the mutants.
        jobs: Mutants to try.
    """
    for stream in (1, 2):
        os.dup2(os.open(printed, os.O_WRONLY | os.O_APPEND), stream)
    faulthandler.enable()
    known = {reader.name: reader for reader in readers()}
    for name, first, last in jobs:
        reader = known[name]
        with in_place(samples, reader.sample) as path:
            _limit_addresses(None)
            with contextlib.suppress(InputError):
                reader.read(path)  # so that libraries are loaded before memory is limited
            _limit_addresses(_ADDRESSES)
            sound = path.read_bytes()
            for number in range(first, last):
                said.send((name, number))
                begun = time.process_time()
                outcome, text = _made(reader, number, seed, path) or read_mutant(reader, path)
                resident = _peak()
                if outcome in SOUND and resident > _RESIDENT:
                    outcome, text = MEMORY, f"{resident / 2**20:.0f} MiB"
                said.send((name, number, outcome, text, time.process_time() - begun))
                if path.is_dir() and not path.is_symlink():
                    shutil.rmtree(path)
                path.unlink(missing_ok=True)
                path.write_bytes(sound)


def _made(reader: Reader, number: int, seed: int, path: Path) -> tuple[str, str] | None:
    """Create a mutant; if a change fails, report it, because it is a defect of the campaign."""
    try:
        make_mutant(reader, number, seed, path)
    except Exception:
        return TRACEBACK, f"the mutant could not be created\n{traceback.format_exc(limit=-8)}"
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return None


def _limit_addresses(more: int | None) -> None:
    """Limit the address space to the current size plus `more` [bytes]; None removes the limit."""
    try:
        import resource  # noqa: PLC0415
    except ImportError:  # Windows
        return
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if more is None:
        resource.setrlimit(resource.RLIMIT_AS, (hard, hard))
        return
    taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + more, hard))


def _peak() -> int:
    """Return the peak resident memory since the mutant was created [bytes]; 0 if the system does not report it."""
    with contextlib.suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    return 0
