"""Rules that are checked without running the FMU: small functions of the archive or its description."""

from __future__ import annotations

from collections.abc import Iterator

from builder.check.rules import Finding
from builder.check.static import version3
from builder.check.static.archive import CONTENT_RULES, ENTRY_RULES, TERMINAL_RULES
from builder.check.static.binaries import RULES as BINARY_RULES
from builder.check.static.description import CAPABILITY_RULES, IDENTITY_RULES, STRUCTURE_RULES
from builder.check.static.exchange import EXCHANGE_ARCHIVE_RULES, EXCHANGE_RULES
from builder.check.static.variables import UNIT_RULES, VARIABLE_RULES
from builder.check.subject import Subject


def static_findings(subject: Subject) -> Iterator[Finding]:
    """Apply every static rule; if there is no description, apply only the rules for the archive."""
    for entry_rule in ENTRY_RULES:
        yield from entry_rule(subject)
    if subject.description is None:
        return
    for rule in (
        *IDENTITY_RULES, *VARIABLE_RULES, *UNIT_RULES, *STRUCTURE_RULES, *CAPABILITY_RULES, *EXCHANGE_RULES,
    ):  # fmt: skip
        yield from rule(subject.description)
    for subject_rule in (*BINARY_RULES, *CONTENT_RULES, *TERMINAL_RULES, *EXCHANGE_ARCHIVE_RULES):
        yield from subject_rule(subject)
    if subject.description.fmi == 3:
        for rule in version3.RULES:
            yield from rule(subject.description)
        for subject_rule in version3.ARCHIVE_RULES:
            yield from subject_rule(subject)
