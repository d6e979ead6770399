"""What the master asks of a component, whether it is an FMU or a function in a test."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

#: Types of variables that are numbers but not Real; enumerations are integers to FMI.
DISCRETE = ("Integer", "Boolean", "Enumeration")


@dataclass(frozen=True, slots=True)
class UnitDefinition:
    """A unit as the component itself defines it: `SI value = factor * value + offset` in the base units given.

    Args:
        name: As the component writes it.
        exponents: Of kg, m, s, A, K, mol, cd, rad; zeros left out.
        factor: To the SI base units.
        offset: To the SI base units.
    """

    name: str
    exponents: Mapping[str, int] = field(default_factory=dict)
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, slots=True)
class Variable:
    """One variable of a component.

    Args:
        name: Of the variable.
        causality: input, output, parameter, local ...
        variability: continuous, tunable, fixed ...
        type: Real, Integer, Boolean, Enumeration or String.
        unit: None where the component states none.
        start: Its default.
        minimum: Least value that it states to accept.
        maximum: Greatest value that it states to accept.
        direct: Of an output: the inputs that it follows without delay.
    """

    name: str
    causality: str
    variability: str = "continuous"
    type: str = "Real"
    unit: UnitDefinition | None = None
    start: float | bool | str | None = None
    minimum: float | None = None
    maximum: float | None = None
    direct: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Capabilities:
    """What a component can do beyond stepping with held inputs."""

    interpolates_inputs: bool = False
    variable_step: bool = True
    state: bool = False


class Component(Protocol):
    """A stepped substructure. Values are in the component's own units, in the order of the names asked for."""

    @property
    def variables(self) -> Mapping[str, Variable]:
        """All variables by name."""

    @property
    def capabilities(self) -> Capabilities:
        """What it can do."""

    @property
    def identity(self) -> str:
        """What tells this component from another of the same name: an FMU's GUID."""

    @property
    def source(self) -> str:
        """Where it came from: an FMU's file name."""

    @property
    def messages(self) -> tuple[str, ...]:
        """What it warned about since it began, each once."""

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """Make ready and enter initialization, with parameters set. Times in s."""

    def end_initialization(self) -> None:
        """Leave initialization: from here on it steps."""

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set inputs; numbers also for what is Integer, Boolean (1 is true) or an enumeration."""

    def set_derivatives(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set the time derivatives of real inputs, for the next step; only where `interpolates_inputs`."""

    def get(self, names: Sequence[str]) -> list[float]:
        """Return variables; numbers also for what is Integer, Boolean (1 is true) or an enumeration."""

    def step(self, time: float, step: float) -> None:
        """Advance from `time` by `step` [s]."""

    def finish(self) -> None:
        """End the run and free what it held. May be called at any time, and twice."""
