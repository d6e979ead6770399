"""Parameter values assigned to variables: through connectors, in the variable's own unit and type."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from cosim.component import Variable
from cosim.conversion import Conversion, convert_between
from cosim.ssp.flatten import Hop, Network, Path, Port, compose
from cosim.ssp.package import read_inside
from cosim.ssp.structure import Assignment, FmuElement, SystemElement, Value
from cosim.system import can_be_set
from eightpost.errors import WiringError


@dataclass(frozen=True)
class Values:
    """Values from parameter sets by port of an FMU: parameters and inputs, with notes on values that match nothing."""

    parameters: Mapping[Port, Value] = field(default_factory=dict)
    inputs: Mapping[Port, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def read_values(network: Network) -> Values:
    """Return the values that parameter sets give to variables.

    A set bound at a higher level takes precedence over one at a lower level; of two at one level the later one does. A
    value at a system's connector reaches the variables that the connector feeds. An input fed by another FMU gets none.

    Raises:
        WiringError: A value has the wrong type or unit.
    """
    given, notes = _assigned(network)
    parameters: dict[Port, Value] = {}
    inputs: dict[Port, float] = {}
    for target in _targets(network, given):
        origin, hops = network.chain(target)
        if hops and isinstance(network.elements[origin.path], FmuElement):
            continue
        found = _strongest(origin, hops, given)
        variable = network.variable(target)
        if found is None or variable is None:
            continue
        value = _at(network, target, variable, found)
        if can_be_set(variable):
            parameters[target] = value
        elif variable.causality == "input":
            inputs[target] = float(value)
        else:
            notes.append(f"{found.assignment.where}: {target} = {value!r} is ignored: the FMU computes this variable")
    return Values(parameters, inputs, tuple(notes))


@dataclass(frozen=True)
class _Given:
    """Value at a port, its rank, and the links from there to the variable."""

    rank: int
    assignment: Assignment
    port: Port
    hops: Sequence[Hop] = ()


def _assigned(network: Network) -> tuple[dict[Port, _Given], list[str]]:
    """Return the value of highest rank at each port, the last of `_by_level`, and notes on values without a port."""
    found: dict[Port, _Given] = {}
    unmatched: dict[str, list[str]] = {}
    for rank, (path, value) in enumerate(_by_level(network.elements)):
        port = network.find(value.name, path)
        if port is None:
            unmatched.setdefault(value.where, []).append(".".join((*path, value.name)))
        else:
            found[port] = _Given(rank, value, port)
    return found, [f"{where}: no variable matches {', '.join(names)}" for where, names in unmatched.items()]


def _by_level(elements: Mapping[Path, FmuElement | SystemElement]) -> Iterator[tuple[Path, Assignment]]:
    for path in sorted(elements, key=len, reverse=True):
        yield from ((path, value) for value in elements[path].values)


def _targets(network: Network, given: Iterable[Port]) -> Iterator[Port]:
    direct = (port for port in given if network.variable(port) is not None)
    yield from dict.fromkeys((*network.fed(), *direct))


def _strongest(origin: Port, hops: Sequence[Hop], given: Mapping[Port, _Given]) -> _Given | None:
    ports = [origin, *(hop.target for hop in hops)]
    found = [
        _Given(given[port].rank, given[port].assignment, port, hops[index:])
        for index, port in enumerate(ports)
        if port in given
    ]
    return max(found, key=lambda value: value.rank, default=None)


def _at(network: Network, target: Port, variable: Variable, given: _Given) -> Value:
    """Return a value converted along its links to an FMU's variable."""
    assignment, what = given.assignment, f"{given.assignment.where}: {given.port}"
    unit = network.unit(given.port)
    first = Conversion()
    if not assignment.suppressed:
        first = convert_between(assignment.unit, unit, what)
        unit = unit or assignment.unit
    total, _ = network.carry(unit, given.hops, compose(first, assignment.transformation))
    value = assignment.value
    if total != Conversion():
        if isinstance(value, (bool, str)):
            raise WiringError(f"{what} = {value!r}: a linear transformation needs a number; remove it")
        value = total(value)
    return _typed(value, network, target, variable, assignment)


def _typed(value: Value, network: Network, target: Port, variable: Variable, assignment: Assignment) -> Value:
    """Return a value in the variable's type, if this is possible without loss."""
    number = not isinstance(value, (bool, str))
    if variable.type == "Real" and number:
        return float(value)
    if variable.type in ("Integer", "Enumeration") and number and float(value).is_integer():
        return int(value)
    if variable.type == "Enumeration" and isinstance(value, str):
        return _item(value, network, target, assignment)
    if (variable.type, type(value)) in (("Boolean", bool), ("String", str)):
        return value
    raise WiringError(
        f"{assignment.where}: {target} = {value!r} is given as {assignment.type}, but the variable is a "
        f"{variable.type}; correct the type"
    )


def _item(name: str, network: Network, target: Port, assignment: Assignment) -> int:
    """Return the number of an enumeration's item: from the FMU, else from the parameter set."""
    element = network.elements[target.path]
    items = _items(element, target) if isinstance(element, FmuElement) else {}
    items = items or dict(assignment.items)
    if name not in items:
        known = ", ".join(items) or "none known"
        raise WiringError(
            f"{assignment.where}: {target} = {name!r} is not an item of its enumeration ({known}); correct it"
        )
    return items[name]


def _items(element: FmuElement, target: Port) -> dict[str, int]:
    """Return the items of an FMU's enumeration, from its model description."""
    root = ET.fromstring(read_inside(element.path, "modelDescription.xml", element.where))
    types = {t.get("name"): t for t in root.iter("SimpleType")}
    for variable in root.iter("ScalarVariable"):
        kind = variable.find("Enumeration")
        if variable.get("name") == target.name and kind is not None:
            declared = types.get(kind.get("declaredType"))
            found = () if declared is None else declared.iter("Item")
            return {item.get("name", ""): int(item.get("value", "0")) for item in found}
    return {}
