"""The two ways a number is shown: US customary units and metric ones."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.study.measures import DISPLAY
from eightpost import units

#: SI unit -> what a race engineer reads; a unit that is not named is shown as it is.
US = {**DISPLAY, "N/m": "lbf/in", "N.s/m": "lbf.s/in"}
METRIC = {"m": "mm", "m/s": "mm/s", "rad": "deg"}


@dataclass(frozen=True, slots=True)
class Shown:
    """A unit on the page and the way to it from SI: `shown = factor * value + offset`."""

    unit: str
    factor: float
    offset: float

    @classmethod
    def of(cls, si: str, unit: str) -> Shown:
        """Return how a quantity in `si` is shown in `unit`."""
        return cls(unit, *units.conversion(si, unit))

    def __call__(self, value: float) -> float:
        """Return a value in the unit shown."""
        return self.factor * value + self.offset


@dataclass(frozen=True, slots=True)
class Scale:
    """An SI unit in both systems.

    Args:
        si: The SI unit; it need not be one that the units module knows, such as that of a user's own measure.
        us: As US customary units show it.
        metric: As metric units show it.
    """

    si: str
    us: Shown
    metric: Shown

    @classmethod
    def of(cls, si: str, display: str = "") -> Scale:
        """Return the scale of an SI unit.

        Args:
            si: The unit.
            display: What a measure asks to be shown in, in US customary units; empty for the house's choice.
        """
        if not units.is_unit(si):
            same = Shown(si, 1.0, 0.0)
            return cls(si, same, same)
        us = display if display and display != si else US.get(si, si)
        return cls(si, Shown.of(si, us), Shown.of(si, METRIC.get(si, si)))
