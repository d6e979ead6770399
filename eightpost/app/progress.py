"""Progress bars of all verbs."""

from __future__ import annotations

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

Item = TypeVar("Item")

#: Callback that receives the amount done, and the total if it is known only now.
Advance = Callable[..., None]


@contextmanager
def bar(console: Console, text: str, total: float | None = None) -> Iterator[Advance]:
    """Show a progress bar until the block ends.

    Args:
        console: Console of the bar.
        text: Name of the work.
        total: Total amount: a number of items (int), a share (1.0), or None if the work states it itself.

    Yields:
        Callback for the amount done and, optionally, the total.
    """
    amount = TaskProgressColumn() if isinstance(total, float) else MofNCompleteColumn()
    columns = (TextColumn("{task.description}"), BarColumn(), amount, TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(text, total=total)

        def advance(done: float, out_of: float | None = None) -> None:
            progress.update(task, completed=done, total=out_of)

        yield advance


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
