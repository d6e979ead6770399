"""Contents of an SSP description before any FMU is opened."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path as PathlibPath

from cosim.components.component import UnitDefinition
from cosim.components.conversion import Conversion
from cosim.ssp.package import Unpacked

Value = float | int | bool | str


@dataclass(frozen=True)
class Connector:
    """Connector of an element; kind is input, output, parameter ..."""

    name: str
    kind: str
    type: str | None = None
    unit: UnitDefinition | None = None


@dataclass(frozen=True)
class Link:
    """Connection of two connectors of a system or its elements; the order of the ends does not show the direction."""

    #: Two pairs (element, connector); element is None for the system itself.
    ends: tuple[tuple[str | None, str], tuple[str | None, str]]
    suppressed: bool  #: Whether unit conversion is suppressed.
    transformation: Conversion  #: Conversion applied after that of units: `target = factor * source + offset`.
    where: str  #: File and system, for messages.
    transforms: bool = False  #: Whether the description has a transformation, even one that changes nothing.

    def __str__(self) -> str:
        """Return the ends as the description writes them."""
        return " -> ".join(f"{element}.{connector}" if element else connector for element, connector in self.ends)


@dataclass(frozen=True)
class Assignment:
    """Value from a parameter set."""

    name: str  #: Name of the variable, relative to the element that the set is bound to.
    type: str  #: Real, Integer, Boolean, String, Enumeration or Binary.
    value: Value  #: Value; for an enumeration the name of the item.
    where: str  #: File, for messages.
    unit: UnitDefinition | None = None  #: Unit of the value; None: that of the variable.
    suppressed: bool = False  #: Whether unit conversion is suppressed.
    transformation: Conversion = field(default_factory=Conversion)  #: Conversion applied after that of units.
    items: Mapping[str, int] = field(default_factory=dict)  #: Items of the enumeration, as the file defines it.


@dataclass(frozen=True)
class FmuElement:
    """Component that is an FMU."""

    name: str
    connectors: Mapping[str, Connector]
    values: tuple[Assignment, ...]
    path: PathlibPath
    where: str
    unpacked: Unpacked | None


@dataclass(frozen=True)
class SystemElement:
    """System with elements, and links between them and its own connectors."""

    name: str
    connectors: Mapping[str, Connector]
    values: tuple[Assignment, ...]
    elements: tuple[FmuElement | SystemElement, ...]
    links: tuple[Link, ...]
    where: str


@dataclass(frozen=True)
class Experiment:
    """Times of the run in a description [s]; None if not stated."""

    start: float = 0.0
    stop: float | None = None
    step: float | None = None


@dataclass(frozen=True)
class Structure:
    """Description: its top system and its experiment."""

    name: str
    system: SystemElement
    experiment: Experiment
