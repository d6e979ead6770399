"""Tables and errors in a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

from rich.console import Console, ConsoleOptions, RenderResult
from rich.markup import escape
from rich.table import Column, Table

__all__ = ["Column", "Table", "brief", "console_table", "folded", "print_error", "right", "unbroken"]


def console_table(columns: Iterable[Column | str], *groups: Iterable[Sequence[str]], **options: Any) -> Table:
    """Return a table of texts, which may contain rich's markup.

    Args:
        columns: Headings; `right`, `unbroken` and `folded` return headings of columns with other layouts.
        groups: Groups of rows, with a line between two groups; a row has a text for each column.
        options: Options of rich's table, such as `title`.
    """
    table = _Fitting(*columns, **options)
    for rows in groups:
        for row in rows:
            table.add_row(*row)
        table.add_section()
    return table


def print_error(text: str) -> None:
    """Print an error on the standard error output: as one line, or in a terminal wrapped between words."""
    console = Console(stderr=True)
    console.print(f"[bold red]error:[/] {escape(text)}", highlight=False, soft_wrap=not console.is_terminal)


def right(*headings: str) -> list[Column | str]:
    """Return columns of numbers, aligned to the right."""
    return [Column(heading, justify="right") for heading in headings]


def unbroken(*headings: str) -> list[Column | str]:
    """Return columns whose texts are not broken into lines."""
    return [Column(heading, no_wrap=True) for heading in headings]


def folded(*headings: str) -> list[Column | str]:
    """Return columns whose long texts are broken at any letter."""
    return [Column(heading, overflow="fold") for heading in headings]


def brief(table: Table, most: int) -> Table:
    """Return the first rows of a table without lines between its cells."""
    shown = copy(table)
    shown.columns = [replace(column, _cells=column._cells[:most]) for column in table.columns]
    shown.rows = [*map(copy, table.rows[:most])]
    shown.box, shown.pad_edge, shown.collapse_padding, shown.caption = None, False, True, None
    return shown


#: Least number of letters that a column which may be broken needs, unless all its words are shorter.
_ROOM = 8


class _Fitting(Table):
    """A table that breaks every column at any letter where unbroken ones leave no room for the others."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yield the lines of the table."""
        shown = self
        if any(column.no_wrap for column in self.columns) and self._least_width(console) > options.max_width:
            shown = copy(self)
            shown.columns = [replace(column, no_wrap=False, overflow="fold") for column in self.columns]
        yield from Table.__rich_console__(shown, console, options)

    def _least_width(self, console: Console) -> int:
        between = 2 if self.collapse_padding else 3  # a line and the space beside it
        return 1 + sum(between + self._least_width_of(column, console) for column in self.columns)

    def _least_width_of(self, column: Column, console: Console) -> int:
        sizes = [console.measure(text) for text in (column.header, *column.cells)]
        if column.no_wrap:
            return max((size.maximum for size in sizes), default=0)
        return min(max((size.minimum for size in sizes), default=0), _ROOM)
