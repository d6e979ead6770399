"""Conversion of SI amounts to the units used in the field."""

from __future__ import annotations

from eightpost.units import conversion

#: Field unit by SI unit; other units are shown unchanged.
_FIELD = {"N": "lbf", "m": "in", "m/s": "in/s", "N/m": "lbf/in", "J": "in.lbf", "N2/Hz": "lbf2/Hz"}

_SQUARED = {"N2/Hz": "N"}


def field_unit(unit: str) -> str:
    """Return the field unit for an SI unit."""
    return _FIELD.get(unit, unit)


def field_factor(unit: str) -> float:
    """Return the factor from an SI unit to its field unit."""
    if unit in _SQUARED:
        return field_factor(_SQUARED[unit]) ** 2
    return conversion(unit, _FIELD[unit])[0] if unit in _FIELD else 1.0


def shown(value: float, digits: int) -> str:
    """Return a number with the given significant digits, without an exponent if that is as short.

    >>> shown(0.123456, 3), shown(1234.5, 3), shown(-2.0, 3)
    ('0.123', '1230', '-2.00')
    """
    text = f"{value:#.{digits}g}"
    if "e" in text and 1.0 <= abs(value) < 1e6:
        text = f"{float(f'{value:.{digits}g}'):.0f}"
    return text.rstrip(".")
