"""Formatting of quantities for readers: in SI and in US customary units."""

from __future__ import annotations

from collections.abc import Sequence

from builder.interface import Variable
from eightpost import units

#: US customary unit that is shown for each SI unit.
CUSTOMARY = {
    "Pa": "psi",
    "K": "degF",
    "m": "in",
    "m/s": "in/s",
    "m/s2": "g",
    "N": "lbf",
    "N.m": "lbf.in",
    "N/m": "lbf/in",
    "N.s/m": "lbf/(in/s)",
    "N.m/rad": "lbf.in/deg",
    "kg": "lbm",
    "kg.m2": "lbm.in2",
    "rad": "deg",
}

Number = int | float


def quantity(value: Number | Sequence[Number], unit: str) -> str:
    """Return a value, or a range of two, with its unit.

    >>> quantity([-0.8, 0.75], "m/s")
    '-0.8 to 0.75 m/s'
    """
    numbers = [value] if isinstance(value, (int, float)) else value
    return f"{' to '.join(f'{number:.4g}' for number in numbers)} {_shown(unit)}".strip()


def customary(value: Number | Sequence[Number], unit: str) -> str:
    """Return a value or a range in US customary units; empty if only the SI unit is shown.

    >>> customary([-0.8, 0.75], "m/s")
    '-31.5 to 29.53 in/s'
    """
    if unit not in CUSTOMARY:
        return ""
    target = CUSTOMARY[unit]
    numbers = [value] if isinstance(value, (int, float)) else value
    return quantity([units.convert(float(number), unit, target) for number in numbers], target)


def start(variable: Variable) -> str:
    """Return a variable's start value in SI, with six digits, without its unit."""
    return "" if variable.start is None else _plain(variable.start)


def displayed_start(variable: Variable) -> str:
    """Return a variable's start value with its display unit; empty if it has no display unit."""
    if variable.unit is None or variable.display is None or variable.start is None:
        return ""
    return quantity(units.convert(float(variable.start), variable.unit, variable.display), variable.display)


def limits(variable: Variable) -> str:
    """Return a variable's range in SI, without its unit."""
    if variable.minimum is None and variable.maximum is None:
        return ""
    low = "−∞" if variable.minimum is None else _plain(variable.minimum)
    high = "∞" if variable.maximum is None else _plain(variable.maximum)
    return f"{low} … {high}"


def _plain(value: float | bool) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:.6g}"


def _shown(unit: str) -> str:
    return "" if unit == "1" else {"degF": "°F", "deg": "°"}.get(unit, unit)
