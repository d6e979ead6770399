"""The report of a check: applied groups, findings, and their JSON document."""

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
            "findings": [_finding(finding) for finding in self.findings],
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


def _finding(finding: Finding) -> dict[str, str]:
    return {
        "rule": finding.rule.identifier,
        "level": finding.rule.level.value,
        "title": finding.rule.title,
        "source": finding.rule.source,
        "message": finding.message,
        "advice": finding.rule.advice,
    }


def json_document(reports: Sequence[CheckReport | NotChecked]) -> dict[str, Any]:
    """Return the JSON document for several files."""
    return {
        "kind": "check",
        "schema": SCHEMA,
        "tool": f"eightpost {__version__}",
        "acceptable": all(report.acceptable for report in reports),
        "reports": [report.document() for report in reports],
    }
