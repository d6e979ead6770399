"""Static rules: what an archive and its modelDescription.xml contain, without running the FMU."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from builder.check.rules import Finding, findings
from builder.check.static.archive import contents, entries, exchange_files, terminals
from builder.check.static.binaries import binaries
from builder.check.static.description import capabilities, exchange, identity, structure
from builder.check.static.variables import units_of, variables
from builder.check.static.version3 import build_description, version_3
from builder.check.subject import Subject


def static_findings(subject: Subject) -> Iterator[Finding]:
    """Apply every static rule; if there is no description, apply only the rules for the archive."""
    yield from findings(entries(subject))
    if (description := subject.description) is None:
        return
    for rules in (identity, variables, units_of, structure, capabilities, exchange):
        yield from findings(rules(description))
    for rules_of_files in (binaries, contents, terminals, exchange_files):
        yield from findings(rules_of_files(subject, description))
    if description.fmi == 3:
        yield from findings(chain(version_3(description), build_description(subject, description)))
