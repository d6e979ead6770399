"""Connections of a system for a drawing: one component in the middle, others next to it, inputs from outside."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from cosim.conversion import named_unit
from cosim.scenario import Scenario
from cosim.system import Bond, Connection, System
from eightpost.errors import UnknownUnitError

#: Kinds of arrows from outside, used in place of a component's name.
DRIVE, CONSTANT = "drive", "constant"


@dataclass(frozen=True, slots=True)
class End:
    """One end of an arrow: a component (empty for outside) and the text there."""

    component: str
    text: str


@dataclass(frozen=True, slots=True)
class Arrow:
    """One connection.

    Args:
        source: Start of the arrow.
        target: End of the arrow.
        unit: Unit of the source; both units if the target has another one.
        gain: Gain of the connection; its sign is drawn.
        kind: velocity, displacement or force of a bond, drive, constant, or connection.
        bond: Name of its bond; empty without one.
        summed: Whether its target adds up several sources.
    """

    source: End
    target: End
    unit: str
    gain: float
    kind: str
    bond: str = ""
    summed: bool = False

    def joins(self, component: str) -> bool:
        """Return whether it starts or ends at a component."""
        return component in (self.source.component, self.target.component)


def arrows(system: System, scenario: Scenario) -> tuple[Arrow, ...]:
    """Return all connections: those of bonds, the others, the drive's channels, the constants."""
    bonds = [_of_connection(system, c, kind, bond.name) for bond in system.bonds for kind, c in _ways(bond)]
    others = [_of_connection(system, c, "connection", "") for c in system.connections]
    return (*bonds, *others, *_driven(system, scenario), *_constants(system))


def middle(names: Iterable[str], joined: Iterable[Arrow]) -> str:
    """Return the component that is connected with the most others; the first one in case of a tie."""
    others: dict[str, Counter[str]] = {name: Counter() for name in names}
    for arrow in joined:
        ends = (arrow.source.component, arrow.target.component)
        if all(ends) and ends[0] != ends[1]:
            others[ends[0]][ends[1]] += 1
            others[ends[1]][ends[0]] += 1
    return max(others, key=lambda name: len(others[name]), default="")


def neighbours_of(names: Iterable[str], joined: Iterable[Arrow]) -> dict[str, list[str]]:
    """Return, for each component, the components that it is connected with, once per connection."""
    neighbours: dict[str, list[str]] = {name: [] for name in names}
    for arrow in joined:
        ends = (arrow.source.component, arrow.target.component)
        if all(ends):
            neighbours[ends[0]].append(ends[1])
            neighbours[ends[1]].append(ends[0])
    return neighbours


def order(names: Iterable[str], joined: Iterable[Arrow], center: str) -> tuple[str, ...]:
    """Return the components except the middle one: in the given order, each followed by those connected through it."""
    neighbours = neighbours_of(names, joined)
    near = set(neighbours.get(center, ()))
    placed: dict[str, None] = {center: None}
    for name in (*neighbours.get(center, ()), *neighbours):
        waiting = [name]
        while waiting:
            component = waiting.pop()
            if component not in placed:
                placed[component] = None
                waiting += reversed([n for n in neighbours[component] if n not in near])
    return tuple(placed)[1:]


def _ways(bond: Bond) -> Iterator[tuple[str, Connection]]:
    yield "velocity", bond.velocity
    if bond.displacement is not None:
        yield "displacement", bond.displacement
    yield "force", bond.force


def _of_connection(system: System, connection: Connection, kind: str, bond: str) -> Arrow:
    source, target = system.output(connection.source).unit, system.input(connection.target).unit
    names = [unit.name for unit in (source, target) if unit is not None]
    return Arrow(
        _end(connection.source),
        _end(connection.target),
        " → ".join(dict.fromkeys(names)),
        connection.gain,
        kind,
        bond,
        connection.target in system.sums,
    )


def _end(name: str) -> End:
    component, _, variable = name.partition(".")
    return End(component, variable)


def _driven(system: System, scenario: Scenario) -> Iterator[Arrow]:
    if scenario.drive is None:
        return
    units = dict(zip(scenario.drive.names, scenario.drive.units, strict=True))
    for channel, target in (scenario.targets or _by_name(system, units)).items():
        unit = _from_to(units.get(channel, ""), system, target)
        yield Arrow(End("", channel), _end(target), unit, 1.0, DRIVE, "", target in system.sums)


def _by_name(system: System, channels: Iterable[str]) -> Mapping[str, str]:
    """Return the input of each channel if the scenario gives no targets: the one of the same name."""
    return {
        channel: f"{name}.{channel}"
        for channel in channels
        for name, component in system.components.items()
        if (variable := component.variables.get(channel)) and variable.causality == "input"
    }


def _from_to(unit: str, system: System, target: str) -> str:
    own = system.input(target).unit
    if own is None or own.name == unit or _same(unit, own.name):
        return unit
    return f"{unit} → {own.name}"


def _same(unit: str, other: str) -> bool:
    try:
        return named_unit(unit) == named_unit(other)
    except UnknownUnitError:
        return False


def _constants(system: System) -> Iterator[Arrow]:
    for name, value in system.constants.items():
        unit = system.input(name).unit
        yield Arrow(
            End("", f"{value:g}"), _end(name), unit.name if unit else "", 1.0, CONSTANT, "", name in system.sums
        )
