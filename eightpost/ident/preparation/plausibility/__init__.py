"""Plausibility of rig records: channels that contradict the mechanics of every car, with the fault that explains it."""

from eightpost.ident.preparation.plausibility.check import record_findings
from eightpost.ident.preparation.plausibility.finding import Finding
from eightpost.ident.preparation.plausibility.rules import RULES

__all__ = ["RULES", "Finding", "record_findings"]
