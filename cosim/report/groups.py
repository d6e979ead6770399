"""The parts of a system that have nothing to do with each other; parts that are alike are one drawing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from cosim.report.wiring import DRIVE, Arrow, neighbours_of

#: What two parts must have in common to be alike.
_Likeness = tuple[tuple[str, ...], tuple[tuple[object, ...], ...]]


@dataclass(frozen=True, slots=True)
class Group:
    """Components that are connected with each other.

    Args:
        components: Their names, in the order of the system.
        arrows: What connects and feeds them.
        alike: Components of every other group of the same files and connections.
    """

    components: tuple[str, ...]
    arrows: tuple[Arrow, ...]
    alike: tuple[tuple[str, ...], ...] = ()


def groups(names: Sequence[str], joined: Sequence[Arrow], sources: Mapping[str, str]) -> tuple[Group, ...]:
    """Sort components and their connections into groups, each with those that are alike.

    Args:
        names: Components.
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
    """Files and connections without the names that components, bonds and drive channels have."""
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
