"""Nested systems of an SSP package as one network of ports, and its links as connections and bonds."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isclose

from cosim.components.component import DISCRETE, Conversion, UnitDefinition, Variable, convert_between
from cosim.ssp.package import Connector, FmuElement, Link, SystemElement
from cosim.systems.system import Bond, Connection
from eightpost.errors import InputError, WiringError

# ---- Nested systems as one flat network of ports, with the conversions of its links ---------------------------------

#: Names of the elements from the top system down; () is the top system.
SystemPath = tuple[str, ...]

#: Kinds that provide values, and kinds that receive them; in SSP 2.0 a local connector can be used as an output.
_OUTWARD = ("output", "calculatedParameter", "local")
_INWARD = ("input", "parameter")


@dataclass(frozen=True)
class Port:
    """Connector, or variable of an FMU, of the element at `path`."""

    path: SystemPath
    name: str

    def __str__(self) -> str:
        """Return its hierarchical name: `inner.lf.force`."""
        return ".".join((*self.path, self.name))


@dataclass(frozen=True)
class Hop:
    """One link of a chain, which ends at `target`."""

    link: Link
    target: Port


def components(system: SystemElement, path: SystemPath = ()) -> Iterator[tuple[SystemPath, FmuElement]]:
    """Yield every FMU with the names of the elements that lead to it."""
    for element in system.elements:
        here = (*path, element.name)
        if isinstance(element, FmuElement):
            yield here, element
        else:
            yield from components(element, here)


def flat_names(paths: Sequence[SystemPath]) -> dict[SystemPath, str]:
    """Return a component name without dots for each path: `inner.lf` is `inner_lf`, with a number if it is taken."""
    names: dict[SystemPath, str] = {}
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

    Raises:
        WiringError: A link does not connect an output and an input, an input has two sources, or a name is unknown.
    """

    def __init__(self, top: SystemElement, variables: Mapping[SystemPath, Mapping[str, Variable]]) -> None:
        self._variables = variables
        self.elements: dict[SystemPath, FmuElement | SystemElement] = {(): top}
        self._sources: dict[Port, tuple[Port, Link]] = {}
        self._add(top, ())

    def _add(self, system: SystemElement, path: SystemPath) -> None:
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

    def _directed(self, link: Link, path: SystemPath) -> tuple[Port, Port]:
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

    def _end(self, end: tuple[str | None, str], path: SystemPath, link: Link) -> tuple[Port, bool]:
        """Return the port of a link's end, and whether it provides values (seen from inside the system at `path`)."""
        element, name = end
        port = Port(path if element is None else (*path, element), name)
        if port.path not in self.elements:
            children = [p[-1] for p in self.elements if p[:-1] == path and p]
            raise WiringError(
                f"{link.where}: connection {link}: there is no element {element!r}; there are {', '.join(children)}"
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
        variable_unit = None if variable is None else variable.unit
        if stated is None or variable_unit is None or stated.name == variable_unit.name:
            return variable_unit or stated
        if not _same(stated, variable_unit, f"connector {port}"):
            raise WiringError(
                f"{self.elements[port.path].where}: connector {port.name!r} is in [{stated.name}] and the FMU's "
                f"variable in [{variable_unit.name}]; give the connector the unit of the variable"
            )
        return variable_unit

    def chain(self, target: Port) -> tuple[Port, list[Hop]]:
        """Return the origin of the values of a port, and the links from there to it.

        The origin is an FMU's output, a system's connector without a source, or the port itself.

        Raises:
            WiringError: The connections close a loop of connectors.
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

    def find(self, name: str, path: SystemPath) -> Port | None:
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


# ---- Conversion of the network's links between FMUs to connections and bonds of a system ----------------------------


def connections(network: Network, names: Mapping[SystemPath, str]) -> tuple[Connection, ...]:
    """Return a connection for every FMU input that another FMU feeds, through any systems between them.

    Raises:
        WiringError: Values are not numbers, or types or dimensions differ without a transformation.
    """
    found = []
    for target in network.fed():
        origin, hops = network.chain(target)
        if not isinstance(network.elements[origin.path], FmuElement):
            continue  # an open input, or one with a value, is not fed by another component
        source, sink = (_variable(network, port, hops[-1].link.where) for port in (origin, target))
        total, _ = network.carry(network.unit(origin), hops)
        convert = any(hop.link.transforms for hop in hops)
        found.append(_connection(_full(origin, names), _full(target, names), (source, sink), total, convert))
    return tuple(found)


def _full(port: Port, names: Mapping[SystemPath, str]) -> str:
    return f"{names[port.path]}.{port.name}"


def _variable(network: Network, port: Port, where: str) -> Variable:
    variable, connector = network.variable(port), network.connector(port)
    if variable is None:
        raise WiringError(f"{where}: {port}: the FMU has no such variable; correct the connector's name")
    if connector is not None and connector.type not in (None, variable.type):
        raise WiringError(
            f"{where}: connector {port} is a {connector.type}, but the FMU's variable is a {variable.type}; correct "
            "the type"
        )
    if variable.type not in ("Real", *DISCRETE):
        raise WiringError(
            f"{where}: {port} is a {variable.type}: connections carry numbers only; remove the connection and give the "
            "input a value in a parameter set"
        )
    if variable.causality in ("parameter", "calculatedParameter"):
        raise WiringError(
            f"{where}: {port} is a {variable.causality}: parameters are not connected from component to component; "
            "give a value in a parameter set"
        )
    return variable


def _connection(
    source: str, target: str, ends: tuple[Variable, Variable], total: Conversion, convert: bool
) -> Connection:
    """Return the connection that gives `total` together with the master's own conversion of the FMUs' units.

    `convert`: whether the package has a transformation, which permits a connection between Real and another type.
    """
    what = f"{source} -> {target}"
    try:
        own = convert_between(ends[0].unit, ends[1].unit, what)
    except WiringError as error:
        raise WiringError(
            f"{error}; a transformation between dimensions is not supported, put a component between"
        ) from error
    gain = total.factor / own.factor
    is_converted = convert and ends[0].type != ends[1].type
    return Connection(source, target, gain, total.offset - gain * own.offset, convert=is_converted)


def with_bonds(found: tuple[Connection, ...]) -> tuple[tuple[Bond, ...], tuple[Connection, ...]]:
    """Return the bonds among connections, by the names of docs/reference/ports.md, and the other connections.

    A bond is velocity one way and force back between two components, with the same gain. With different gains the power
    at both ends would differ, and the energy residual would be meaningless.
    """
    by_ends = {
        (c.source.rpartition(".")[0], c.target.rpartition(".")[0], _last(c.source)): c
        for c in found
        if _last(c.source) == _last(c.target)
    }
    bonds = []
    for (vehicle, shock, what), velocity in by_ends.items():
        force = by_ends.get((shock, vehicle, "force"))
        if what != "velocity" or force is None or not _alike(velocity, force):
            continue
        travel = by_ends.get((vehicle, shock, "displacement"))
        bonds.append(Bond(vehicle, velocity, force, travel if travel and _alike(velocity, travel) else None))
    used = {connection for bond in bonds for connection in bond.connections}
    return tuple(bonds), tuple(c for c in found if c not in used)


def _alike(first: Connection, second: Connection) -> bool:
    return isclose(first.gain, second.gain, rel_tol=1e-9) and first.offset == second.offset == 0.0


def _last(name: str) -> str:
    return name.rpartition(".")[2]
