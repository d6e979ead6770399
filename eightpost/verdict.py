"""Verdict on whether a result or a model can be used, shared by all commands, files and pages."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Any

from eightpost.errors import InputError

# ---- Verdict --------------------------------------------------------------------------------------------------------
# A verdict is a list of reasons. Each reason has a grade and states its figure, its origin and what to do. The
# verdict's grade is the worst grade among its reasons. Reasons are created by rules, which docs/reference/verdict.md
# lists.


class Grade(StrEnum):
    """Grade of a result or a model, in order from worst to best."""

    NOT_USABLE = "not usable"
    UNKNOWN = "unknown"
    LIMITED = "usable within limits"
    USABLE = "usable"

    @property
    def slug(self) -> str:
        """Name of the CSS class of the grade."""
        return self.value.replace(" ", "-")


#: All grades from worst to best.
ORDER: tuple[Grade, ...] = tuple(Grade)


@dataclass(frozen=True, slots=True)
class Reason:
    """One reason of a verdict.

    Raises:
        InputError: A text is empty.
        ValueError: The grade is unknown.
    """

    rule: str  #: Name of the rule that gave the reason.
    about: str  #: Subject of the reason: coupling, energy, shock, vehicle and so on.
    grade: Grade  #: Grade of this reason alone.
    statement: str  #: Statement of the finding, a clause without a full stop.
    figure: str  #: Value that was found, with its unit and its limit.
    origin: str  #: File, component or step from which the figure comes.
    remedy: str  #: Advice on what to do.

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (isinstance(value, str) and value.strip()):
                raise InputError(f"a verdict's reason: {field.name} must be a non-empty text, not {value!r}")
        object.__setattr__(self, "grade", Grade(self.grade))

    def __str__(self) -> str:
        return f"{self.statement} ({self.figure}; {self.origin})"


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule that creates reasons of a verdict."""

    name: str  #: Unique name of the rule.
    about: str  #: Subject of the reasons.
    grade: Grade  #: Grade of the reasons.
    condition: str  #: Condition under which the rule applies, with the threshold; for docs/reference/verdict.md.
    why: str  #: Justification of the threshold; for docs/reference/verdict.md.
    remedy: str  #: Advice to the user.

    def reason(self, statement: str, *, figure: str, origin: str, remedy: str | None = None) -> Reason:
        """Return a reason; `remedy` replaces the rule's own advice if more specific advice is possible."""
        return Reason(self.name, self.about, self.grade, statement, figure, origin, remedy or self.remedy)


