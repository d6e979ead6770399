"""Protocol of a component for the master, whether it is an FMU or a Python object, and conversion of units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

from eightpost import units
from eightpost.errors import UnknownUnitError, WiringError

# ---- Component ------------------------------------------------------------------------------------------------------

#: Types of variables that are numbers but not Real; enumerations are integers to FMI.
DISCRETE = ("Integer", "Boolean", "Enumeration")


@dataclass(frozen=True, slots=True)
class UnitDefinition:
    """Unit as defined by the component: `SI value = factor * value + offset` in the given base units."""

    name: str  #: Name in the component's description.
    #: Exponents of kg, m, s, A, K, mol, cd, rad; zeros omitted.
    exponents: Mapping[str, int] = field(default_factory=dict)
    factor: float = 1.0  #: Factor to the SI base units.
    offset: float = 0.0  #: Offset to the SI base units.


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable of a component."""

    name: str  #: Name of the variable.
    causality: str  #: input, output, parameter, local ...
    variability: str = "continuous"  #: continuous, tunable, fixed ...
    type: str = "Real"  #: Real, Integer, Boolean, Enumeration or String; Binary, which nothing sets or reads.
    unit: UnitDefinition | None = None  #: Unit; None if the component states none.
    start: float | bool | str | None = None  #: Default value.
    minimum: float | None = None  #: Declared minimum value.
    maximum: float | None = None  #: Declared maximum value.
    direct: frozenset[str] = frozenset()  #: Inputs that an output follows without delay; empty for other variables.


@dataclass(frozen=True, slots=True)
class Capabilities:
    """Abilities of a component beyond stepping with held inputs."""

    interpolates_inputs: bool = False
    variable_step: bool = True
    state: bool = False
    derivatives: bool = False  #: Whether it states how outputs follow inputs without delay.


class Component(Protocol):
    """Component that is stepped. Values are in the component's own units, in the order of the requested names."""

    @property
    def variables(self) -> Mapping[str, Variable]:
        """All variables by name."""

    @property
    def capabilities(self) -> Capabilities:
        """Abilities of the component."""

    @property
    def identity(self) -> str:
        """Identification that distinguishes components of the same name: the FMU's GUID."""

    @property
    def source(self) -> str:
        """Origin of the component: the FMU's file name."""

    @property
    def messages(self) -> tuple[str, ...]:
        """Warnings since the run began, each once."""

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """Begin a run and enter initialization, with parameters set. Times in s."""

    def end_initialization(self) -> None:
        """Leave initialization; steps may follow."""

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set inputs. Integer, Boolean (1 is true) and enumeration values are numbers too."""

    def set_derivatives(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set the time derivatives of real inputs for the next step; only if `interpolates_inputs`."""

    def get(self, names: Sequence[str]) -> list[float]:
        """Return variables. Integer, Boolean (1 is true) and enumeration values are numbers too."""

    def step(self, time: float, step: float) -> None:
        """Advance from `time` by `step` [s]."""

    def finish(self) -> None:
        """End the run and free its resources. It may be called at any time, and twice."""


# ---- Conversion between the units that two components define themselves ---------------------------------------------


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
