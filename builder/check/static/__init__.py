"""Rules that are checked without running the FMU: small functions of the archive or its description."""

from __future__ import annotations

from collections.abc import Iterator

from builder.check.rules import Finding
from builder.check.static import (
    archive,
    binaries,
    capabilities,
    contents,
    identity,
    structure,
    terminals,
    units,
    variables,
)
from builder.check.subject import Subject


def static_findings(subject: Subject) -> Iterator[Finding]:
    """Apply every static rule; if there is no description, apply only the rules for the archive."""
    for archive_rule in archive.RULES:
        yield from archive_rule(subject)
    if subject.description is None:
        return
    for module in (identity, variables, units, structure, capabilities):
        for rule in module.RULES:
            yield from rule(subject.description)
    for subject_rule in (*binaries.RULES, *contents.RULES, *terminals.RULES):
        yield from subject_rule(subject)
