"""Worker processes that run functions in parallel; one that crashes or hangs is ended."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from eightpost.progress import beat
from eightpost.workers import supervision
from eightpost.workers.process import end_with

# ---- Heartbeats of workers ------------------------------------------------------------------------------------------

#: Signal that no process can block; on Windows any signal ends a process.
_END = getattr(signal, "SIGKILL", signal.SIGTERM)

#: Interval at which the end of a worker that is not needed is checked [s].
_LOOK = 0.05


class _Heartbeats:
    """Heartbeat counters of the workers of one pool, with the time of their last change."""

    def __init__(self, count: int, context: SpawnContext) -> None:
        self._places = context.Value("q", 0)
        self._processes, self._counts = context.Array("q", count), context.Array("q", count)
        self._seen, self._since = [0] * count, [time.monotonic()] * count

    @property
    def shared(self) -> tuple[Any, Any, Any]:
        """Arguments of `register_worker` in a worker."""
        return self._places, self._processes, self._counts

    def end_unresponsive(self, patience: float) -> bool:
        """End the workers that are working and had no heartbeat for `patience` [s]; return whether there were any."""
        silent = [k for k, since in enumerate(self._silences()) if since > patience]
        self._end(silent)
        return bool(silent)

    def end_working(self, grace: float) -> None:
        """End the workers that are still working after `grace` [s], because their results are not needed."""
        until = time.monotonic() + grace
        while self._working() and time.monotonic() < until:
            time.sleep(_LOOK)
        self._end(self._working())

    def _working(self) -> list[int]:
        return [k for k, count in enumerate(self._counts[:]) if count > 0]

    def _silences(self) -> list[float]:
        """Return the time since each worker's last heartbeat [s]; 0 for idle workers."""
        now, counts = time.monotonic(), self._counts[:]
        for k, count in enumerate(counts):
            if count <= 0 or count != self._seen[k]:
                self._seen[k], self._since[k] = count, now
        return [now - since for since in self._since]

    def _end(self, places: list[int]) -> None:
        for k in places:
            try:
                os.kill(self._processes[k], _END)
            except OSError:  # the process has already ended
                continue


class _Slot:
    """Slot of this worker in the heartbeat counters; its count is negative while the worker is idle."""

    def __init__(self, places: Any, processes: Any, counts: Any) -> None:
        with places.get_lock():
            self._number, places.value = places.value, places.value + 1
        self._counts, self._count = counts, 0
        processes[self._number] = os.getpid()

    def beat(self, working: int) -> None:
        self._count += 1
        self._counts[self._number] = working * self._count


_own: list[_Slot] = []


def register_worker(places: Any, processes: Any, counts: Any) -> None:
    """Register this worker in the counters of its pool; called once when a worker starts."""
    _own[:] = [_Slot(places, processes, counts)]


def heartbeat(_done: float = 0.0, _total: float = 1.0) -> None:
    """Report that this worker is alive; no effect outside a worker."""
    for slot in _own:
        slot.beat(1)


@contextmanager
def working() -> Iterator[None]:
    """Mark this worker as working within the context: heartbeats are expected until its end."""
    heartbeat()
    try:
        yield
    finally:
        for slot in _own:
            slot.beat(-1)


# ---- The pool -------------------------------------------------------------------------------------------------------

#: Interval at which a worker's heartbeat is checked [s].
POLL = 0.1

#: Time that working processes get to finish when their results are not needed any more [s].
_GRACE = 3.0


class Pool:
    """Worker processes of this machine. If one crashes or hangs, all calls in progress fail with BrokenProcessPool.

    A working process without a heartbeat for `patience` [s] is ended.
    """

    def __init__(self, count: int, patience: float) -> None:
        self.count, self.patience = count, patience
        self._pool, self._heartbeats = self._start()

    def submit(self, function: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Call a function in a worker; the function and its arguments must be picklable."""
        with _interrupts_blocked():
            return self._pool.submit(function, *arguments)

    def end_unresponsive(self) -> bool:
        """End the workers without a heartbeat; return whether there were any."""
        return self._heartbeats.end_unresponsive(self.patience)

    def wait_for(self, future: Future[Any]) -> bool:
        """Wait for a call; if its worker is not responding, end it. Return whether one was ended."""
        hung = False
        while not wait([future], timeout=POLL).done:
            beat()
            hung = self.end_unresponsive() or hung
        return hung

    def restart(self) -> None:
        """Start new workers after a crash."""
        self._pool.shutdown(wait=True, cancel_futures=True)
        self._pool, self._heartbeats = self._start()

    def close(self, *, wait: bool = False) -> None:
        """End the workers, after their current work if `wait`, else after a short time for cleaning up."""
        self._pool.shutdown(wait=wait, cancel_futures=True)
        self._heartbeats.end_working(_GRACE)

    def _start(self) -> tuple[ProcessPoolExecutor, _Heartbeats]:
        context = _Context()
        heartbeats = _Heartbeats(self.count, context)
        pool = ProcessPoolExecutor(
            self.count, mp_context=context, initializer=_start_worker, initargs=(os.getpid(), *heartbeats.shared)
        )
        return pool, heartbeats


class _Worker(SpawnProcess):
    """Process that does not run the file of the user's program: workers need none of it.

    Without this, a program that starts a study outside `if __name__ == "__main__"` would start it in every worker too.
    """

    @staticmethod
    def _Popen(process_obj: Any) -> Any:  # noqa: N802 -- name of the base class
        main = vars(sys.modules["__main__"])
        hidden = {name: main.pop(name, None) for name in ("__file__", "__spec__")}
        main["__spec__"] = None
        try:
            return SpawnProcess._Popen(process_obj)
        finally:
            main.update({name: value for name, value in hidden.items() if value is not None})


class _Context(SpawnContext):
    """Context of the workers."""

    Process = _Worker


def _start_worker(parent: int, *heartbeats: Any) -> None:
    """Initialise a worker: register its heartbeat, end it with its parent, and leave Ctrl-C to the parent."""
    end_with(parent)
    supervision.is_worker = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    register_worker(*heartbeats)


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    """Block Ctrl-C while a process may be started: the process inherits this and leaves Ctrl-C to its parent."""
    if sys.platform == "win32":
        yield
    else:
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
