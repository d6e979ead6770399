"""Signs of life: each worker counts on while it gets on, where the process that called it can see it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import SpawnContext
from typing import Any

#: Signal that no process can hold off; Windows ends a process by any.
_END = getattr(signal, "SIGKILL", signal.SIGTERM)

#: How often it is looked whether a worker has come to its end [s].
_LOOK = 0.05


class Signs:
    """What the workers of one pool say, and since when each has said the same.

    Args:
        count: How many workers there are.
        context: In which they are begun.
    """

    def __init__(self, count: int, context: SpawnContext) -> None:
        self._places = context.Value("q", 0)
        self._processes, self._counts = context.Array("q", count), context.Array("q", count)
        self._seen, self._since = [0] * count, [time.monotonic()] * count

    @property
    def shared(self) -> tuple[Any, Any, Any]:
        """What `take_place` takes in a worker."""
        return self._places, self._processes, self._counts

    def end_silent(self, patience: float) -> bool:
        """End the workers that work and have given no sign for `patience` [s]; return whether there are any."""
        silent = [k for k, since in enumerate(self._silences()) if since > patience]
        self._end(silent)
        return bool(silent)

    def end_working(self, grace: float) -> None:
        """End the workers that are still at work after `grace` [s]: nobody waits for what they do."""
        until = time.monotonic() + grace
        while self._working() and time.monotonic() < until:
            time.sleep(_LOOK)
        self._end(self._working())

    def _working(self) -> list[int]:
        return [k for k, count in enumerate(self._counts[:]) if count > 0]

    def _silences(self) -> list[float]:
        """For how long each worker has given no sign [s]; 0 for one that has nothing to do."""
        now, counts = time.monotonic(), self._counts[:]
        for k, count in enumerate(counts):
            if count <= 0 or count != self._seen[k]:
                self._seen[k], self._since[k] = count, now
        return [now - since for since in self._since]

    def _end(self, places: list[int]) -> None:
        for k in places:
            try:
                os.kill(self._processes[k], _END)
            except OSError:  # it has ended by itself
                continue


class _Place:
    """This worker's place among the signs; its count is negative while it has nothing to do."""

    def __init__(self, places: Any, processes: Any, counts: Any) -> None:
        with places.get_lock():
            self._number, places.value = places.value, places.value + 1
        self._counts, self._count = counts, 0
        processes[self._number] = os.getpid()

    def say(self, working: int) -> None:
        self._count += 1
        self._counts[self._number] = working * self._count


_own: list[_Place] = []


def take_place(places: Any, processes: Any, counts: Any) -> None:
    """Take a place among the signs of a pool: once, as a worker begins."""
    _own[:] = [_Place(places, processes, counts)]


def sign(_share: float = 0.0) -> None:
    """Give a sign of life; where nobody looks, nothing."""
    for place in _own:
        place.say(1)


@contextmanager
def working() -> Iterator[None]:
    """Be at work: from here to the end signs are waited for."""
    sign()
    try:
        yield
    finally:
        for place in _own:
            place.say(-1)
