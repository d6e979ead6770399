"""Who runs the setups of a study: processes of this machine, or (cosim.study.running.dask_workers) of many."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing import get_context
from typing import Any, Protocol

from cosim.study.result import FAILED
from cosim.study.running import work
from cosim.study.running.evaluator import Coupling, Row
from cosim.study.study import Study
from eightpost.errors import StepError

#: Chunks that wait for each worker, so that none stands idle.
_AHEAD = 2

#: How often a stop is looked for [s].
_LOOK = 0.2


@dataclass(frozen=True, slots=True)
class Chunk:
    """Setups that are run by one worker, one after the other.

    Args:
        number: Of the chunk.
        indices: Numbers of the setups.
    """

    number: int
    indices: tuple[int, ...]


class Workers(Protocol):
    """Run setups, here or elsewhere."""

    @property
    def count(self) -> int:
        """How many run at once."""

    def choose(self, study: Study) -> Coupling:
        """Choose the coupling of a study."""

    def rows(
        self, study: Study, coupling: Coupling, chunks: Sequence[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run chunks and give their rows as they come, in any order; none is begun once `stop` says so."""

    def close(self) -> None:
        """End the workers."""


class ProcessWorkers:
    """Processes of this machine. One that dies, in an FMU that crashes, takes its one setup with it and no more.

    Args:
        count: How many.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self._pool = self._new_pool()

    def choose(self, study: Study) -> Coupling:
        """Choose the coupling of a study in a worker.

        Raises:
            StepError: No setup could be run, or an FMU crashed.
        """
        try:
            coupling: Coupling = self._submit(work.choose, study.to_json()).result()
            return coupling
        except BrokenProcessPool:
            raise StepError(
                "a worker process died while it chose the coupling: an FMU crashes. Find which with `eightpost check` "
                "and `eightpost run --isolate`, and take it out of the bank"
            ) from None

    def rows(
        self, study: Study, coupling: Coupling, chunks: Sequence[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run chunks and give their rows as they come; none is begun once `stop` says so."""
        text, waiting = study.to_json(), iter(chunks)
        running: dict[Future[list[Row]], Chunk] = {}
        while True:
            room = 0 if stop() else self.count * _AHEAD - len(running)
            running |= {self._submit(work.rows, text, coupling, c.indices): c for c in islice(waiting, room)}
            if not running:
                return
            finished, _ = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED)
            if any(isinstance(future.exception(), BrokenProcessPool) for future in finished):
                yield from self._one_by_one(study, coupling, list(running.values()), stop)
                running.clear()
                continue
            for future in finished:
                yield running.pop(future), future.result()

    def close(self, *, wait: bool = False) -> None:
        """End the workers once what they do is done; `wait` until they have."""
        self._pool.shutdown(wait=wait, cancel_futures=True)

    def _new_pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self.count, mp_context=get_context("spawn"), initializer=work.begin_worker)

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        with _interrupts_held():
            return self._pool.submit(function, *arguments)

    def _one_by_one(
        self, study: Study, coupling: Coupling, chunks: list[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run what was under way when a worker died again, each setup by itself, to know which it was."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool = self._new_pool()
        for chunk in chunks:
            if stop():
                return
            yield chunk, [self._alone(study, coupling, index) for index in chunk.indices]

    def _alone(self, study: Study, coupling: Coupling, index: int) -> Row:
        try:
            row: Row = self._submit(work.rows, study.to_json(), coupling, (index,)).result()[0]
            return row
        except BrokenProcessPool:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = self._new_pool()
            return lost_row(study, index)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back while a process may be begun: it inherits that, and leaves Ctrl-C to this one for good."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def lost_row(study: Study, index: int) -> Row:
    """Return the row of a setup whose worker process died."""
    message = "the worker process died while it ran this setup alone: an FMU of it crashes (eightpost run --isolate)"
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
