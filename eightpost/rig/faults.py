"""Faults of the records of dynamometers and rigs, and the rules of the check of a dynamometer record (dyno.txt)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from eightpost.verdict import Reason, Rule, Rules


@dataclass(frozen=True, slots=True)
class Fault:
    """The rule that a record breaks, with what was found and what to do."""

    rule: Rule
    figure: str  #: Clause with the channel, its value and the limit.
    statement: str = ""  #: Statement of the reason; empty: the name of the rule.
    channels: tuple[str, ...] = ()  #: Channels that are wrong.
    remedy: str = ""  #: Advice; empty: that of the rule.

    def reason(self, origin: str) -> Reason:
        """Return the fault as a reason of a verdict; `origin` is the name of the record."""
        statement = self.statement or self.rule.name
        return self.rule.reason(statement, figure=self.figure, origin=origin, remedy=self.remedy or None)

    def __str__(self) -> str:
        return f"{self.figure}: {self.remedy or self.rule.remedy}"


RULES = Rules.read(Path(__file__).with_name("dyno.txt"), "dynamometer record")

#: Names of the rules about a part of a record; they apply to each run on its own.
PART_RULES = frozenset(
    ("the shock changed", "the shock changed a little", "drift", "run-down of the machine", "jump of a channel",
     "clipped channel", "repeated samples")
)  # fmt: skip


def fault(rule: str, statement: str, figure: str, remedy: str = "") -> Fault:
    """Return a fault of a dynamometer record against the rule of a name."""
    return Fault(RULES.named(rule), figure, statement, remedy=remedy)
