"""Who runs the setups of a study: processes of this machine, or (cosim.study.running.dask_workers) of many."""

from __future__ import annotations

import os
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
from cosim.study.running.signs import Signs
from cosim.study.study import Study
from eightpost.errors import StepError

#: Chunks that wait for each worker, so that none stands idle.
_AHEAD = 2

#: How often a stop is looked for [s].
_LOOK = 0.2

#: A worker for so many setups is begun while the coupling is still chosen: it takes as long as they do.
_WORTH = 50

#: For how long a worker may give no sign that it gets on [s]: signs come every some thousand coupling steps.
PATIENCE = 300.0

#: What a worker may still take for what it does when nobody waits for it any more [s].
_GRACE = 3.0

_CRASHES = "the worker process died while it ran this setup alone: an FMU of it crashes (eightpost run --isolate)"


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
    """Processes of this machine. One that dies or hangs, in an FMU, takes its one setup with it and no more.

    Args:
        count: How many.
        patience: For how long one may give no sign that it gets on [s]; it is ended then.
    """

    def __init__(self, count: int, *, patience: float = PATIENCE) -> None:
        self.count, self._patience = count, patience
        self._pool, self._signs = self._begin()

    def choose(self, study: Study) -> Coupling:
        """Choose the coupling of a study in a worker, while the others open it.

        Raises:
            StepError: No setup could be run, or an FMU crashed or hung.
        """
        text = study.to_json()
        chosen: Future[Coupling] = self._submit(work.choose, text)
        for _ in range(min(self.count, len(study.space) // _WORTH) - 1):
            self._submit(work.open_study, text)
        hung = self._await(chosen)
        try:
            return chosen.result()
        except BrokenProcessPool:
            what = f"gave no sign for {self._patience:g} s" if hung else "died"
            raise StepError(
                f"a worker process {what} while it chose the coupling: an FMU {'hangs' if hung else 'crashes'}. Find "
                "which with `eightpost check` and `eightpost run --isolate`, and take it out of the bank"
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
            self._signs.end_silent(self._patience)
            if any(isinstance(future.exception(), BrokenProcessPool) for future in finished):
                yield from self._one_by_one(study, coupling, list(running.values()), stop)
                running.clear()
                continue
            for future in finished:
                yield running.pop(future), future.result()

    def close(self, *, wait: bool = False) -> None:
        """End the workers: `wait` until what they do is done, else no longer than it takes to clean up."""
        self._pool.shutdown(wait=wait, cancel_futures=True)
        self._signs.end_working(_GRACE)

    def _begin(self) -> tuple[ProcessPoolExecutor, Signs]:
        context = get_context("spawn")
        signs = Signs(self.count, context)
        pool = ProcessPoolExecutor(
            self.count, mp_context=context, initializer=work.begin_worker, initargs=(os.getpid(), *signs.shared)
        )
        return pool, signs

    def _begin_again(self) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool, self._signs = self._begin()

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        with _interrupts_held():
            return self._pool.submit(function, *arguments)

    def _await(self, future: Future[Any]) -> bool:
        """Wait for a worker's answer, or until one that gives no sign is ended; return whether one was."""
        hung = False
        while not wait([future], timeout=_LOOK).done:
            hung = self._signs.end_silent(self._patience) or hung
        return hung

    def _one_by_one(
        self, study: Study, coupling: Coupling, chunks: list[Chunk], stop: Callable[[], bool]
    ) -> Iterator[tuple[Chunk, list[Row]]]:
        """Run what was under way when a worker died again, each setup by itself, to know which it was."""
        self._begin_again()
        for chunk in chunks:
            if stop():
                return
            yield chunk, [self._alone(study, coupling, index) for index in chunk.indices]

    def _alone(self, study: Study, coupling: Coupling, index: int) -> Row:
        answer: Future[list[Row]] = self._submit(work.rows, study.to_json(), coupling, (index,))
        hung = self._await(answer)
        try:
            return answer.result()[0]
        except BrokenProcessPool:
            self._begin_again()
            return lost_row(study, index, self._hangs if hung else _CRASHES)

    @property
    def _hangs(self) -> str:
        return (
            f"the worker process gave no sign for {self._patience:g} s while it ran this setup alone and was ended: an "
            "FMU of it hangs (eightpost run --isolate), or takes longer than that for some thousand steps"
        )


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


def lost_row(study: Study, index: int, message: str = _CRASHES) -> Row:
    """Return the row of a setup whose worker process died."""
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
