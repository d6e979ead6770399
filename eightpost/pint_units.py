"""Conversion factors, exponents and dimensions of units from pint, for units in pint's notation."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import pint

_REGISTRY: Any = pint.UnitRegistry(cache_folder=None)
_REGISTRY.define("lbm = pound")

_BASE = {
    "kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd",
    "radian": "rad",
}  # fmt: skip


@lru_cache(maxsize=1024)
def unit(text: str) -> Any:
    """Return pint's unit. pint raises several types of exceptions if the text is not a unit."""
    return _REGISTRY.Unit(text)


def conversion(source: str, target: str) -> tuple[float, float] | None:
    """Return (factor, offset) of `target_value = factor * source_value + offset`; None if the dimensions differ."""
    first, second = unit(source), unit(target)
    if not first.is_compatible_with(second):
        return None
    if first == second:
        return 1.0, 0.0
    zero, one = (float(_REGISTRY.Quantity(value, first).to(second).magnitude) for value in (0.0, 1.0))
    return one - zero if zero else one, zero


def exponents(text: str) -> dict[str, int]:
    """Return the exponents of the SI base units; base units outside SI have pint's name."""
    base = _REGISTRY.Quantity(1.0, unit(text)).to_base_units().units
    return {_BASE.get(name, name): int(power) for name, power in base._units.items()}


def factor(text: str) -> float:
    """Return the value of one unit in SI base units."""
    return float(_REGISTRY.Quantity(1.0, unit(text)).to_base_units().magnitude)
