"""Rules of the check of a rig record (rig.txt)."""

from __future__ import annotations

from eightpost.checks.fault import Fault, rules_of

RULES = rules_of("rig")


def fault(rule: str, channels: tuple[str, ...], figure: str, remedy: str = "") -> Fault:
    """Return a fault of channels of a rig record against the rule of a name."""
    return Fault(RULES.named(rule), figure, channels=channels, remedy=remedy)