class Rules(list[Rule]):
    """Table of the rules of one area, in the order of their definition; docs/reference/verdict.md lists them."""

    @classmethod
    def read(cls, path: Path, about: str = "", **limits: float | str) -> Rules:
        """Read the rules of a text file: `name | subject | grade`, then `if:`, `why:` and, unless it is nothing, `do:`.

        Names in braces, such as `{largest:g}`, stand for the `limits`. Lines that begin with # are comments.

        Args:
            path: Text file.
            about: Subject of all rules, if their lines do not state it.
            **limits: Numbers and texts by name.
        """
        text = "\n".join(line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
        rules = cls()
        for entry in re.split(r"\n\s*\n", text.strip().format(**limits)):
            head, condition, why, *remedy = re.split(r" (?:if|why|do): ", " ".join(entry.split()))
            name, *subject, grade = head.split(" | ")
            advice = " ".join(remedy) or "nothing"
            rules.append(Rule(name, subject[0] if subject else about, Grade(grade), condition, why, advice))
        return rules

    def named(self, name: str) -> Rule:
        """Return the rule of a name."""
        return next(rule for rule in self if rule.name == name)

    def reason(self, name: str, statement: str, figure: str, origin: str, *, remedy: str | None = None) -> Reason:
        """Return a reason of the rule of a name, with the rule's own advice or a more specific one."""
        return self.named(name).reason(statement, figure=figure, origin=origin, remedy=remedy)


@dataclass(frozen=True)
class Verdict:
    """A list of reasons, worst first; reasons of the same grade keep their order.

    Reasons that differ only in their origins are merged into one reason with all these origins.
    """

    reasons: tuple[Reason, ...] = ()  #: Reasons in any order.

    def __init__(self, reasons: Iterable[Reason] = ()) -> None:
        merged = _merged(reasons)
        object.__setattr__(self, "reasons", tuple(sorted(merged, key=lambda reason: ORDER.index(reason.grade))))

    @classmethod
    def combined(cls, verdicts: Iterable[Verdict]) -> Verdict:
        """Return one verdict with the reasons of several."""
        return cls(reason for verdict in verdicts for reason in verdict.reasons)

    @cached_property
    def grade(self) -> Grade:
        """Worst grade among the reasons; unknown if there are no reasons."""
        return self.reasons[0].grade if self.reasons else Grade.UNKNOWN

    @property
    def is_acceptable(self) -> bool:
        """Whether a command exits with code 0: true for all grades except not usable."""
        return self.grade is not Grade.NOT_USABLE

    @property
    def decisive(self) -> tuple[Reason, ...]:
        """Reasons that have the grade of the verdict."""
        return tuple(reason for reason in self.reasons if reason.grade is self.grade)

    @cached_property
    def grades(self) -> Mapping[str, Grade]:
        """Grade of each subject of the reasons."""
        found: dict[str, Grade] = {}
        for reason in self.reasons:  # worst first
            found.setdefault(reason.about, reason.grade)
        return found

    def about(self, *subjects: str) -> Verdict:
        """Return a verdict with the reasons on the given subjects only."""
        return Verdict(reason for reason in self.reasons if reason.about in subjects)

    def summary(self) -> str:
        """Return one sentence: the grade, the first reason for it, and the subjects with a better grade."""
        return f"{self.headline}: {self.detail}."

    @property
    def headline(self) -> str:
        """Grade with a capital letter, as the beginning of a sentence."""
        return self.grade.value.capitalize()

    @property
    def detail(self) -> str:
        """Rest of the summary: the first reason for the grade, and the subjects with a better grade."""
        if not self.reasons:
            return "nothing was examined"
        first, others = self.decisive[0], len(self.decisive) - 1
        more = f", and {others} more reason{'s' * (others > 1)}" if others else ""
        return f"{first}{more}{self._better()}"

    def _better(self) -> str:
        """Return the subjects with a better grade than the verdict, as the end of a sentence."""
        by_grade: dict[Grade, list[str]] = {}
        for about, grade in self.grades.items():
            if grade is not self.grade:
                by_grade.setdefault(grade, []).append(about)
        return "".join(f"; {grade.value}: {', '.join(by_grade[grade])}" for grade in ORDER if grade in by_grade)

    def to_json(self) -> dict[str, Any]:
        """Return the verdict as a JSON document."""
        return {
            "grade": self.grade.value,
            "summary": self.summary(),
            "reasons": [asdict(reason) for reason in self.reasons],
        }

    @classmethod
    def from_json(cls, document: object) -> Verdict:
        """Return the verdict of a document written by `to_json`; the grade is computed from the reasons.

        Raises:
            InputError: The document is not a verdict.
        """
        from eightpost.schema import checked  # noqa: PLC0415 -- help texts do not need it

        reasons = document.get("reasons") if isinstance(document, Mapping) else None
        return cls(checked(list[Reason], reasons, place="verdict.reasons"))


def listed(names: Iterable[str], most: int = 4) -> str:
    """Return names as a list for an origin: the first `most` names and the number of the others.

    >>> listed("abcdef")
    'a, b, c, d and 2 more'
    """
    known = list(dict.fromkeys(names))
    more = f" and {len(known) - most} more" if len(known) > most else ""
    return ", ".join(known[:most]) + more


def _merged(reasons: Iterable[Reason]) -> list[Reason]:
    origins: dict[Reason, list[str]] = {}
    for reason in reasons:
        found = origins.setdefault(replace(reason, origin="-"), [])
        if reason.origin not in found:
            found.append(reason.origin)
    return [replace(reason, origin=listed(found, most=8)) for reason, found in origins.items()]


# ---- Tie between a verdict and the numbers that it is about: a digest that a file states beside it ------------------

#: Entry of a file with the digest.
KEY = "judged"

#: Entries of a sealed document that its digest leaves out.
_LEFT_OUT = (KEY, "tool")

EDITED = Rule(
    "edited after it was judged", "file", Grade.UNKNOWN,
    condition="the digest beside a verdict (`judged`) is not that of the numbers and of the verdict in the file",
    why="the verdict was about other numbers: those of the fit or of the run",
    remedy="fit, identify or run it again",
)  # fmt: skip

RULES = Rules([EDITED])


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
