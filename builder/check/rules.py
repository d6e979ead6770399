"""Rules of the check, which rules.txt lists, their levels, and findings.

A rule of level *error* is a rule of the FMI standard, version 2.0.4 or 3.0. A rule of level *drop-in* covers what the
standard allows but some tools cannot import. A *hint* makes an FMU easier to use.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path


class Level(Enum):
    """Severity of a finding: the first two levels make a check fail."""

    ERROR = "error"
    DROP_IN = "drop-in"
    HINT = "hint"

    @property
    def fails(self) -> bool:
        """Whether a finding of this level makes the FMU not acceptable."""
        return self is not Level.HINT


class Scope(Enum):
    """Levels that are reported: all, or only the rules of the standard."""

    ALL = "all"
    STANDARD = "standard"

    def covers(self, level: Level) -> bool:
        """Return whether findings of a level are reported."""
        return self is Scope.ALL or level is Level.ERROR


@dataclass(frozen=True, slots=True)
class Rule:
    """One requirement or recommendation for an FMU.

    `source` is the section of FMI 2.0.4 that contains the rule, or the problem that occurs in practice; `advice` tells
    the developer of the FMU what to do.
    """

    identifier: str
    level: Level
    title: str
    source: str
    advice: str

    def finding(self, message: str) -> Finding:
        """Return a finding against this rule."""
        return Finding(self, message)


@dataclass(frozen=True, slots=True)
class Finding:
    """One defect of an FMU: the rule that it breaks, and a message with the details."""

    rule: Rule
    message: str


@dataclass(frozen=True, slots=True)
class Skipped:
    """A check that was skipped, and the reason."""

    what: str
    reason: str


def _rules() -> Iterator[Rule]:
    for line in Path(__file__).with_name("rules.txt").read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            identifier, level, *texts = line.split(" | ")
            yield Rule(identifier, Level(level), *texts)


#: All rules by identifier.
RULES = {rule.identifier: rule for rule in _rules()}

#: What static rules say: the identifier of each rule, and what is wrong, or an empty text.
Faults = Iterable[tuple[str, str]]


def findings(faults: Faults) -> Iterator[Finding]:
    """Yield a finding for each fault."""
    return (RULES[rule].finding(message) for rule, message in faults if message)


def listed(names: list[str], *, most: int = 6) -> str:
    """Return the first names and the number of further names as text."""
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown


def some(names: Iterable[str], before: str = "", after: str = "") -> str:
    """Return names between two texts; an empty text if there are no names."""
    known = list(names)
    return f"{before}{listed(known)}{after}" if known else ""
