"""Wiring of a system for its drawing: connections, and unconnected parts in groups."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from cosim.components.conversion import named_unit
from cosim.systems.coupling import targets_of
from cosim.systems.scenario import Scenario
from cosim.systems.system import Bond, Connection, System
from eightpost.errors import UnknownUnitError

# ---- Connections of a system for a drawing --------------------------------------------------------------------------

#: Kinds of arrows from outside, used in place of a component's name.
DRIVE, CONSTANT = "drive", "constant"


@dataclass(frozen=True, slots=True)
class End:
    """One end of an arrow: a component (empty for outside) and the text there."""

    component: str
    text: str


@dataclass(frozen=True, slots=True)
class Arrow:
    """One connection."""

    source: End  #: Start of the arrow.
    target: End  #: End of the arrow.
    unit: str  #: Unit of the source; both units if the target has another one.
    gain: float  #: Gain of the connection; its sign is drawn.
    kind: str  #: velocity, displacement or force of a bond, drive, constant, or connection.
    bond: str = ""  #: Name of its bond; empty without one.
    summed: bool = False  #: Whether its target adds up several sources.

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


def _neighbours_of(names: Iterable[str], joined: Iterable[Arrow]) -> dict[str, list[str]]:
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
    neighbours = _neighbours_of(names, joined)
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
    for target, index in targets_of(system, scenario).items():
        unit = _from_to(scenario.drive.units[index], system, target)
        yield Arrow(End("", scenario.drive.names[index]), _end(target), unit, 1.0, DRIVE, "", target in system.sums)


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


# ---- Unconnected parts of a system; parts that are alike share one drawing ------------------------------------------

#: Properties that two parts must have in common to be alike.
_Likeness = tuple[tuple[str, ...], tuple[tuple[object, ...], ...]]


@dataclass(frozen=True, slots=True)
class Group:
    """Group of components that are connected with each other."""

    components: tuple[str, ...]  #: Names of the components, in the order of the system.
    arrows: tuple[Arrow, ...]  #: Connections, drive and constants of the components.
    alike: tuple[tuple[str, ...], ...] = ()  #: Components of every other group with the same files and connections.


def groups(names: Sequence[str], joined: Sequence[Arrow], sources: Mapping[str, str]) -> tuple[Group, ...]:
    """Sort components and their connections into groups, and merge groups that are alike.

    Args:
        names: Names of the components.
        joined: All connections.
        sources: File of each component.
    """
    found: dict[_Likeness, Group] = {}
    for group in _connected(names, joined):
        likeness = _likeness(group, sources)
        first = found.setdefault(likeness, group)
        if first is not group:
            found[likeness] = replace(first, alike=(*first.alike, group.components))
    return tuple(found.values())


def _connected(names: Sequence[str], joined: Sequence[Arrow]) -> Iterator[Group]:
    neighbours = _neighbours_of(names, joined)
    home: dict[str, int] = {}
    for number, name in enumerate(names):
        waiting = [name]
        while waiting:
            component = waiting.pop()
            if component not in home:
                home[component] = number
                waiting += neighbours[component]
    members: dict[int, list[str]] = {}
    for name in names:
        members.setdefault(home[name], []).append(name)
    arrows: dict[int, list[Arrow]] = {}
    for arrow in joined:
        arrows.setdefault(home[arrow.target.component], []).append(arrow)
    for number, components in members.items():
        yield Group(tuple(components), tuple(arrows.get(number, ())))


def _likeness(group: Group, sources: Mapping[str, str]) -> _Likeness:
    """Return files and connections without the names of components, bonds and drive channels."""
    numbers = {name: k for k, name in enumerate(group.components)} | {"": -1}
    return (
        tuple(sources.get(name, "") for name in group.components),
        tuple(
            (
                numbers[a.source.component],
                "" if a.kind == DRIVE else a.source.text,
                numbers[a.target.component],
                a.target.text,
                *(a.unit, a.gain, a.kind, bool(a.bond), a.summed),
            )
            for a in group.arrows
        ),
    )
