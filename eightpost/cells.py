"""CSV cells that are safe in spreadsheets: a text that begins like a formula is preceded by an apostrophe.

A cell such as `=cmd|...` can run a program when a spreadsheet opens the file. Numbers such as -1.5 are not changed.
`plain_cell` removes the apostrophe.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import IO

#: Beginning of a formula, after apostrophes that belong to the text; some spreadsheets also accept full-width signs.
_FORMULA = re.compile("'*[=+\\-@\t\r\n＝＋－＠]")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")
#: A cell within a line that begins like a formula.
_CELLS = re.compile("(?:^|(?<=[,;\t]))(?='*[=+\\-@\r＝＋－＠])([^,;\t]*)")
_QUOTED = frozenset(',;"\t\r\n')


def safe_cell(text: str) -> str:
    """Return a text as a cell that no spreadsheet interprets as a formula.

    >>> safe_cell("=1+1"), safe_cell("-1.5"), safe_cell("-x")
    ("'=1+1", '-1.5', "'-x")
    """
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else text


def plain_cell(cell: str) -> str:
    """Return the original text of a cell written by `safe_cell`.

    >>> plain_cell("'=1+1"), plain_cell("'tis")
    ('=1+1', "'tis")
    """
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell[1:]) else cell


def safe_line(line: str) -> str:
    """Return a line of free text, which a spreadsheet may split into several cells, with each cell made safe."""
    return _CELLS.sub(lambda found: safe_cell(found[1]), line)


def quoted_cell(text: str) -> str:
    """Return a text as a safe cell, quoted if it contains a delimiter (`,`, `;`, tab), a quote or a line break."""
    cell = safe_cell(text)
    return '"' + cell.replace('"', '""') + '"' if _QUOTED & set(cell) else cell


def write_rows(stream: IO[str], rows: Iterable[Sequence[str]], *, end: str = "\n") -> None:
    """Write rows of texts as comma-separated lines; `end` is the line ending."""
    stream.writelines(f"{','.join(map(quoted_cell, row))}{end}" for row in rows)
