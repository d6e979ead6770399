"""Wiring of a system of FMUs: what the co-simulation hands to the builder for a package or an assembled FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Wire:
    """A connection: `target = gain (factor source + shift) + offset`, in the units of the two variables."""

    source: str  #: Output, as `component.variable`.
    target: str  #: Input that it is connected to, as `component.variable`.
    gain: float = 1.0  #: Gain of the connection.
    factor: float = 1.0  #: Factor of the unit conversion.
    shift: float = 0.0  #: Offset of the unit conversion, in the unit of the target.
    offset: float = 0.0  #: Offset of the connection, in the unit of the target.
    convert: bool = False  #: Whether the variables have different types.

    @property
    def places(self) -> tuple[tuple[str, str], tuple[str, str]]:
        """Component and variable of the source, then of the target."""
        (from_component, _, output), (to_component, _, into) = self.source.partition("."), self.target.partition(".")
        return (from_component, output), (to_component, into)

    @property
    def line(self) -> tuple[float, float]:
        """Factor and offset of `target = factor source + offset`."""
        return self.gain * self.factor, self.gain * self.shift + self.offset

    @property
    def offset_before_gain(self) -> float:
        """Sum of both offsets, for a form that applies the gain last: `target = gain (factor source + offset)`."""
        return self.shift + self.offset / self.gain


@dataclass(frozen=True)
class Wiring:
    """FMUs and their connections."""

    name: str  #: Name of the system.
    fmus: Mapping[str, Path]  #: FMU file of each component.
    wires: tuple[Wire, ...]  #: Connections, in the order in which the values of a sum are added.
    step: float  #: Coupling step that a package proposes [s].
    stop: float  #: Duration of a run that a package proposes [s].
    sums: frozenset[str] = frozenset()  #: Inputs, as `component.variable`, that add up the values of several sources.
    #: Values of parameters and constant inputs of each component, in the units of its FMU.
    values: Mapping[str, Mapping[str, float | bool | str]] = field(default_factory=dict)
