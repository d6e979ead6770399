"""Texts in CSV tables that spreadsheets show as texts: one that begins like a formula gets an apostrophe before it.

`=cmd|...` in a cell runs a program in a spreadsheet. Numbers stay numbers, -1.5 as well as 1.5; `plain_cell` takes the
apostrophe away again.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import IO

#: How a formula begins, after apostrophes that stand for themselves; some spreadsheets take the wide signs too.
_FORMULA = re.compile("'*[=+\\-@\t\r\n＝＋－＠]")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
#: A cell's begin within a line of several.
_CELLS = re.compile("(?:^|(?<=[,;\t]))(?='*[=+\\-@\r＝＋－＠])([^,;\t]*)")
_QUOTED = frozenset(',;"\t\r\n')


def safe_cell(text: str) -> str:
    """Return a text as a cell that no spreadsheet takes for a formula.

    >>> safe_cell("=1+1"), safe_cell("-1.5"), safe_cell("-x")
    ("'=1+1", '-1.5', "'-x")
    """
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def plain_cell(cell: str) -> str:
    """Return the text that `safe_cell` made a cell of.

    >>> plain_cell("'=1+1"), plain_cell("'tis")
    ('=1+1', "'tis")
    """
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell[1:]) else cell


def safe_line(line: str) -> str:
    """Return a line of free text, in which a spreadsheet may see several cells, with each of them safe."""
    return _CELLS.sub(lambda found: safe_cell(found[1]), line)


def quoted_cell(text: str) -> str:
    """Return a text as a safe cell, in quotes where it holds a delimiter of any country, a quote or a line's end."""
    cell = safe_cell(text)
    return '"' + cell.replace('"', '""') + '"' if _QUOTED & set(cell) else cell


def write_rows(stream: IO[str], rows: Iterable[Sequence[str]], *, end: str = "\n") -> None:
    """Write rows of texts as comma-separated lines; `end` ends each of them."""
    stream.writelines(f"{','.join(map(quoted_cell, row))}{end}" for row in rows)
