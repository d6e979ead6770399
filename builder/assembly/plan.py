"""The plan of an assembly: parts, connections and start values, which are validated on construction."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from builder.assembly.parts import Part
from builder.connection import Ends
from eightpost.errors import FmuError

_RUN = "run it as separate FMUs (eightpost run)"


@dataclass(frozen=True)
class Link(Ends):
    """A connection: target = gain (factor source + offset), in the units of the two variables."""

    gain: float = 1.0
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Assembly:
    """One FMU to build from a vehicle and its shocks.

    Args:
        identifier: C name of the FMU.
        text: One-line description.
        parts: Vehicle and shocks; the vehicle is moved to the front.
        links: Connections between vehicle and shocks.
        sums: Connected inputs to which the host's values are added, as `component.variable`.
        starts: Start values of inputs and parameters that replace those of the parts, as `component.variable`.

    Raises:
        FmuError: The parts cannot be assembled; the message lists each reason.
    """

    identifier: str
    text: str
    parts: tuple[Part, ...]
    links: tuple[Link, ...]
    sums: frozenset[str] = frozenset()
    starts: Mapping[str, float | bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        ordered = sorted(self.parts, key=lambda part: not part.is_vehicle)
        object.__setattr__(self, "parts", tuple(ordered))
        if reasons := list(_reasons(self)):
            raise FmuError("cannot be assembled: " + "; ".join(reasons))

    @property
    def vehicle(self) -> Part:
        """Vehicle, which is the first part."""
        return self.parts[0]

    @property
    def shocks(self) -> tuple[Part, ...]:
        """Shocks, which are all other parts."""
        return self.parts[1:]

    @property
    def signals(self) -> tuple[tuple[Part, str], ...]:
        """Outputs that feed another part: the shocks' forces, then those of the vehicle."""
        sources = {link.source for link in self.links}
        return tuple(
            (part, name)
            for part in (*self.shocks, self.vehicle)
            for name in part.interface.names("output")
            if f"{part.name}.{name}" in sources
        )

    def into(self, part: Part, variable: str) -> tuple[Link, ...]:
        """Return the links to an input, in order."""
        return tuple(link for link in self.links if link.target == f"{part.name}.{variable}")

    def is_outside(self, part: Part, variable: str) -> bool:
        """Return whether an input of a part is an input of the assembly: it is not connected, or it is in `sums`."""
        return not self.into(part, variable) or f"{part.name}.{variable}" in self.sums


def _reasons(assembly: Assembly) -> Iterator[str]:
    yield from _wrong_parts(assembly)
    names = {part.name: part for part in assembly.parts}
    for link in assembly.links:
        yield from _wrong_link(link, names)
    linked = {link.places[0][0] for link in assembly.links}
    for part in assembly.parts:
        if part.name not in linked:
            yield f"no output of {part.name} is connected to another component: connect it with a bond, or remove it"
    yield from _loops(assembly)


def _wrong_parts(assembly: Assembly) -> Iterator[str]:
    vehicles = [part.name for part in assembly.parts if part.is_vehicle]
    if len(vehicles) != 1:
        yield (
            f"there are {len(vehicles)} vehicles ({', '.join(vehicles) or 'none'}), but exactly one is needed: write a "
            "system file for each vehicle with its own shocks"
        )
    if len(vehicles) == len(assembly.parts):
        yield "there is no shock: build the vehicle alone (eightpost build)"
    for part in assembly.parts:
        if not re.fullmatch(r"[A-Za-z_]\w*", part.name, flags=re.ASCII):
            yield (
                f"the component name {part.name!r} cannot be a prefix of variable names: use letters, digits and "
                "underscores, and start with a letter"
            )


def _wrong_link(link: Link, names: Mapping[str, Part]) -> Iterator[str]:
    (source, output), (target, _) = link.places
    what = f"{link.source} -> {link.target}"
    if names[source].is_vehicle == names[target].is_vehicle:
        yield f"{what} does not connect a vehicle and a shock: {_RUN}"
    elif output not in names[source].interface.names("output"):
        yield f"{what}: {link.source} is not an output of its FMU: connect an output, or {_RUN}"


def _loops(assembly: Assembly) -> Iterator[str]:
    """Yield algebraic loops: the vehicle's outputs to the shocks must not have feedthrough from a shock force."""
    part = assembly.parts[0]
    fed = {name for _, (target, name) in (link.places for link in assembly.links) if target == part.name}
    for link in assembly.links:
        (source, output), _ = link.places
        if source == part.name and (direct := sorted(fed & set(part.interface.direct.get(output, ())))):
            yield (
                f"{link.source} -> {link.target} makes an algebraic loop, because {link.source} has feedthrough from "
                f"{', '.join(direct)}: {_RUN} with the implicit algorithm"
            )
