"""Line numbers of entries in a TOML file, for messages."""

from __future__ import annotations

import re
from collections.abc import Sequence


def line_of(text: str, place: Sequence[str | int]) -> int | None:
    """Return the one-based line of an entry, or the line of its table if the entry itself is not found.

    Args:
        text: Text of the file.
        place: Keys and, for lists of tables, positions: `("measure", 2, "band")`.
    """
    lines, begin = text.splitlines(), 0
    found = None
    for depth, key in enumerate(place):
        if isinstance(key, int):
            continue
        position = place[depth + 1] if depth + 1 < len(place) else None
        at = _nth(lines, key, begin, position if isinstance(position, int) else 0)
        if at is None:
            break
        found = begin = at
    return None if found is None else found + 1


def line_with(text: str, message: str) -> int | None:
    """Return the one-based line that a message refers to: the last quoted name in it that the file contains.

    The text after a semicolon is advice and is ignored.
    """
    lines = text.splitlines()
    for name in reversed(re.findall(r"'([^']+)'", message.partition(";")[0])):
        for number, line in enumerate(lines, start=1):
            if f'"{name}"' in line or f"'{name}'" in line:
                return number
    return None


def _nth(lines: Sequence[str], key: str, begin: int, position: int) -> int | None:
    """Return the line of a key, of a table's header, or of the `position`-th table of a list, from `begin` on."""
    name = rf"(?:\"{re.escape(key)}\"|'{re.escape(key)}'|{re.escape(key)})"
    pattern = re.compile(rf"\s*(?:\[\[?\s*(?:[^\[\]]*\.\s*)?{name}\s*\]|{name}\s*[=.]|.*[{{,]\s*{name}\s*=)")
    found = [k for k in range(begin, len(lines)) if pattern.match(lines[k])]
    if not found:
        return None
    return found[position] if position < len(found) and lines[found[0]].lstrip().startswith("[[") else found[0]
