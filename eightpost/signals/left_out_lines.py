"""Lines of a text table that are left out with a note: comments among the samples, a last sample that was cut off."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from eightpost.signals.column_headers import is_number

# ---- Comments -------------------------------------------------------------------------------------------------------

_COMMENT = re.compile(r"\s*(?:#|%|//)")

#: Maximum number of characters of a comment in a note.
_SHOWN = 60


def without_comments(lines: Sequence[str], split: Callable[[str], list[str]]) -> tuple[list[str], list[int]]:
    """Return lines in which comments between two lines of numbers are empty, and the indices of these comments.

    A comment with as many cells as the numbers around it may be a header, and is kept.

    Args:
        lines: Lines of a file.
        split: Function that returns the cells of a line.
    """
    found: list[int] = []
    kept = list(lines)
    for i in (i for i, line in enumerate(lines) if _COMMENT.match(line)):
        before, after = _neighbour(lines, i, -1), _neighbour(lines, i, 1)
        if not before or not after:
            continue
        cells = [split(line) for line in (before, lines[i], after)]
        if all(sum(map(is_number, row)) > 1 for row in (cells[0], cells[2])) and len(cells[1]) < len(cells[0]):
            found.append(i)
            kept[i] = ""
    return kept, found


def _neighbour(lines: Sequence[str], start: int, step: int) -> str:
    """Return the next line that is not empty and not a comment; empty at the end of the file."""
    place = start + step
    while 0 <= place < len(lines) and (not lines[place].strip() or _COMMENT.match(lines[place])):
        place += step
    return lines[place] if 0 <= place < len(lines) else ""


def comment_note(lines: Sequence[str], places: Sequence[int]) -> str:
    """Return a note on comments at the indices `places` of a file's lines."""
    first = lines[places[0]].strip()
    shown = first if len(first) <= _SHOWN else f"{first[:_SHOWN]}..."
    return (
        f"{len(places)} comment lines among the samples were left out, the first is line {places[0] + 1}: {shown!r}; "
        "if it states a change of the test, fit the parts alone (--segment)"
    )


# ---- A sample that was cut off --------------------------------------------------------------------------------------

_DIGITS = re.compile(r"[^eE]*?(?:[.,](?P<decimals>\d*))?(?:[eE][+-]?(?P<exponent>\d*))?")

#: Minimum number of rows of a table whose last row can be judged; peak-velocity tables are shorter.
_FEWEST_ROWS = 50

#: Share of the numbers that may have even fewer digits: programs leave out zeros at the end.
_RARE = 0.01

#: A short number at the end is cut off if it is this many times farther from its predecessors' line than any other.
_FAR = 2.0


def is_cut_off(cells: Sequence[str], *, has_end: bool) -> bool:
    """Return whether the last number of a file was cut off: it has fewer digits than all numbers above it.

    If the file ends with a line end, only a change of a fixed number of decimals counts, because the program that
    wrote the file ended it. Without one, the digits of an exponent count too, and so does the value of a number with
    few digits: it is cut off if it is at least twice as far from the line through its two predecessors as any other.

    Args:
        cells: Last cell of each row.
        has_end: Whether the last line has a line end.
    """
    if len(cells) < _FEWEST_ROWS or not is_number(cells[-1]):
        return False
    above = np.sort([_digits(cell) for cell in cells[:-1]], axis=0)
    decimals, exponent = _digits(cells[-1])
    least, most = above[0 if has_end else round(_RARE * len(above))], above[-1]
    if decimals < least[0] and (not has_end or least[0] == most[0]):
        return True
    if has_end:
        return False
    return exponent < least[1] or _is_off(cells)


def _digits(cell: str) -> tuple[int, int]:
    """Return the number of decimals and of the digits of the exponent."""
    match = _DIGITS.fullmatch(cell)
    return (len(match["decimals"] or ""), len(match["exponent"] or "")) if match else (0, 0)


def _is_off(cells: Sequence[str]) -> bool:
    """Return whether the last number has few digits and is far from the line through the two above it."""
    sizes = [_significant(cell) for cell in cells]
    if sizes[-1] >= max(sizes[-2], np.median(sizes)):
        return False
    try:
        values = np.array([float(cell.replace(",", ".")) for cell in cells])
    except ValueError:
        return False
    bends = np.abs(np.diff(values, 2))
    return bool(bends[-1] > _FAR * bends[:-1].max())


def _significant(cell: str) -> int:
    """Return the number of digits of a number without its exponent and without zeros in front."""
    return len(re.sub(r"[eE].*|\D", "", cell).lstrip("0"))


CUT_NOTE = (
    "the last sample (line {line}) was left out: its last number {cell!r} has fewer digits than the others, so the "
    "file is probably not complete; export it again"
)
