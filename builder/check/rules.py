"""What a rule is, how much it weighs, and what is found against it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Level(Enum):
    """How much a finding weighs: the first two make a check fail."""

    ERROR = "error"
    DROP_IN = "drop-in"
    HINT = "hint"

    @property
    def fails(self) -> bool:
        """Whether a finding of this level makes the FMU not acceptable."""
        return self is not Level.HINT


class Scope(Enum):
    """Which levels are reported: all, or only the rules of the standard."""

    ALL = "all"
    STANDARD = "standard"

    def covers(self, level: Level) -> bool:
        """Say whether findings of a level are reported."""
        return self is Scope.ALL or level is Level.ERROR


@dataclass(frozen=True, slots=True)
class Rule:
    """One thing that must hold, or had better hold, for an FMU.

    `source` is the section of FMI 2.0.4 that says so, or what breaks in practice; `advice` is what its maker does.
    """

    identifier: str
    level: Level
    title: str
    source: str
    advice: str

    def finding(self, message: str) -> Finding:
        """Return what was found against this rule."""
        return Finding(self, message)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong with an FMU: against which rule, and what exactly."""

    rule: Rule
    message: str

    @property
    def advice(self) -> str:
        """What to do about it."""
        return self.rule.advice


@dataclass(frozen=True, slots=True)
class Skipped:
    """What was not checked, and why."""

    what: str
    reason: str


def listed(names: list[str], *, most: int = 6) -> str:
    """Return names as people read them: the first ones, and how many more."""
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown
