"""Is an FMU, ours or not, fit to be dropped into a tool that none of us has seen?

`check` applies other makers' checkers, rules of our own, and probes that call the FMU in processes of their own, so
that a crash is a finding and not the end of the check (docs/check.md).
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from builder.check.catalogue import CATALOGUE
from builder.check.groups import GROUPS
from builder.check.report import CheckReport, NotChecked, json_document
from builder.check.rules import Finding, Level, Rule, Scope, Skipped

__all__ = [
    "CATALOGUE",
    "GROUPS",
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
    """Check an FMI 2.0 co-simulation FMU.

    Args:
        path: The FMU.
        scope: All levels, or only the rules of the standard.
        groups: Which of `GROUPS` to apply; those that call the FMU need `simulation` only to be sure that it runs.

    Raises:
        FmuError: The file is missing or no readable archive, is no FMU, or of FMI 1 or 3; or a group is not known.
    """
    from builder.check.run import run  # noqa: PLC0415 - the probes' processes need none of what it loads

    return run(Path(path), scope, groups)
