"""Progress bars of all verbs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from eightpost.app.show import details, show_text
from eightpost.progress import Listener

Item = TypeVar("Item")

#: Callback that receives the amount done, and the total if it is known only now.
Advance = Callable[..., None]


@contextmanager
def bar(console: Console, text: str, total: float | None = None) -> Iterator[Advance]:
    """Show a progress bar until the block ends.

    Args:
        console: Console of the bar; if it is not a terminal, lines are printed from time to time instead.
        text: Name of the work.
        total: Total amount: a number of items (int), a share (1.0), or None if the work states it itself.

    Yields:
        Callback for the amount done and, optionally, the total.
    """
    if not console.is_terminal:
        yield _Lines(console, text, total)
        return
    amount = TaskProgressColumn() if isinstance(total, float) else MofNCompleteColumn()
    columns = (TextColumn("{task.description}"), BarColumn(), amount, TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(text, total=total)

        def advance(done: float, out_of: float | None = None) -> None:
            progress.update(task, completed=done, total=out_of)

        yield advance


#: Interval of the lines about the progress in a log file [s]; a program that shows them asks for a shorter one.
INTERVAL = float(os.environ.get("EIGHTPOST_PROGRESS", "30"))


class _Lines:
    """Progress as lines with the time that is left, for output that is not a terminal, such as the log of a job.

    Args:
        console: Console of the lines.
        text: Name of the work.
        total: Total amount, as of `bar`.
    """

    def __init__(self, console: Console, text: str, total: float | None) -> None:
        self._console, self._text, self._total = console, text, total
        self._began = self._printed = time.monotonic()
        self._first: float | None = None

    def __call__(self, done: float, out_of: float | None = None) -> None:
        """Print a line if the last one is older than INTERVAL."""
        now = time.monotonic()
        total = self._total if out_of is None else out_of
        if self._first is None:  # what an earlier run completed says nothing about the speed
            self._first, self._began = done, now
        if now - self._printed < INTERVAL or not total:
            return
        self._printed = now
        rate = (done - self._first) / (now - self._began) if now > self._began else 0.0
        left = f", about {_clock((total - done) / rate)} left" if rate > 0.0 else ""
        amount = "" if isinstance(total, float) else f"{done:g} of {total:g}, "
        self._console.print(f"{self._text}: {amount}{done / total:.0%}{left}", highlight=False, soft_wrap=True)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}"


def each(console: Console, items: Iterable[Item], text: str, total: int) -> Iterator[Item]:
    """Yield the items with a progress bar.

    Args:
        console: Console of the bar.
        items: Items, which may be computed one by one.
        text: Name of the work.
        total: Number of items.
    """
    with bar(console, text, total) as advance:
        for done, item in enumerate(items, start=1):
            yield item
            advance(done)


class ConsoleListener(Listener):
    """Listener that prints notes and sentences, with a progress bar for each work.

    Args:
        console: Console.
    """

    def __init__(self, console: Console) -> None:
        self._console = console

    def note(self, text: str) -> None:
        """Print a note."""
        show_text(self._console, f"note {text}", hanging="  ")

    def say(self, text: str) -> None:
        """Print a sentence."""
        show_text(details(self._console), text)

    def report(self, text: str) -> None:
        """Print a note on standard error."""
        show_text(Console(stderr=True), f"note {text}", hanging="  ")

    @contextmanager
    def work(self, text: str, total: float | None = None) -> Iterator[Advance]:
        """Show a progress bar, or the name of work without a total."""
        if total is not None:
            with bar(self._console, text, total) as advance:
                yield advance
            return
        with self._console.status(text) as status:
            yield lambda done, _all=0.0: status.update(f"{done:g} {text}")
