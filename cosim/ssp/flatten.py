"""Nested systems as one flat network of ports, with the conversions of its links."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from cosim.component import UnitDefinition, Variable
from cosim.conversion import Conversion, convert_between
from cosim.ssp.structure import Connector, FmuElement, Link, SystemElement
from eightpost.errors import InputError, WiringError

#: Names of the elements from the top system down; () is the top system.
Path = tuple[str, ...]

#: Kinds that provide values, and kinds that receive them; in SSP 2.0 a local connector can be used as an output.
_OUTWARD = ("output", "calculatedParameter", "local")
_INWARD = ("input", "parameter")


@dataclass(frozen=True)
class Port:
    """Connector, or variable of an FMU, of the element at `path`."""

    path: Path
    name: str

    def __str__(self) -> str:
        """Return its hierarchical name: `inner.lf.force`."""
        return ".".join((*self.path, self.name))


@dataclass(frozen=True)
class Hop:
    """One link of a chain, which ends at `target`."""

    link: Link
    target: Port


def components(system: SystemElement, path: Path = ()) -> Iterator[tuple[Path, FmuElement]]:
    """Yield every FMU with the names of the elements that lead to it."""
    for element in system.elements:
        here = (*path, element.name)
        if isinstance(element, FmuElement):
            yield here, element
        else:
            yield from components(element, here)


def flat_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Return a component name without dots for each path: `inner.lf` is `inner_lf`, with a number if it is taken."""
    names: dict[Path, str] = {}
    for path in sorted(paths, key=len):  # a component of the top system keeps its name
        base = re.sub(r"[.\s]+", "_", "_".join(path))
        taken, count = set(names.values()), 2
        name = base
        while name in taken:
            name, count = f"{base}_{count}", count + 1
        names[path] = name
    return {path: names[path] for path in paths}


def compose(first: Conversion, then: Conversion) -> Conversion:
    """Return the conversion that applies two conversions one after the other."""
    return Conversion(then.factor * first.factor, then.factor * first.offset + then.offset)


