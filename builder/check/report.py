"""What a check did to an FMU, what it found, and the same as a JSON document."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from builder.check.groups import GROUPS
from builder.check.rules import Finding, Level, Scope, Skipped
from eightpost import __version__

SCHEMA = 1


@dataclass(frozen=True)
class CheckReport:
    """What was done to an FMU, what was skipped and why, and what was found; acceptable when no finding fails it.

    `identity` says which FMU it was: modelName, guid, generationTool and the file's digest; `groups` are the names of
    the groups of checks that were run.
    """

    path: Path
    scope: Scope
    identity: Mapping[str, str]
    groups: tuple[str, ...]
    skipped: tuple[Skipped, ...]
    findings: tuple[Finding, ...]

    @property
    def done(self) -> tuple[str, ...]:
        """What was done, in words."""
        return tuple(GROUPS[group].title for group in self.groups)

    @property
    def acceptable(self) -> bool:
        """Whether there is nothing but hints."""
        return not any(finding.rule.level.fails for finding in self.findings)

    def of(self, level: Level) -> tuple[Finding, ...]:
        """Return the findings of a level."""
        return tuple(finding for finding in self.findings if finding.rule.level is level)

    def document(self) -> dict[str, Any]:
        """Return the report as it stands in JSON (docs/check.md)."""
        return {
            "path": str(self.path),
            "identity": dict(self.identity),
            "scope": self.scope.value,
            "acceptable": self.acceptable,
            "counts": {level.value: len(self.of(level)) for level in Level},
            "groups": list(self.groups),
            "done": list(self.done),
            "skipped": [{"what": item.what, "reason": item.reason} for item in self.skipped],
            "findings": [_finding(finding) for finding in self.findings],
        }


@dataclass(frozen=True)
class NotChecked:
    """A file that could not be checked, and why: it is missing, damaged, no FMU, or of another FMI version."""

    path: Path
    error: str

    @property
    def acceptable(self) -> bool:
        """It is not."""
        return False

    def document(self) -> dict[str, Any]:
        """Return the entry as it stands in JSON (docs/check.md)."""
        return {"path": str(self.path), "acceptable": self.acceptable, "error": self.error}


def _finding(finding: Finding) -> dict[str, str]:
    return {
        "rule": finding.rule.identifier,
        "level": finding.rule.level.value,
        "title": finding.rule.title,
        "source": finding.rule.source,
        "message": finding.message,
        "advice": finding.advice,
    }


def json_document(reports: Sequence[CheckReport | NotChecked]) -> dict[str, Any]:
    """Return the one JSON document of several files."""
    return {
        "kind": "check",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "acceptable": all(report.acceptable for report in reports),
        "reports": [report.document() for report in reports],
    }
