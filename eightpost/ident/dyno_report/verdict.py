"""Verdict of a report: the findings about its records, and the verdicts of its shock files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from eightpost.ident.dyno_report.entry import Entry
from eightpost.verdict import Grade, Reason, Rules, Verdict

RULES = Rules()

PLAUSIBLE = RULES.add("plausible record", "dynamometer record", Grade.USABLE,
    condition="none of the rules about implausible records applies",
    why="the rules find wrong units, reversed signs, changed settings and machines that run down",
)  # fmt: skip
TABLE = RULES.add("table without time", "dynamometer record", Grade.LIMITED,
    condition="a file is a peak-velocity table",
    why="it has no lag, energy, hysteresis or friction, and its plausibility cannot be checked",
    remedy="report the record over time for these figures",
)  # fmt: skip
NO_VERDICT = RULES.add("shock without verdict", "shock", Grade.UNKNOWN,
    condition="a shock file has no section `validity`",
    why="nothing is known about its fit",
    remedy="fit the shock again with this version of eightpost",
)  # fmt: skip


def report_verdict(entries: Iterable[Entry]) -> Verdict:
    """Return the verdict of a report; the origin of each reason begins with the name of its entry."""
    return Verdict(reason for entry in entries for reason in _reasons(entry))


def _reasons(entry: Entry) -> Iterator[Reason]:
    if entry.kind == "table":
        yield TABLE.reason("the file is a peak-velocity table", figure="no time", origin=entry.name)
    elif entry.test is not None:
        yield from (replace(reason, origin=entry.name) for reason in entry.test.reasons)
        if not entry.test.reasons:
            yield PLAUSIBLE.reason("the record is plausible", figure="no finding", origin=entry.name)
    elif entry.shock is not None and entry.shock.validity is None:
        yield NO_VERDICT.reason("the shock file states no verdict", figure="no validity", origin=entry.name)
    elif entry.shock is not None and entry.shock.validity is not None:
        for reason in entry.shock.validity.verdict.reasons:
            yield replace(reason, origin=f"shock {entry.name}")
