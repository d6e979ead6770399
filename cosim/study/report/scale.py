"""Display units of the page: US customary and metric."""

from __future__ import annotations

from dataclasses import dataclass

from cosim.study.measures import DISPLAY
from eightpost import units

#: US customary unit by SI unit, as race engineers use it; other units are shown unchanged.
US = {**DISPLAY, "N/m": "lbf/in", "N.s/m": "lbf.s/in"}
METRIC = {"m": "mm", "m/s": "mm/s", "rad": "deg"}


@dataclass(frozen=True, slots=True)
class Shown:
    """Display unit and its conversion from SI: `shown = factor * value + offset`."""

    unit: str
    factor: float
    offset: float

    @classmethod
    def of(cls, si: str, unit: str) -> Shown:
        """Return the conversion from the SI unit `si` to `unit`."""
        return cls(unit, *units.conversion(si, unit))

    def __call__(self, value: float) -> float:
        """Return a value in SI converted to the display unit."""
        return self.factor * value + self.offset


@dataclass(frozen=True, slots=True)
class Scale:
    """Display units of an SI unit in both systems.

    Args:
        si: SI unit; the unit of a user-defined measure may be unknown to the units module and is then shown unchanged.
        us: US customary display unit.
        metric: Metric display unit.
    """

    si: str
    us: Shown
    metric: Shown

    @classmethod
    def of(cls, si: str, display: str = "") -> Scale:
        """Return the scale of an SI unit.

        Args:
            si: SI unit.
            display: US customary unit that the measure asks for; empty for the default of `US`.
        """
        if not units.is_unit(si):
            same = Shown(si, 1.0, 0.0)
            return cls(si, same, same)
        us = display if display and display != si else US.get(si, si)
        return cls(si, Shown.of(si, us), Shown.of(si, METRIC.get(si, si)))
