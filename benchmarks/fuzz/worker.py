"""A process that creates mutants, reads them, and reports the outcome of each; a crash is a finding of the campaign."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from random import Random
from typing import IO

from benchmarks.fuzz.readers import Reader, readers
from eightpost.errors import InputError

#: Outcomes of a mutant; all but the first two are defects.
REFUSED, ACCEPTED, UNNAMED, TRACEBACK, MEMORY = "refused", "accepted", "unnamed", "traceback", "memory"
#: Memory limits for reading one mutant [bytes]: resident memory, and address space in addition to that.
_RESIDENT, _ADDRESSES = 2**30, 3 * 2**30
#: One mutant in this number does not change the content: a missing file, a folder, a link to itself.
_PLACES = 40


def make_mutant(reader: Reader, number: int, seed: int, path: Path) -> None:
    """Replace the sample at `path` with mutant `number` of a campaign with `seed`."""
    rng = Random(f"{seed}/{reader.name}/{number}")
    if number % _PLACES == _PLACES - 1:
        rng.choice((_missing, _folder, _loop, _unreadable))(path)
        return
    content = rng.choice(reader.changes)(rng, path.read_bytes())
    path.write_bytes(content)


def _missing(path: Path) -> None:
    path.unlink()


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _loop(path: Path) -> None:
    path.unlink()
    path.symlink_to(path.name)


def _unreadable(path: Path) -> None:
    path.chmod(0)


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
        with warnings.catch_warnings(), _quiet():
            warnings.simplefilter("ignore")
            reader.read(path)
    except InputError as error:
        return (REFUSED if any(name in str(error) for name in names) else UNNAMED), f"{type(error).__name__}: {error}"[
            :2000
        ]
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        return TRACEBACK, traceback.format_exc(limit=-12)[-6000:]
    return ACCEPTED, ""


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    with Path(os.devnull).open("w", encoding="utf-8") as nothing, contextlib.redirect_stdout(nothing):
        yield


def main() -> None:
    """Read a task `[samples, seed, [[reader, first, last], ...]]`; print an outcome per mutant, one JSON line each."""
    samples, seed, jobs = json.loads(sys.argv[1])
    known = {reader.name: reader for reader in readers()}
    said = os.fdopen(os.dup(1), "w", encoding="utf-8", buffering=1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for name, first, last in jobs:
        with in_place(Path(samples), known[name].sample) as path:
            _limit_addresses(None)
            _warm_up(known[name], path)
            _limit_addresses(_ADDRESSES)
            _try(known[name], range(first, last), seed, path, said)


def _try(reader: Reader, numbers: Iterable[int], seed: int, path: Path, said: IO[str]) -> None:
    sound = path.read_bytes()
    for number in numbers:
        said.write(json.dumps(["begin", reader.name, number]) + "\n")
        begun = time.process_time()
        made = _made(reader, number, seed, path)
        outcome, text = read_mutant(reader, path) if made is None else made
        resident = _peak()
        if outcome in (REFUSED, ACCEPTED) and resident > _RESIDENT:
            outcome, text = MEMORY, f"{resident / 2**20:.0f} MiB"
        said.write(json.dumps(["end", reader.name, number, outcome, text, time.process_time() - begun]) + "\n")
        _restore(path, sound)


def _made(reader: Reader, number: int, seed: int, path: Path) -> tuple[str, str] | None:
    """Create a mutant; if a change fails, report it, because it is a defect of the campaign."""
    try:
        make_mutant(reader, number, seed, path)
    except Exception:
        return TRACEBACK, f"the mutant could not be created\n{traceback.format_exc(limit=-8)}"
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return None


def _restore(path: Path, content: bytes) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    path.write_bytes(content)


def _warm_up(reader: Reader, path: Path) -> None:
    """Read the valid sample, so that libraries are loaded before memory is limited."""
    with warnings.catch_warnings(), contextlib.suppress(InputError):
        warnings.simplefilter("ignore")
        reader.read(path)


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


if __name__ == "__main__":
    main()
