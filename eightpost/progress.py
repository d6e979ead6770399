"""Progress of long work, reported to a callback: one signature for every function that has one.

A function that takes a callback either calls it itself, or opens `reported_to`, in which the functions below it divide
their work with `parts`. They need no argument for it, as they need none for a log.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
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
        if share - self._told < 0.01 and now - self._since < _INTERVAL and share < 1.0:
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


def parts(items: Iterable[Item], weights: Sequence[float] | None = None) -> Iterator[Item]:
    """Yield the parts of the current work, which is reported as each of them ends.

    Args:
        items: Parts of the work; work of a part that is itself divided is a share of it.
        weights: Relative amounts of work of the parts; default: equal.
    """
    known = list(items)
    report = _report.get()
    if report is None:
        yield from known
        return
    low, high = report.low, report.high
    each = weights or [1.0] * len(known)
    total, done = sum(each) or 1.0, 0.0
    try:
        for item, weight in zip(known, each, strict=True):
            report.low = low + (high - low) * done / total
            done += weight
            report.high = low + (high - low) * done / total
            yield item
            report.tell(report.high)
    finally:
        report.low, report.high = low, high


def beat() -> None:
    """Report that the current part goes on, for example in every iteration of a search of unknown length."""
    report = _report.get()
    if report is not None:
        report.tell(report.low)
