"""Short displays of results: a few lines in a console, a small table in a notebook."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import NamedTuple

#: Number of characters after which a value in a console is cut.
_WIDTH = 96


class Summary(NamedTuple):
    """Content of a display."""

    title: str  #: Name of the object.
    rows: tuple[tuple[str, str], ...]  #: Pairs of a label and a value; rows with an empty value are left out.

    @classmethod
    def of(cls, title: str, *rows: tuple[str, str]) -> Summary:
        """Return a summary without the rows that have an empty value."""
        return cls(title, tuple(row for row in rows if row[1]))

    def text(self) -> str:
        """Return the title and a line for each row."""
        width = max((len(label) for label, _ in self.rows), default=0)
        return "\n".join([self.title, *(f"  {label:<{width}}  {_cut(value)}" for label, value in self.rows)])

    def html(self) -> str:
        """Return a table with a row for each label."""
        cell = 'style="text-align:left"'
        body = "".join(
            f"<tr><th {cell}>{escape(label)}</th><td {cell}>{escape(value)}</td></tr>" for label, value in self.rows
        )
        return f"<table><caption><b>{escape(self.title)}</b></caption><tbody>{body}</tbody></table>"


class Summarized:
    """Base of results whose `repr` is a short summary; a notebook shows it as a table."""

    __slots__ = ()

    def _summary(self) -> Summary:
        raise NotImplementedError

    def __repr__(self) -> str:
        return self._summary().text()

    def _repr_html_(self) -> str:
        return self._summary().html()


def some(names: Iterable[str], most: int = 5) -> str:
    """Return the first names that fit in a line, and the number of all of them, if there are more.

    >>> some("abcdefg", 3)
    'a, b, c, ... (7)'
    """
    known = list(names)
    shown = known[:most]
    while len(shown) > 1 and len(", ".join(shown)) > _WIDTH - 12:
        shown.pop()
    return ", ".join(known) if len(shown) == len(known) else f"{', '.join(shown)}, ... ({len(known)})"


def _cut(value: str) -> str:
    return value if len(value) <= _WIDTH else f"{value[: _WIDTH - 3]}..."
