"""The tie between a verdict and the numbers that it is about: a digest that a file states beside the verdict."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from eightpost.verdict import Grade, Reason, Rules, Verdict

#: Entry of a file with the digest.
KEY = "judged"

#: Entries of a sealed document that its digest leaves out.
_LEFT_OUT = (KEY, "tool")

RULES = Rules()

EDITED = RULES.add("edited after it was judged", "file", Grade.UNKNOWN,
    condition="the digest beside a verdict (`judged`) is not that of the numbers and of the verdict in the file",
    why="the verdict was about other numbers: those of the fit or of the run",
    remedy="fit, identify or run it again",
)  # fmt: skip


def digest_of(judged: object) -> str:
    """Return the SHA-256 of numbers and texts as 64 hexadecimal digits.

    It is the digest of one canonical text: JSON with sorted keys, without white space, and with the shortest decimal
    number of each double, so that 1 and 1.0 are equal, and 0 and -0.

    Args:
        judged: Mappings, lists, texts and numbers.
    """
    text = json.dumps(_canonical(judged), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _canonical(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _canonical(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_canonical(one) for one in value]
    return float(value) + 0.0 if isinstance(value, (int, float)) and not isinstance(value, bool) else value


def edited(origin: str) -> Verdict:
    """Return the verdict on numbers that are not those that were judged, in a file or model of this name."""
    statement = "edited after the fit or run: its numbers are not those that were judged"
    return Verdict([EDITED.reason(statement, figure=f"its digest differs from the entry {KEY!r}", origin=origin)])


def edits_in(verdict: Verdict) -> tuple[Reason, ...]:
    """Return the reasons of a verdict that say that numbers are not those that were judged."""
    return tuple(reason for reason in verdict.reasons if reason.rule == EDITED.name)


def sealed(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return a document with the digest of all its entries, except for the version of the tool."""
    return {**document, KEY: _digest(document)}


def is_intact(document: Mapping[str, Any]) -> bool:
    """Return whether a document is as it was sealed; true for one that never was, from a version without digests."""
    return document.get(KEY) in (None, _digest(document))


def _digest(document: Mapping[str, Any]) -> str:
    return digest_of({name: value for name, value in document.items() if name not in _LEFT_OUT})
