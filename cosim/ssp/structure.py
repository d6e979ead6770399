"""What a description says, before any FMU is opened: elements, connectors, links, values, the experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cosim.component import UnitDefinition
from cosim.conversion import Conversion
from cosim.ssp.package import Unpacked

Value = float | int | bool | str


@dataclass(frozen=True)
class Connector:
    """A connector of an element: kind is input, output, parameter ..."""

    name: str
    kind: str
    type: str | None = None
    unit: UnitDefinition | None = None


@dataclass(frozen=True)
class Link:
    """A connection of two connectors of a system or of its elements; the ends tell no direction.

    Args:
        ends: (element, connector) twice; element None for the system itself.
        suppressed: Whether units are left unconverted.
        transformation: `target = factor * source + offset`, after the conversion of units.
        where: The file and system, for messages.
        transforms: Whether the description has a transformation, be it one that changes nothing.
    """

    ends: tuple[tuple[str | None, str], tuple[str | None, str]]
    suppressed: bool
    transformation: Conversion
    where: str
    transforms: bool = False

    def __str__(self) -> str:
        """Return its ends as the description has them."""
        return " -> ".join(f"{element}.{connector}" if element else connector for element, connector in self.ends)


@dataclass(frozen=True)
class Assignment:
    """A value from a parameter set.

    Args:
        name: Of the variable, relative to the element that the set is bound to.
        type: Real, Integer, Boolean, String, Enumeration or Binary.
        value: The value; an enumeration's is the name of the item.
        where: The file, for messages.
        unit: Of the value; None: that of what is set.
        suppressed: Whether units are left unconverted.
        transformation: After the conversion of units.
        items: Of the enumeration, as the file defines it.
    """

    name: str
    type: str
    value: Value
    where: str
    unit: UnitDefinition | None = None
    suppressed: bool = False
    transformation: Conversion = field(default_factory=Conversion)
    items: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class FmuElement:
    """A component that is an FMU."""

    name: str
    connectors: Mapping[str, Connector]
    values: tuple[Assignment, ...]
    path: Path
    where: str
    unpacked: Unpacked | None


@dataclass(frozen=True)
class SystemElement:
    """A system: elements and links among them and its own connectors."""

    name: str
    connectors: Mapping[str, Connector]
    values: tuple[Assignment, ...]
    elements: tuple[FmuElement | SystemElement, ...]
    links: tuple[Link, ...]
    where: str


@dataclass(frozen=True)
class Experiment:
    """What a description says of a run [s]; None where it says nothing."""

    start: float = 0.0
    stop: float | None = None
    step: float | None = None


@dataclass(frozen=True)
class Structure:
    """A description: its top system and its experiment."""

    name: str
    system: SystemElement
    experiment: Experiment
