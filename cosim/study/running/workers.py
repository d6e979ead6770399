"""The program that computes a study: results of workers are equal to the bit only if they have the same one."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import version
from itertools import islice
from math import inf
from pathlib import Path
from time import process_time
from typing import Protocol

import cosim
import eightpost
from cosim.study.definition import Study
from cosim.study.running.coupling import calibrated, coupling_for
from cosim.study.running.evaluator import Coupling, Evaluator, Row
from cosim.study.table import FAILED
from eightpost import __version__
from eightpost.errors import StepError
from eightpost.machine.car import NotInBatchError, sources
from eightpost.workers.pool import POLL, Pool, working


@dataclass(frozen=True, slots=True)
class Program:
    """What determines the bits of a result besides its inputs."""

    version: str  #: Version of eightpost.
    code: str  #: SHA-256 of its sources.
    libraries: Mapping[str, str]  #: Versions of the libraries that compute measures, by name.

    def difference(self, expected: Program) -> str:
        """Return in words how this program differs from the expected one; empty if it is the same."""
        if self.version != expected.version:
            return f"eightpost {self.version}, but {expected.version} is required"
        if self.code != expected.code:
            return f"eightpost {self.version} with other sources, but the same ones are required"
        return ""

    def other_libraries(self, expected: Program) -> str:
        """Return the libraries that have other versions than expected, as text."""
        apart = {name: found for name, found in self.libraries.items() if found != expected.libraries.get(name)}
        return ", ".join(f"{name} {found} instead of {expected.libraries.get(name)}" for name, found in apart.items())


@cache
def program() -> Program:
    """Return the program of this process."""
    digest = hashlib.sha256()
    for package in (cosim, eightpost):
        folder = Path(package.__file__ or "").parent
        for path in sorted(folder.rglob("*.py")):
            if "examples" not in path.relative_to(folder).parts:  # a wheel has them, a checkout does not
                _add(digest, path.relative_to(folder).as_posix(), path.read_bytes())
    for name, content in sorted(sources().items()):
        _add(digest, name, content)
    return Program(__version__, digest.hexdigest(), {name: version(name) for name in ("numpy", "scipy")})


def _add(digest: hashlib._Hash, name: str, content: bytes) -> None:
    digest.update(name.encode() + b"\0" + content.replace(b"\r\n", b"\n") + b"\0")


# ==== Worker processes of a study, and the work that they do =========================================================

# ---- Functions that run in worker processes; all arguments are plain values, so that they can run on ----------------

#: Evaluator of each thread: the instance of an FMU may be stepped by one thread only.
_own = threading.local()


def _evaluator_for(study: str) -> Evaluator:
    """Return this thread's evaluator of a study, given as JSON."""
    if getattr(_own, "study", None) != study:
        described, known = Study.from_json(study), getattr(_own, "evaluator", None)
        similar = None if known is None else known.for_study(described)
        _own.evaluator, _own.study = similar or Evaluator(described), study
    evaluator: Evaluator = _own.evaluator
    return evaluator


def choose(study: str) -> Coupling:
    """Choose the coupling of a study, given as JSON."""
    with working():
        return coupling_for(_evaluator_for(study))


def rows(study: str, coupling: Coupling, indices: Sequence[int]) -> list[Row]:
    """Run setups by number."""
    with working():
        evaluator = _evaluator_for(study)
        if evaluator.batches(coupling) is None:
            coupling = _calibrated(evaluator, coupling)
        return evaluator.rows([evaluator.study.space.setup(index) for index in indices], coupling)


def _calibrated(evaluator: Evaluator, coupling: Coupling) -> Coupling:
    """Return the coupling with the errors of runs through the FMUs, which are estimated once in each thread."""
    if getattr(_own, "given", None) != (evaluator.study, coupling):
        _own.given, _own.calibrated = (evaluator.study, coupling), calibrated(evaluator, coupling)
    found: Coupling = _own.calibrated
    return found


def batch_refusal(study: str, coupling: Coupling) -> str:
    """Return why this process runs setups through the FMUs although the coupling asks for batches; else empty."""
    try:
        if coupling.machine is not None:
            _evaluator_for(study).batches_at(coupling.machine.step, single=coupling.machine.in_single)
    except NotInBatchError as reason:
        return str(reason)
    return ""


# ---- Workers that run the setups of a study -------------------------------------------------------------------------

#: Number of chunks submitted per worker, so that no worker is idle.
_SUBMITTED = 2

#: Processor time after which the setups that are left are given to worker processes [s]; starting one takes about two.
_ALONE = 10.0

#: Time without a heartbeat after which a worker is ended [s]; a heartbeat comes every few thousand coupling steps.
PATIENCE = 300.0

_CRASHES = (
    "the worker process crashed while it ran only this setup, so one of its FMUs crashes (see eightpost run --isolate)"
)


@dataclass(frozen=True, slots=True)
class Chunk:
    """Setups that one worker runs one after the other."""

    number: int  #: Number of the chunk.
    indices: tuple[int, ...]  #: Numbers of the setups.


