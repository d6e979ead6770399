"""Conversion between the units that two components define themselves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from cosim.components.component import UnitDefinition, Variable
from eightpost import units
from eightpost.errors import UnknownUnitError, WiringError


@dataclass(frozen=True, slots=True)
class Conversion:
    """Linear unit conversion: `target = factor * source + offset`."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, value: float) -> float:
        """Return the value in the target's unit."""
        return self.factor * value + self.offset


def named_unit(name: str) -> UnitDefinition:
    """Return the definition of a unit that this project knows by name."""
    factor, offset = units.conversion(name, units.si_unit(name))
    return UnitDefinition(name, units.si_exponents(name), factor, offset)


def convert_between(source: UnitDefinition | None, target: UnitDefinition | None, what: str) -> Conversion:
    """Return the conversion from one unit to another; the identity if a side states no unit.

    Args:
        source: Unit of the source's values; None if it states none.
        target: Unit of the target's values; None if it states none.
        what: Connection, for the message.

    Raises:
        WiringError: The dimensions differ.
    """
    if source is None or target is None:
        return Conversion()
    source, target = _defined(source), _defined(target)
    if source.exponents != target.exponents:
        raise WiringError(f"{what}: cannot connect [{source.name}] to [{target.name}]: the dimensions differ")
    if (source.factor, source.offset) == (target.factor, target.offset):
        return Conversion()
    return Conversion(source.factor / target.factor, (source.offset - target.offset) / target.factor)


def to_si(variable: Variable) -> tuple[Conversion, str]:
    """Return the conversion of a variable to SI and the SI unit's name; the identity if it states no unit."""
    if variable.unit is None:
        return Conversion(), "1"
    definition = _defined(variable.unit)
    name = _si_name(frozenset(definition.exponents.items()))
    return (Conversion(definition.factor, definition.offset), name) if name else (Conversion(), "1")


@lru_cache(maxsize=256)
def _si_name(exponents: frozenset[tuple[str, int]]) -> str | None:
    """Return the SI unit with these exponents of base units; None if this project knows none."""
    return next((name for name in units.SI_UNITS if frozenset(units.si_exponents(name).items()) == exponents), None)


def _defined(definition: UnitDefinition) -> UnitDefinition:
    """Return the definition; if the component only names a unit, look the name up among the known units."""
    if "?" not in definition.exponents:
        return definition
    try:
        return named_unit(definition.name)
    except UnknownUnitError as error:
        raise WiringError(f"unit {definition.name!r} is neither defined by its component nor known: {error}") from error
