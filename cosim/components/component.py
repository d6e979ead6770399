"""Protocol of a component for the master, whether it is an FMU or a Python object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

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
