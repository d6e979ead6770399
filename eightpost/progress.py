"""Progress of long work, reported to a callback: one signature for every function that has one.

A function that takes a callback either calls it itself, or opens `reported_to`, in which the functions below it divide
their work with `portion` and `parts`. They need no argument for it, as they need none for a log.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import TypeVar

Item = TypeVar("Item")

#: Callback that receives the amount of work done and the total amount, in any unit: shares, steps, setups, files. The
#: amount done never decreases; the total grows if the work turns out to be larger. To end the work, raise
#: KeyboardInterrupt in it.
Progress = Callable[[float, float], None]

#: Minimum time between two reports of the same amount [s].
_INTERVAL = 0.05


class _Report:
    """Share of the work that is done, and the part of it that is being worked on."""

    def __init__(self, progress: Progress) -> None:
        self._progress, self._told, self._since = progress, -1.0, 0.0
        self.low, self.high = 0.0, 1.0

    def tell(self, share: float) -> None:
        """Call the callback if the share has increased by 1 % or some time has passed."""
        now, share = time.monotonic(), max(share, self._told, 0.0)
        is_last = share >= 1.0 > self._told
        if share - self._told < 0.01 and now - self._since < _INTERVAL and not is_last:
            return
        self._told, self._since = share, now
        self._progress(share, 1.0)


_report: ContextVar[_Report | None] = ContextVar("progress", default=None)


def continued(progress: Progress) -> Progress:
    """Return a callback for work whose amount begins at 0 again: what was done before is added to both amounts."""
    before, last = 0.0, 0.0

    def tell(done: float, total: float) -> None:
        nonlocal before, last
        if done < last:
            before += last
        last = done
        progress(before + done, before + total)

    return tell


@contextmanager
def reported_to(progress: Progress | None) -> Iterator[None]:
    """Report the work of the block to a callback: the share done, and 1; without a callback to nobody."""
    if progress is None:
        yield
        return
    report = _Report(progress)
    report.tell(0.0)
    token = _report.set(report)
    try:
        yield
        report.tell(1.0)
    finally:
        _report.reset(token)


@contextmanager
def portion(low: float, high: float) -> Iterator[None]:
    """Take the work of the block as the portion from `low` to `high`, 0 to 1, of the current work."""
    report = _report.get()
    if report is None:
        yield
        return
    outer = report.low, report.high
    size = outer[1] - outer[0]
    report.low, report.high = outer[0] + size * low, outer[0] + size * high
    try:
        yield
        report.tell(report.high)
    finally:
        report.low, report.high = outer


def parts(items: Iterable[Item]) -> Iterator[Item]:
    """Yield the items; each is an equal part of the current work, which is reported as it ends.

    A part may itself be divided.
    """
    known = list(items)
    for number, item in enumerate(known):
        with portion(number / len(known), (number + 1) / len(known)):
            yield item


def advance(done: float, total: float) -> None:
    """Report the amount done of the current part: a callback for functions that take one."""
    report = _report.get()
    if report is not None:
        report.tell(report.low + (report.high - report.low) * min(1.0, done / total if total else 0.0))


def beats(items: Iterable[Item]) -> Iterator[Item]:
    """Yield items, such as the iterations of a search, and report before each that the current part goes on."""
    for item in items:
        beat()
        yield item


def beat() -> None:
    """Report that the current part goes on."""
    report = _report.get()
    if report is not None:
        report.tell(report.low)


class Listener:
    """What long work tells besides its progress; this one tells nobody, and reports progress as `advance` does."""

    def note(self, text: str) -> None:
        """Take a sentence about something that was left out, or differs from what was expected."""

    def say(self, text: str) -> None:
        """Take a sentence about what is computed."""

    def report(self, text: str) -> None:
        """Take a sentence about the workers, such as that one was ended."""

    def work(self, _text: str, _total: float | None = None) -> AbstractContextManager[Progress]:
        """Return the callback for the progress of some work, with its total amount if it is known."""
        return _silent()


@contextmanager
def _silent() -> Iterator[Progress]:
    yield advance
