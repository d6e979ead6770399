"""Where in a TOML file something stands, for messages: the reader of the standard library does not say."""

from __future__ import annotations

import re
from collections.abc import Sequence


def line_of(text: str, place: Sequence[str | int]) -> int | None:
    """Return the one-based line of an entry; the line of its table where the entry itself is not found.

    Args:
        text: Of the file.
        place: Keys and, in lists of tables, positions: `("measure", 2, "band")`.
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
    """Return the one-based line of what a message is about: its last name in quotes that the file has too.

    What comes after a semicolon is advice.
    """
    lines = text.splitlines()
    for name in reversed(re.findall(r"'([^']+)'", message.partition(";")[0])):
        for number, line in enumerate(lines, start=1):
            if f'"{name}"' in line or f"'{name}'" in line:
                return number
    return None


def _nth(lines: Sequence[str], key: str, begin: int, position: int) -> int | None:
    """The line of a key, or of the header of the table or of the `position`-th table of a list, from `begin` on."""
    name = rf"(?:\"{re.escape(key)}\"|'{re.escape(key)}'|{re.escape(key)})"
    pattern = re.compile(rf"\s*(?:\[\[?\s*(?:[^\[\]]*\.\s*)?{name}\s*\]|{name}\s*[=.]|.*[{{,]\s*{name}\s*=)")
    found = [k for k in range(begin, len(lines)) if pattern.match(lines[k])]
    if not found:
        return None
    return found[position] if position < len(found) and lines[found[0]].lstrip().startswith("[[") else found[0]
