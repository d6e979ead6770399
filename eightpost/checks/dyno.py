"""Rules of the check of a dynamometer record (dyno.txt)."""

from __future__ import annotations

from eightpost.checks.fault import Fault, rules_of

RULES = rules_of("dyno")

#: Names of the rules about a part of a record; they apply to each run on its own.
PART_RULES = frozenset(
    ("the shock changed", "the shock changed a little", "drift", "run-down of the machine", "jump of a channel",
     "clipped channel", "repeated samples")
)  # fmt: skip


def fault(rule: str, statement: str, figure: str, remedy: str = "") -> Fault:
    """Return a fault of a dynamometer record against the rule of a name."""
    return Fault(RULES.named(rule), figure, statement, remedy=remedy)
