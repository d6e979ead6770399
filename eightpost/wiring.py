"""Wiring of a system of FMUs: what the co-simulation hands to the builder for a package or an assembled FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Wire:
    """A connection: `target = gain (factor source + shift) + offset`, in the units of the two variables.

    Attributes:
        source: Output, as `component.variable`.
        target: Input that it is connected to, as `component.variable`.
        gain: Gain of the connection.
        factor: Factor of the unit conversion.
        shift: Offset of the unit conversion, in the unit of the target.
        offset: Offset of the connection, in the unit of the target.
        convert: Whether the variables have different types.
    """

    source: str
    target: str
    gain: float = 1.0
    factor: float = 1.0
    shift: float = 0.0
    offset: float = 0.0
    convert: bool = False

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
    """FMUs and their connections.

    Attributes:
        name: Name of the system.
        fmus: FMU file of each component.
        wires: Connections, in the order in which the values of a sum are added.
        step: Coupling step that a package proposes [s].
        stop: Duration of a run that a package proposes [s].
        sums: Inputs, as `component.variable`, that add up the values of several sources.
        values: Values of parameters and constant inputs of each component, in the units of its FMU.
    """

    name: str
    fmus: Mapping[str, Path]
    wires: tuple[Wire, ...]
    step: float
    stop: float
    sums: frozenset[str] = frozenset()
    values: Mapping[str, Mapping[str, float | bool | str]] = field(default_factory=dict)
