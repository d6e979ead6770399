"""Heartbeats of workers."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import SpawnContext
from typing import Any

#: Signal that no process can block; on Windows any signal ends a process.
_END = getattr(signal, "SIGKILL", signal.SIGTERM)

#: Interval at which the end of a worker is checked [s].
_POLL = 0.05


class Heartbeats:
    """Heartbeat counters of the workers of one pool, with the time of their last change.

    Args:
        count: Number of workers.
        context: Multiprocessing context of the workers.
    """

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
            time.sleep(_POLL)
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


def heartbeat(_share: float = 0.0) -> None:
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
