"""Units: SI inside, the field's units at the rim. pint does the arithmetic.

A *unit* here is its short symbol as FMI and file headers write it: `m/s`, `N.m`, `in/s`, `lbf`.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import pint

from eightpost.errors import UnknownUnitError

if TYPE_CHECKING:
    from numpy.typing import NDArray

Values = TypeVar("Values", float, "NDArray[np.float64]")

_REGISTRY: Any = pint.UnitRegistry(cache_folder=None)
_REGISTRY.define("lbm = pound")

# What headers write and pint reads differently: in this field a pound is a force unless it says lbm.
_SPELLINGS = {
    "lb": "lbf", "lbs": "lbf", "lbsf": "lbf", "#": "lbf", "sec": "s", "secs": "s", "seconds": "s", "msec": "ms",
    "inch": "in", "inches": "in", '"': "in", "ips": "in/s", "in/sec": "in/s", "mm/sec": "mm/s", "m/sec": "m/s",
    "g": "g_0", "g's": "g_0", "gs": "g_0", "c": "degC", "degc": "degC", "°c": "degC", "f": "degF", "degf": "degF",
    "°f": "degF", "°": "deg", "-": "1", "": "1", "newton": "N", "newtons": "N",
    "click": "1", "clicks": "1",
}  # fmt: skip

#: The SI unit in which each kind of channel is held.
SI_UNITS = (
    "m",
    "m/s",
    "m/s2",
    "N",
    "N.m",
    "N/m",
    "N.s/m",
    "kg",
    "kg.m2",
    "rad",
    "rad/s",
    "s",
    "Hz",
    "Pa",
    "W",
    "J",
    "K",
    "1",
)

_QUANTITY = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)")

_BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
_PINT_BASE = {
    "kilogram": "kg", "meter": "m", "second": "s", "ampere": "A", "kelvin": "K", "mole": "mol", "candela": "cd",
    "radian": "rad",
}  # fmt: skip


def _expression(unit: str) -> str:
    """Rewrite a symbol so that pint reads it: `N.m` -> `N*m`, `m/s2` -> `m/s**2`."""
    text = unit.strip()
    text = _SPELLINGS.get(text.lower() if text.lower() in _SPELLINGS and text not in ("C", "F") else text, text)
    # Upper and lower case tell these apart: Nm is a torque here, nm a length.
    text = {"C": "degC", "F": "degF", "Nm": "N.m", "kNm": "kN.m", "Nmm": "N.mm"}.get(text, text)
    text = re.sub(r"\b(lbs|lb)\b(?!m|f)", "lbf", text)
    text = re.sub(r"(?<![\w.])g(?![\w])", "g_0", text)
    text = text.replace("²", "2").replace("³", "3").replace("·", ".").replace("^", "")
    text = re.sub(r"(?<=[A-Za-z)])\s*[.\-]\s*(?=[A-Za-z(])", "*", text)
    text = re.sub(
        r"(?<=[A-Za-z])(\d)",
        r"**\1",
        text.replace("g_0", "standard_gravity").replace("g_n", "standard_gravity"),
    )
    return re.sub(r"(?<=[a-z])\s+(?=[a-z])", "*", text)


@lru_cache(maxsize=512)
def _unit(unit: str) -> Any:
    try:
        if "//" in unit:  # pint reads it as a floor division
            raise ValueError("a doubled slash")
        return _REGISTRY.Unit(_expression(unit)) if _expression(unit) != "1" else _REGISTRY.Unit("")
    except Exception as error:  # pint raises several kinds, and assertion errors from its parser
        known = ", ".join(("m", "mm", "in", "m/s", "in/s", "N", "lbf", "lbf/in", "kg", "lbm", "psi", "s", "ms", "degC"))
        raise UnknownUnitError(f"unknown unit {unit!r}; write it as for example {known}") from error


def is_unit(text: str) -> bool:
    """Say whether `text` can be read as a unit."""
    try:
        _unit(text)
    except UnknownUnitError:
        return False
    return True


def compatible(first: str, second: str) -> bool:
    """Say whether two units have the same dimension."""
    return bool(_unit(first).is_compatible_with(_unit(second)))


def conversion(source: str, target: str) -> tuple[float, float]:
    """Return (factor, offset) so that `target_value = factor * source_value + offset`.

    Raises:
        UnknownUnitError: A unit is not known or the dimensions differ.
    """
    if not compatible(source, target):
        raise UnknownUnitError(f"cannot convert {source!r} to {target!r}: the dimensions differ")
    if _unit(source) == _unit(target):
        return 1.0, 0.0
    zero, one = (float(_REGISTRY.Quantity(value, _unit(source)).to(_unit(target)).magnitude) for value in (0.0, 1.0))
    return one - zero if zero else one, zero


def convert(values: Values, source: str, target: str) -> Values:
    """Convert values (a float or an array) from one unit to another.

    >>> round(convert(1.0, "in/s", "m/s"), 4)
    0.0254
    """
    factor, offset = conversion(source, target)
    return values if (factor, offset) == (1.0, 0.0) else values * factor + offset


def si_unit(unit: str) -> str:
    """Return the SI unit in which a channel given in `unit` is held.

    >>> si_unit("in/s")
    'm/s'
    """
    exponents = si_exponents(unit)
    for candidate in SI_UNITS:
        if si_exponents(candidate) == exponents:
            return candidate
    raise UnknownUnitError(f"no SI unit for {unit!r}: its dimension is not used by this project")


def si_exponents(unit: str) -> dict[str, int]:
    """Return the exponents of the SI base units of `unit`, as an FMI `BaseUnit` element needs them.

    The radian counts as a base unit, as FMI has it.

    >>> si_exponents("N")
    {'kg': 1, 'm': 1, 's': -2}
    """
    return dict(_exponents(unit))


@lru_cache(maxsize=512)
def _exponents(unit: str) -> tuple[tuple[str, int], ...]:
    base = _REGISTRY.Quantity(1.0, _unit(unit)).to_base_units().units
    if unknown := sorted(set(base._units) - set(_PINT_BASE)):
        raise UnknownUnitError(f"no SI unit for {unit!r}: {unknown[0]} is no quantity of this field")
    exponents = {_PINT_BASE[name]: int(power) for name, power in base._units.items()}
    return tuple((name, exponents[name]) for name in _BASE if exponents.get(name))


def si_factor(unit: str) -> float:
    """Return the factor from `unit` to its SI base units.

    >>> si_factor("in")
    0.0254
    """
    return float(_REGISTRY.Quantity(1.0, _unit(unit)).to_base_units().magnitude)


def quantity(text: str) -> tuple[float, str]:
    """Split a value with its unit, as people write it in a file: `70 in`.

    >>> quantity("1.5e6 lbm.in2")
    (1500000.0, 'lbm.in2')

    Raises:
        UnknownUnitError: It does not begin with a number, or the unit is not known.
    """
    match = _QUANTITY.fullmatch(text.strip())
    if match is None:
        raise UnknownUnitError(f"{text!r} is not a value with a unit; write it as for example '70 in'")
    number, unit = match.groups()
    if not unit:
        raise UnknownUnitError(f"{text!r} has no unit; write it as for example '70 in'")
    _unit(unit)
    return float(number), unit
