"""Tables in a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from rich.box import SIMPLE
from rich.markup import escape
from rich.table import Column, Table

from eightpost.report.tables import ResultTable, cell_text

__all__ = ["SIMPLE", "Column", "Table", "console_table", "folded", "result_table", "right", "unbroken"]


def console_table(columns: Iterable[Column | str], rows: Iterable[Sequence[str]], **options: Any) -> Table:
    """Return a table of texts, which may contain rich's markup.

    Args:
        columns: Headings; `right`, `unbroken` and `folded` return headings of columns with other layouts.
        rows: Rows with a text for each column.
        options: Options of rich's table, such as `title`.
    """
    table = Table(*columns, **options)
    for row in rows:
        table.add_row(*row)
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


def result_table(table: ResultTable) -> Table:
    """Return a table of results in US customary units."""
    columns = [
        Column(escape(heading), justify="right" if numeric else "left", overflow="fold")
        for heading, numeric in zip(table.us_headings, table.numeric, strict=True)
    ]
    return console_table(
        columns,
        ([escape(cell_text(table, k, cell)) for k, cell in enumerate(row)] for row in table.rows),
        title=table.title,
    )