class Workers(Protocol):
    """Workers that run setups, on this machine or elsewhere."""

    @property
    def count(self) -> int:
        """Number of setups that run in parallel."""

    def choose(self, study: Study) -> Coupling:
        """Choose the coupling of a study."""

    def rows(
        self, study: Study, coupling: Coupling, chunks: Iterable[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run chunks and yield their rows as they complete, in any order; take none after `stop` returns True."""

    def close(self) -> None:
        """End the workers."""


class ProcessWorkers:
    """Worker processes of this machine. If an FMU makes one crash or hang, only one setup fails.

    What the machine runs takes less time than the start of a process, and no FMU that a study builds crashes: a study
    of these, without measures of the user's own, begins in this process, and only a long one goes on in others.

    Args:
        patience: Time without a heartbeat after which a process is ended [s].
        evaluator: Evaluator of the study, or of one with the same vehicle and drives; None: every study runs in worker
            processes.
        built: Folders of the FMUs that the study builds; any other FMU may end or block this process.
    """

    def __init__(
        self,
        count: int,
        *,
        patience: float = PATIENCE,
        evaluator: Evaluator | None = None,
        built: Collection[Path] = (),
    ) -> None:
        self._count, self._patience, self._evaluator, self._built = count, patience, evaluator, built
        self._is_alone = evaluator is not None and self._is_trusted(evaluator.study)

    @property
    def count(self) -> int:
        """Number of setups that run in parallel; one while this process runs them."""
        return 1 if self._is_alone else self._count

    @cached_property
    def _pool(self) -> Pool:
        return Pool(self._count, self._patience)

    def choose(self, study: Study) -> Coupling:
        """Choose the coupling of a study.

        Raises:
            StepError: No setup could be run, or an FMU crashed or hung.
        """
        if (here := self._here(study)) is not None:
            return coupling_for(here)
        chosen: Future[Coupling] = self._pool.submit(choose, study.to_json())
        hung = self._pool.wait_for(chosen)
        try:
            return chosen.result()
        except BrokenProcessPool:
            what = f"was not responding for {self._patience:g} s" if hung else "crashed"
            raise StepError(
                f"a worker process {what} while it chose the coupling, so an FMU {'hangs' if hung else 'crashes'}. "
                "Find it with `eightpost check` and `eightpost run --isolate`, and remove it from the bank"
            ) from None

    def rows(
        self, study: Study, coupling: Coupling, chunks: Iterable[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run chunks and yield their rows as they complete; no chunk is started after `stop` returns True."""
        waiting, here = iter(chunks), self._here(study)
        batches = None if here is None else here.batches(coupling)
        self._is_alone = batches is not None and not batches.left_out
        until = process_time() + (_ALONE if self._count > 1 else inf)
        while here is not None and self._is_alone:
            if stop() or (chunk := next(waiting, None)) is None:
                return
            yield chunk, here.rows([study.space.setup(index) for index in chunk.indices], coupling)
            self._is_alone = process_time() < until
        text = study.to_json()
        running: dict[Future[list[Row]], Chunk] = {}
        while True:
            room = 0 if stop() else self.count * _SUBMITTED - len(running)
            running |= {self._pool.submit(rows, text, coupling, c.indices): c for c in islice(waiting, room)}
            if not running:
                return
            finished, _ = wait(running, timeout=POLL, return_when=FIRST_COMPLETED)
            self._pool.end_unresponsive()
            if any(isinstance(future.exception(), BrokenProcessPool) for future in finished):
                yield from self._one_by_one(study, coupling, list(running.values()), stop)
                running.clear()
                continue
            for future in finished:
                yield running.pop(future), future.result()

    def close(self, *, wait: bool = False) -> None:
        """End the workers, after their current work if `wait`, else after a short time for cleaning up."""
        if "_pool" in vars(self):
            self._pool.close(wait=wait)

    def _here(self, study: Study) -> Evaluator | None:
        """Return the evaluator of a study in this process; None if it has code that may crash."""
        found = self._evaluator.for_study(study) if self._evaluator and self._is_trusted(study) else None
        self._evaluator = found or self._evaluator
        return found

    def _is_trusted(self, study: Study) -> bool:
        fmus = (study.vehicle.fmu, *(build.fmu for build in study.bank.values()))
        return all(fmu.parent in self._built for fmu in fmus) and not any(m.function for m in study.measures)

    def _one_by_one(
        self, study: Study, coupling: Coupling, chunks: list[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run the interrupted setups again one by one, to find the one that makes a worker crash."""
        self._pool.restart()
        for chunk in chunks:
            if stop():
                return
            yield chunk, [self._alone(study, coupling, index) for index in chunk.indices]

    def _alone(self, study: Study, coupling: Coupling, index: int) -> Row:
        answer: Future[list[Row]] = self._pool.submit(rows, study.to_json(), coupling, (index,))
        hung = self._pool.wait_for(answer)
        try:
            return answer.result()[0]
        except BrokenProcessPool:
            self._pool.restart()
            return failed_row(study, index, self._hangs if hung else _CRASHES)

    @property
    def _hangs(self) -> str:
        return (
            f"the worker process was ended because it was not responding for {self._patience:g} s while it ran "
            "only this setup: one of its FMUs hangs "
            "(see eightpost run --isolate) or needs longer for some thousand steps"
        )


def failed_row(study: Study, index: int, message: str = _CRASHES) -> Row:
    """Return the row of a setup whose worker process crashed or was ended."""
    return {
        "setup": index,
        **study.space.setup(index).builds,
        **dict.fromkeys(measure.name for measure in study.measures),
        "status": FAILED,
        "message": message,
        "coupling_error_percent": None,
        "marks": "",
        "seconds": 0.0,
    }
