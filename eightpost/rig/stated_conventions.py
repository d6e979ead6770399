"""Signs and units that the lines above a table state for whole channels: `extension positive`, `Force units: lbf`."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, TypeVar

from eightpost.errors import FileFormatError
from eightpost.rig.dyno_columns import is_named
from eightpost.rig.dyno_conditions import pairs

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

Name = TypeVar("Name")

_SIDES = {
    "compression": r"compress\w*|bump|jounce|push\w*",
    "rebound": r"rebound|exten\w*|droop|tension|tensile|pull\w*",
}
_SIGNS = {"positive": r"positive|\+ve|\+(?!\s*[\d.])", "negative": r"negative|-ve|\(-\)"}
_CHANNELS = {
    ("force",): r"force|load",
    ("displacement", "velocity"): r"displacement|position|travel|stroke|motion|velocity|speed",
}
#: Largest number of words of a clause that states a sign.
_WORDS = 8


def reversed_channels(preamble: Iterable[tuple[str, ...]], path: Path) -> tuple[dict[str, bool], str]:
    """Return whether each channel with a stated sign is positive in rebound, and the statement.

    A clause names one stroke and a sign (`extension positive`, `force: negative in rebound`). It is about the force or
    the motion if it names one of them, else about all channels that no other clause names.

    Raises:
        FileFormatError: Two clauses contradict each other.
    """
    found: dict[str, bool] = {}
    general: set[bool] = set()
    statements = []
    for clause in (part for cells in preamble for cell in cells for part in re.split(r"[,;|]|\band\b", cell)):
        sides, signs = _words_in(clause, _SIDES), _words_in(clause, _SIGNS)
        if len(sides) != 1 or len(signs) != 1 or len(clause.split()) > _WORDS:
            continue
        statements.append(clause.strip())
        is_reversed = (sides == ["rebound"]) == (signs == ["positive"])
        channels = [name for names in _words_in(clause, _CHANNELS) for name in names]
        general |= set() if channels else {is_reversed}
        if len(general) > 1 or any(found.setdefault(name, is_reversed) != is_reversed for name in channels):
            what = f"its sign conventions contradict each other: {'; '.join(statements)}; delete the wrong one"
            raise FileFormatError(what, path=path)
    everywhere = dict.fromkeys(("displacement", "velocity", "force"), *general) if general else {}
    return everywhere | found, "; ".join(statements)


def _words_in(clause: str, patterns: Mapping[Name, str]) -> list[Name]:
    return [name for name, words in patterns.items() if re.search(rf"(?<!\w)(?:{words})(?!\w)", clause, re.IGNORECASE)]


def stated_units(preamble: Iterable[tuple[str, ...]]) -> dict[str, str]:
    """Return the units of channels from lines such as `Displacement units: in`."""
    found: dict[str, str] = {}
    for key, value in (pair for cells in preamble for pair in pairs(cells)):
        if match := re.fullmatch(r"(.*\S)[\s_]+units?", key, re.IGNORECASE):
            for channel in ("time", "velocity", "force", "displacement", "temperature"):
                if is_named(match[1].split()[-1], channel):
                    found.setdefault(channel, value)
    return found
