"""The HTML elements of the documentation page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape


@dataclass(frozen=True)
class Column:
    """One column of a table: its heading, and the style of its cells (a class of page.css)."""

    heading: str
    style: str = ""


@dataclass(frozen=True)
class Section:
    """One heading of the page and the HTML below it."""

    heading: str
    html: str

    @property
    def name(self) -> str:
        """Anchor of the section on the page."""
        return self.heading.lower().replace(" ", "-")

    def __str__(self) -> str:
        return f'<h2 id="{self.name}">{escape(self.heading)}</h2>\n{self.html}\n'


def table(columns: Sequence[Column], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of text cells without its empty columns."""
    cells = [tuple(row) for row in rows]
    kept = [k for k in range(len(columns)) if any(row[k] for row in cells)]
    head = "".join(_cell("th", columns[k], escape(columns[k].heading)) for k in kept)
    body = "\n".join(
        "<tr>" + "".join(_cell("td", columns[k], _content(columns[k], row[k])) for k in kept) + "</tr>" for row in cells
    )
    return f'<div class="scroll"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>'


def bullets(items: Iterable[str]) -> str:
    """Return a bulleted list of texts; empty if there are no items."""
    lines = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<ul>{lines}</ul>" if lines else ""


def paragraph(text: str) -> str:
    """Return one paragraph of text."""
    return f"<p>{escape(text)}</p>"


def folded(summary: str, html: str) -> str:
    """Return HTML that the reader can expand."""
    return f"<details><summary>{escape(summary)}</summary>\n{html}\n</details>"


def _cell(tag: str, column: Column, html: str) -> str:
    style = f' class="{column.style}"' if column.style else ""
    return f"<{tag}{style}>{html}</{tag}>"


def _content(column: Column, text: str) -> str:
    return f"<code>{escape(text)}</code>" if column.style == "name" else escape(text)
