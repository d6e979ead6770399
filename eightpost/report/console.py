"""Tables in a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.table import Column, Table

__all__ = ["Column", "Table", "console_table", "folded", "right", "unbroken"]


def console_table(columns: Iterable[Column | str], *groups: Iterable[Sequence[str]], **options: Any) -> Table:
    """Return a table of texts, which may contain rich's markup.

    Args:
        columns: Headings; `right`, `unbroken` and `folded` return headings of columns with other layouts.
        groups: Groups of rows, with a line between two groups; a row has a text for each column.
        options: Options of rich's table, such as `title`.
    """
    table = Table(*columns, **options)
    for rows in groups:
        for row in rows:
            table.add_row(*row)
        table.add_section()
    return table


def right(*headings: str) -> list[Column | str]:
    """Return columns of numbers, aligned to the right."""
    return [Column(heading, justify="right") for heading in headings]


def unbroken(*headings: str) -> list[Column | str]:
    """Return columns whose texts are not broken into lines."""
    return [Column(heading, no_wrap=True) for heading in headings]


def folded(*headings: str) -> list[Column | str]:
    """Return columns whose long texts are broken at any letter."""
    return [Column(heading, overflow="fold") for heading in headings]
