"""Reproduction of the dissertation's figures, tables and equations, with the printed values beside ours.

`printed/` has the inventory and the printed values of each chapter, `chapter_*.py` the computations. `eightpost
reproduce` writes them on one page; docs/evidence/equations.md lists where equations are implemented.
"""

from dissertation.effort import FULL, QUICK, Effort
from dissertation.findings import Comparison, Findings, Outcome, State
from dissertation.item import Basis, Item, Kind, chosen, inventory
from dissertation.reproduction import reproduce

__all__ = [
    "FULL",
    "QUICK",
    "Basis",
    "Comparison",
    "Effort",
    "Findings",
    "Item",
    "Kind",
    "Outcome",
    "State",
    "chosen",
    "inventory",
    "reproduce",
]
