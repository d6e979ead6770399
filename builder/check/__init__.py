"""Checks of whether any FMU works as a drop-in component in tools that its developers do not know.

`check` applies third-party checkers, the rules of this package, and probes that call the FMU. These run in separate
processes, so that a crash is a finding and does not end the check (docs/reference/check.md).
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from builder.check.rules import (
    GROUPS,
    LIMITS,
    RULES,
    CheckReport,
    Finding,
    Level,
    NotChecked,
    Rule,
    Scope,
    Skipped,
    json_document,
)

CATALOGUE = tuple(RULES.values())

__all__ = [
    "CATALOGUE",
    "GROUPS",
    "LIMITS",
    "CheckReport",
    "Finding",
    "Level",
    "NotChecked",
    "Rule",
    "Scope",
    "Skipped",
    "check",
    "json_document",
]


def check(path: str | Path, *, scope: Scope = Scope.ALL, groups: Collection[str] = tuple(GROUPS)) -> CheckReport:
    """Check an FMU of FMI 2.0 or 3.0.

    Args:
        path: FMU file.
        scope: Levels to report: all, or only the rules of the standard.
        groups: Names of the groups of checks to apply, from `GROUPS`. `simulation` always runs before other groups that
            call the FMU, to make sure that the FMU works.

    Raises:
        FmuError: The file is missing, is not a readable archive, is not an FMU, or is an FMU of FMI 1; or a group is
            unknown.
    """
    from builder.check.run import run  # noqa: PLC0415 - the processes of the probes do not need its imports

    return run(Path(path), scope, groups)