class Network:
    """Links of all systems of a description, each with its direction.

    Args:
        top: Top system.
        variables: Variables of each FMU, by path.

    Raises:
        WiringError: A link does not connect an output and an input, an input has two sources, or a name is unknown.
    """

    def __init__(self, top: SystemElement, variables: Mapping[Path, Mapping[str, Variable]]) -> None:
        self._variables = variables
        self.elements: dict[Path, FmuElement | SystemElement] = {(): top}
        self._sources: dict[Port, tuple[Port, Link]] = {}
        self._add(top, ())

    def _add(self, system: SystemElement, path: Path) -> None:
        for element in system.elements:
            here = (*path, element.name)
            self.elements[here] = element
            if isinstance(element, SystemElement):
                self._add(element, here)
        for link in system.links:
            source, target = self._directed(link, path)
            if target in self._sources:
                raise WiringError(
                    f"{link.where}: {target} has two sources ({self._sources[target][0]} and {source}): SSP allows one "
                    "source per input and no sums; remove one connection, or put a summing component between"
                )
            self._sources[target] = source, link

    def _directed(self, link: Link, path: Path) -> tuple[Port, Port]:
        """Return a link's source and target; the direction follows from the kinds of the connectors."""
        ends = [self._end(end, path, link) for end in link.ends]
        sources = [port for port, gives in ends if gives]
        targets = [port for port, gives in ends if not gives]
        if len(sources) != 1:
            kinds = " and ".join(f"{port} ({self.kind(port)})" for port, _ in ends)
            raise WiringError(
                f"{link.where}: connection {link} joins {kinds}, not an output and an input; connect an output to an "
                "input, or a system's connector to one of the same kind inside it"
            )
        return sources[0], targets[0]

    def _end(self, end: tuple[str | None, str], path: Path, link: Link) -> tuple[Port, bool]:
        """Return the port of a link's end, and whether it provides values (seen from inside the system at `path`)."""
        element, name = end
        port = Port(path if element is None else (*path, element), name)
        if port.path not in self.elements:
            known = [p[-1] for p in self.elements if p[:-1] == path and p]
            raise WiringError(
                f"{link.where}: connection {link}: there is no element {element!r}; there are {', '.join(known)}"
            )
        kind = self.kind(port)
        if kind is None:
            raise WiringError(f"{link.where}: connection {link}: there is no connector {port}; correct its name")
        if kind not in _OUTWARD + _INWARD:
            raise WiringError(f"{link.where}: connection {link}: {port} has the unsupported kind {kind!r}")
        return port, kind in (_INWARD if element is None else _OUTWARD)

    def connector(self, port: Port) -> Connector | None:
        """Return the connector of a port; None if the description does not list it."""
        return self.elements[port.path].connectors.get(port.name)

    def variable(self, port: Port) -> Variable | None:
        """Return a port's FMU variable; None for a system's connector."""
        return self._variables.get(port.path, {}).get(port.name)

    def kind(self, port: Port) -> str | None:
        """Return a port's kind: that of the connector or, if none is listed, the causality of the FMU's variable."""
        if (connector := self.connector(port)) is not None:
            return connector.kind
        variable = self.variable(port)
        return None if variable is None else variable.causality

    def unit(self, port: Port) -> UnitDefinition | None:
        """Return a port's unit: the connector's, else the FMU's.

        Raises:
            WiringError: The two contradict each other.
        """
        connector, variable = self.connector(port), self.variable(port)
        stated = None if connector is None else connector.unit
        own = None if variable is None else variable.unit
        if stated is None or own is None or stated.name == own.name:
            return own or stated
        if not _same(stated, own, f"connector {port}"):
            raise WiringError(
                f"{self.elements[port.path].where}: connector {port.name!r} is in [{stated.name}] and the FMU's "
                f"variable in [{own.name}]; give the connector the unit of the variable"
            )
        return own

    def chain(self, target: Port) -> tuple[Port, list[Hop]]:
        """Return the origin of the values of a port, and the links from there to it.

        The origin is an FMU's output, a system's connector without a source, or the port itself.
        """
        hops: list[Hop] = []
        here, seen = target, {target}
        while here in self._sources:
            source, link = self._sources[here]
            hops.append(Hop(link, here))
            if source in seen:
                raise WiringError(f"{link.where}: connection {link} closes a loop of connectors; remove it")
            seen.add(source)
            here = source
        return here, hops[::-1]

    def carry(
        self, unit: UnitDefinition | None, hops: Sequence[Hop], first: Conversion | None = None
    ) -> tuple[Conversion, UnitDefinition | None]:
        """Return the conversion by the links of a chain for a value with a unit, and the unit at the end.

        Args:
            unit: Unit of the values at the start; None if it is not known.
            hops: Links in order.
            first: Conversion to apply before.
        """
        total = first or Conversion()
        for hop in hops:
            there = self.unit(hop.target)
            if not hop.link.suppressed:
                total = compose(total, convert_between(unit, there, f"{hop.link.where}: connection {hop.link}"))
                there = there or unit
            total, unit = compose(total, hop.link.transformation), there
        return total, unit

    def inputs(self) -> Iterator[Port]:
        """Yield every FMU's inputs."""
        for path, variables in self._variables.items():
            yield from (Port(path, v.name) for v in variables.values() if v.causality == "input")

    def fed(self) -> Iterator[Port]:
        """Yield all variables of FMUs at which a link ends."""
        yield from (port for port in self._sources if port.path in self._variables)

    def find(self, name: str, path: Path) -> Port | None:
        """Return the port with a hierarchical name relative to the element at `path`; None if it does not exist."""
        element, port = self.elements[path], Port(path, name)
        if isinstance(element, FmuElement):
            return port if self.variable(port) is not None else None
        if name in element.connectors:
            return port
        for child in element.elements:
            if name.startswith(f"{child.name}."):
                found = self.find(name[len(child.name) + 1 :], (*path, child.name))
                if found is not None:
                    return found
        return None


def _same(first: UnitDefinition, second: UnitDefinition, what: str) -> bool:
    try:
        conversion = convert_between(first, second, what)
    except InputError:
        return False
    return abs(conversion.factor - 1.0) < 1e-9 and abs(conversion.offset) < 1e-9
