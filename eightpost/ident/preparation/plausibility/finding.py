"""Findings about the channels of a rig record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eightpost.verdict import Reason, Rule


@dataclass(frozen=True, slots=True)
class Finding:
    """A fault that the laws of mechanics show."""

    rule: Rule  #: Rule of the verdict.
    channels: tuple[str, ...]  #: Names of the faulty channels.
    text: str  #: Finding as a clause: channel, figure and limit.
    remedy: str  #: Advice on what to do.

    def reason(self, origin: str) -> Reason:
        """Return the finding as a reason of a verdict; `origin` is the name of the record."""
        return self.rule.reason(self.rule.name, figure=self.text, origin=origin, remedy=self.remedy)

    def __str__(self) -> str:
        return f"{self.text}: {self.remedy}"
