"""Conversion of the network's links between FMUs to connections and bonds of a system."""

from __future__ import annotations

from collections.abc import Mapping
from math import isclose

from cosim.component import DISCRETE, Variable
from cosim.conversion import Conversion, convert_between
from cosim.ssp.flatten import Network, Path, Port
from cosim.ssp.structure import FmuElement
from cosim.system import Bond, Connection
from eightpost.errors import WiringError


def connections(network: Network, names: Mapping[Path, str]) -> tuple[Connection, ...]:
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


def _full(port: Port, names: Mapping[Path, str]) -> str:
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
    """Return the bonds among connections, by the names of docs/ports.md, and the other connections.

    A bond is velocity one way and force back between two components, with the same gain. With different gains the power
    at both ends would differ, and the energy residual would be meaningless.
    """
    known = {(*_ends(c), _last(c.source)): c for c in found if _last(c.source) == _last(c.target)}
    bonds = []
    for (vehicle, shock, what), velocity in known.items():
        force = known.get((shock, vehicle, "force"))
        if what != "velocity" or force is None or not _alike(velocity, force):
            continue
        travel = known.get((vehicle, shock, "displacement"))
        bonds.append(Bond(vehicle, velocity, force, travel if travel and _alike(velocity, travel) else None))
    used = {connection for bond in bonds for connection in bond.connections}
    return tuple(bonds), tuple(c for c in found if c not in used)


def _alike(first: Connection, second: Connection) -> bool:
    return isclose(first.gain, second.gain, rel_tol=1e-9) and first.offset == second.offset == 0.0


def _last(name: str) -> str:
    return name.rpartition(".")[2]


def _ends(connection: Connection) -> tuple[str, str]:
    """Return the ports of a connection: `car.lf` and `lf`."""
    return connection.source.rpartition(".")[0], connection.target.rpartition(".")[0]
