"""Rules and groups of the check, which rules.txt and groups.txt list, findings, and the report."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import Any

from eightpost import __version__
from eightpost.fmi import FLAGS, function_name


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

    def document(self) -> dict[str, str]:
        """Return the finding as a JSON object (docs/reference/check.md)."""
        rule, level = self.rule, self.rule.level.value
        stated = {"rule": rule.identifier, "level": level, "title": rule.title, "source": rule.source}
        return stated | {"message": self.message, "advice": rule.advice}


@dataclass(frozen=True, slots=True)
class Skipped:
    """A check that was skipped, and the reason."""

    what: str
    reason: str


def _rows(name: str) -> Iterator[list[str]]:
    """Yield the cells of each row of a table beside this module."""
    for line in Path(__file__).with_name(name).read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            yield line.split(" | ")


#: What a check cannot see.
LIMITS = (
    "not seen: whether the model is right, how binaries for other platforms run, and what depends on the date, on the "
    "machine, or on inputs and times other than those of the check"
)

#: All rules by identifier.
RULES = {row[0]: Rule(row[0], Level(row[1]), *row[2:]) for row in _rows("rules.txt")}

#: What a rule or probe says: the identifier of the rule, and what is wrong, or an empty text.
Fault = tuple[str, str]
Faults = Iterable[Fault]


def findings(faults: Faults) -> Iterator[Finding]:
    """Yield a finding for each fault."""
    return (RULES[rule].finding(message) for rule, message in faults if message)


def listed(names: Sequence[str], *, most: int = 6) -> str:
    """Return the first names and the number of further names as text."""
    shown = ", ".join(names[:most])
    return f"{shown} and {len(names) - most} more" if len(names) > most else shown


def some(names: Iterable[str], before: str = "", after: str = "", *, most: int = 6) -> str:
    """Return names between two texts; an empty text if there are no names."""
    known = list(names)
    return f"{before}{listed(known, most=most)}{after}" if known else ""


# ==== Groups of checks. A probe calls the FMU in a process of its own ================================================


@dataclass(frozen=True)
class Group:
    """A group of checks: for probes the module and the rule that a crash breaks, and its description (groups.txt)."""

    module: str
    crash: str
    title: str


GROUPS = {name: Group(*cells) for name, *cells in _rows("groups.txt")}


# ==== FMI 3.0 in the terms of FMI 2.0: names of functions and attributes, and the texts of findings ==================

_TRANSLATIONS = tuple(
    (re.compile(old), new)
    for old, new in (
        *((re.escape(old), new) for new, old in FLAGS.items() if new != "providesDirectionalDerivatives"),
        *_rows("version3.txt"),
    )
)

_SOURCES = {"FMI 2.2": "FMI 3.0 2.4", "FMI 2.3": "FMI 3.0 2.5", "FMI 2.1": "FMI 3.0 2.3", "FMI 4": "FMI 3.0 4"}


def text_in_version_3(text: str) -> str:
    """Return a text about an FMU with the names of FMI 3.0."""
    text = re.sub(r"fmi2(\w+)", lambda found: f"fmi3{function_name(found[1])}", text)
    for pattern, new in _TRANSLATIONS:
        text = pattern.sub(new, text)
    return text


def finding_in_version_3(finding: Finding) -> Finding:
    """Return a finding about an FMU of FMI 3.0 with its names, and with the section of that standard."""
    rule = finding.rule
    told = replace(
        rule, title=text_in_version_3(rule.title), source=_source(rule.source), advice=text_in_version_3(rule.advice)
    )
    return Finding(told, text_in_version_3(finding.message))


def _source(source: str) -> str:
    if "FMI 3.0" in source:
        return source[source.index("FMI 3.0") :]
    if re.match(r"FMI 3(\.|$)", source):
        return "FMI 3.0 3"
    return next((new for old, new in _SOURCES.items() if source.startswith(old)), source)


# ==== The report of a check: applied groups, findings, and their JSON document =======================================

SCHEMA = 1


@dataclass(frozen=True)
class CheckReport:
    """The result of a check of one FMU; the FMU is acceptable if all findings are hints."""

    path: Path  #: FMU file.
    scope: Scope  #: Levels that are reported.
    #: Identification of the FMU: modelName, guid, generationTool, digest of the file and so on.
    identity: Mapping[str, str]
    groups: tuple[str, ...]  #: Names of the groups of checks that were run.
    skipped: tuple[Skipped, ...]  #: Checks that were skipped, with the reason.
    findings: tuple[Finding, ...]  #: Findings.

    @property
    def done(self) -> tuple[str, ...]:
        """Descriptions of the groups of checks that were run."""
        return tuple(GROUPS[group].title for group in self.groups)

    @property
    def acceptable(self) -> bool:
        """Whether all findings are hints."""
        return not any(finding.rule.level.fails for finding in self.findings)

    def of(self, level: Level) -> tuple[Finding, ...]:
        """Return the findings of a level."""
        return tuple(finding for finding in self.findings if finding.rule.level is level)

    def document(self) -> dict[str, Any]:
        """Return the report as a JSON object (docs/reference/check.md)."""
        return {
            "path": str(self.path),
            "identity": dict(self.identity),
            "scope": self.scope.value,
            "acceptable": self.acceptable,
            "counts": {level.value: len(self.of(level)) for level in Level},
            "groups": list(self.groups),
            "done": list(self.done),
            "skipped": [{"what": item.what, "reason": item.reason} for item in self.skipped],
            "findings": [finding.document() for finding in self.findings],
        }


@dataclass(frozen=True)
class NotChecked:
    """A file that could not be checked, and the reason: missing, damaged, not an FMU, or another FMI version."""

    path: Path
    error: str

    @property
    def acceptable(self) -> bool:
        """Always False."""
        return False

    def document(self) -> dict[str, Any]:
        """Return the entry as a JSON object (docs/reference/check.md)."""
        return {"path": str(self.path), "acceptable": self.acceptable, "error": self.error}


def json_document(reports: Sequence[CheckReport | NotChecked]) -> dict[str, Any]:
    """Return the JSON document for several files."""
    return {
        "kind": "check",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "acceptable": all(report.acceptable for report in reports),
        "reports": [report.document() for report in reports],
    }
