"""Unconnected parts of a system; parts that are alike share one drawing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from cosim.report.wiring import DRIVE, Arrow, neighbours_of

#: Properties that two parts must have in common to be alike.
_Likeness = tuple[tuple[str, ...], tuple[tuple[object, ...], ...]]


@dataclass(frozen=True, slots=True)
class Group:
    """Group of components that are connected with each other.

    Args:
        components: Names of the components, in the order of the system.
        arrows: Connections, drive and constants of the components.
        alike: Components of every other group with the same files and connections.
    """

    components: tuple[str, ...]
    arrows: tuple[Arrow, ...]
    alike: tuple[tuple[str, ...], ...] = ()


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
    neighbours = neighbours_of(names, joined)
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
