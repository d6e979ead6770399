"""HTML pages without scripts, as text: the documentation inside an archive, which any browser and tool can read."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files

# ---- Elements -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Column:
    """One column of a table: its heading, and the style of its cells (a class of static.css)."""

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


# ---- The page -------------------------------------------------------------------------------------------------------

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
<header>
<h1>{title}</h1>
<p class="title">{text}</p>
<p>{facts}</p>
</header>
<nav>{contents}</nav>
<figure>
<img{kind} alt="{caption}" src="data:image/png;base64,{picture}">
<figcaption>{caption}</figcaption>
</figure>
{body}</body>
</html>
"""


@dataclass(frozen=True)
class Picture:
    """A PNG, its caption, and its size (a class of static.css)."""

    png: bytes
    caption: str
    style: str = ""


def static_page(
    title: str, text: str, facts: str, places: Iterable[tuple[str, str]], picture: Picture, body: str
) -> str:
    """Return the HTML of a page.

    Args:
        title: Heading of the page.
        text: Description below the heading.
        facts: Line of facts below the description.
        places: Identifier and heading of each section, for the links at the top.
        picture: Picture above the sections.
        body: HTML of the sections.
    """
    return _PAGE.format(
        title=escape(title),
        style=files("eightpost.report").joinpath("templates/static.css").read_text(encoding="utf-8"),
        text=escape(text),
        facts=escape(facts),
        contents="\n".join(f'<a href="#{name}">{escape(heading)}</a>' for name, heading in places),
        kind=f' class="{picture.style}"' if picture.style else "",
        caption=escape(picture.caption),
        picture=base64.b64encode(picture.png).decode(),
        body=body,
    )
