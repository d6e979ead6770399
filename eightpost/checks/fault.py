"""Fault of a record, which becomes a reason of its verdict."""

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


def rules_of(kind: str) -> Rules:
    """Return the rules of a kind of record, `dyno` or `rig`, from the table in this folder."""
    names = {"dyno": "dynamometer record", "rig": "rig record"}
    return Rules.read(Path(__file__).with_name(f"{kind}.txt"), names[kind])
