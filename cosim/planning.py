"""A system and its scenario as the flat arrays that the loop takes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from cosim.conversion import to_si
from cosim.coupling import Coupling, Feed
from cosim.engine.plan import Bonds, Indices, Inputs, Loops, Parts, Plan, Signals, Terms, Watch
from cosim.functions import FunctionTable
from cosim.system import Bond, System

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Layout:
    """Where everything is: parts, signals and extras by name, terms by (source, target).

    Args:
        parts: Names of the components, in the order of their numbers.
        signals: `component.variable` of what is read after every step; of one part side by side.
        extras: The same of what is read at recorded points only.
        terms: Number of each connection's term, by source and target.
        order: The parts in the order of stepping, those that are connected with each other side by side.
        groups: How many parts each group of connected ones has, in that order.
    """

    parts: tuple[str, ...]
    signals: tuple[str, ...]
    extras: tuple[str, ...]
    terms: Mapping[tuple[str, str], int]
    order: tuple[str, ...]
    groups: tuple[int, ...]


def lay_out(coupling: Coupling, order: Sequence[str]) -> Layout:
    """Number everything; `order` is the order of stepping."""
    parts = tuple(coupling.components)
    moving = {name: _moving(coupling.feeds[name]) for name in parts}
    pairs = [(term.source, f"{name}.{feed.target}") for name in parts for feed in moving[name] for term in feed.terms]
    groups = _groups(parts, pairs, order)
    return Layout(
        parts=parts,
        signals=tuple(f"{name}.{v}" for name in parts for v in coupling.outputs[name]),
        extras=tuple(f"{name}.{v}" for name in parts for v in coupling.recorded[name]),
        terms={pair: k for k, pair in enumerate(pairs)},
        order=tuple(name for group in groups for name in group),
        groups=tuple(len(group) for group in groups),
    )


def make_plan(
    system: System,
    coupling: Coupling,
    layout: Layout,
    tables: Mapping[str, FunctionTable],
    *,
    watched: Iterable[tuple[str, bool]],
    following: Collection[str],
) -> Plan:
    """Return the arrays.

    Args:
        system: Its bonds.
        coupling: Its feeds.
        layout: Of the same coupling.
        tables: Each part's functions.
        watched: Signals whose time beyond a limit counts: above 0.5 where true, else below 0.
        following: Parts that go from each point of the drive to the next.
    """
    position = {name: k for k, name in enumerate(layout.signals)}
    watch = list(watched)
    return Plan(
        parts=_parts(coupling, layout, tables, following),
        inputs=_inputs(coupling, layout, tables),
        terms=_terms(coupling, layout, position),
        signals=_signals(layout, tables),
        bonds=_bonds(system, layout),
        watch=Watch(_indices(position[n] for n, _ in watch), _integers(int(above) for _, above in watch)),
        loops=_loops(layout, position),
        order=_indices(layout.parts.index(name) for name in layout.order),
    )


def _moving(feeds: Iterable[Feed]) -> tuple[Feed, ...]:
    """Inputs that change during a run; the others are set once."""
    return tuple(feed for feed in feeds if feed.terms or feed.drive is not None)


def _groups(parts: Sequence[str], pairs: Iterable[tuple[str, str]], order: Sequence[str]) -> list[list[str]]:
    """Parts that are connected, directly or through others, in the order of stepping."""
    home = {name: name for name in parts}

    def root(name: str) -> str:
        while home[name] != name:
            home[name] = home[home[name]]
            name = home[name]
        return name

    for source, target in pairs:
        home[root(source.partition(".")[0])] = root(target.partition(".")[0])
    groups: dict[str, list[str]] = {}
    for name in order:
        groups.setdefault(root(name), []).append(name)
    return list(groups.values())


def _integers(values: Iterable[int]) -> Integers:
    return np.array(list(values), dtype=np.int64)


def _indices(values: Iterable[int]) -> Indices:
    return np.array(list(values), dtype=np.uint32)


def _begins(counts: Iterable[int]) -> Indices:
    return _indices(accumulate(counts, initial=0))


def _parts(
    coupling: Coupling, layout: Layout, tables: Mapping[str, FunctionTable], following: Collection[str]
) -> Parts:
    columns = ("set_real", "set_slopes", "do_step", "get_real", "save", "restore", "instance")
    inputs = [len(_moving(coupling.feeds[name])) for name in layout.parts]
    signals = [len(coupling.outputs[name]) for name in layout.parts]
    extras = [len(coupling.recorded[name]) for name in layout.parts]
    addresses = {column: _integers(getattr(tables[name], column) for name in layout.parts) for column in columns}
    return Parts(
        **addresses,
        ramps=_integers(int(coupling.components[n].capabilities.interpolates_inputs) for n in layout.parts),
        follows=_integers(int(name in following) for name in layout.parts),
        inputs=_begins(inputs),
        signals=_begins(signals),
        extras=_begins(extras),
        input_count=_integers(inputs),
        signal_count=_integers(signals),
        extra_count=_integers(extras),
    )


def _inputs(coupling: Coupling, layout: Layout, tables: Mapping[str, FunctionTable]) -> Inputs:
    rows = [(name, feed) for name in layout.parts for feed in _moving(coupling.feeds[name])]
    held = {name for name in layout.parts if not coupling.components[name].capabilities.interpolates_inputs}
    direct = {name: coupling.direct_inputs(name) for name in held}
    return Inputs(
        reference=np.array([tables[name].references[feed.target] for name, feed in rows], dtype=np.uint32),
        order=np.ones(len(rows), np.int32),
        constant=np.array([feed.constant for _, feed in rows], dtype=np.float64),
        terms=_begins(len(feed.terms) for _, feed in rows),
        column=_integers(-1 if feed.drive is None else feed.drive for _, feed in rows),
        factor=np.array([feed.drive_conversion.factor for _, feed in rows], dtype=np.float64),
        offset=np.array([feed.drive_conversion.offset for _, feed in rows], dtype=np.float64),
        holds_end=_integers(int(feed.target in direct.get(name, ())) for name, feed in rows),
    )


def _terms(coupling: Coupling, layout: Layout, position: Mapping[str, int]) -> Terms:
    rank = {name: k for k, name in enumerate(layout.order)}
    rows = [
        (rank[name], term) for name in layout.parts for feed in _moving(coupling.feeds[name]) for term in feed.terms
    ]
    return Terms(
        source=_indices(position[term.source] for _, term in rows),
        early=_integers(int(rank[term.source.partition(".")[0]] < place) for place, term in rows),
        weight=np.array([term.gain * term.conversion.factor for _, term in rows], dtype=np.float64),
        offset=np.array([term.gain * term.conversion.offset for _, term in rows], dtype=np.float64),
    )


def _references(names: Iterable[str], tables: Mapping[str, FunctionTable]) -> NDArray[np.uint32]:
    pairs = (name.partition(".")[::2] for name in names)
    return np.array([tables[part].references[variable] for part, variable in pairs], dtype=np.uint32)


def _signals(layout: Layout, tables: Mapping[str, FunctionTable]) -> Signals:
    return Signals(_references(layout.signals, tables), _references(layout.extras, tables))


def _bonds(system: System, layout: Layout) -> Bonds:
    def terms(which: str) -> Indices:
        return _indices(layout.terms[_ends(bond, which)] for bond in system.bonds)

    def factor(bond: Bond, which: str, end: int) -> float:
        return to_si(system.output(_ends(bond, which)[end]))[0].factor

    def joules(sent: str, received: str) -> NDArray[np.float64]:
        rows = [0.5 * factor(bond, sent, 0) * factor(bond, received, 1) for bond in system.bonds]
        return np.array(rows, dtype=np.float64)

    return Bonds(
        terms("velocity"), terms("force"), given=joules("velocity", "force"), taken=joules("force", "velocity")
    )


def _ends(bond: Bond, which: str) -> tuple[str, str]:
    connection = bond.velocity if which == "velocity" else bond.force
    return connection.source, connection.target


def _loops(layout: Layout, position: Mapping[str, int]) -> Loops:
    """What each group needs before it is known: sources that do not come before their target in the order."""
    rank = {name: k for k, name in enumerate(layout.order)}
    early = {
        source for source, target in layout.terms if rank[source.partition(".")[0]] >= rank[target.partition(".")[0]]
    }
    group_of = {
        name: g
        for g, (first, count) in enumerate(zip(_begins(layout.groups), layout.groups, strict=False))
        for name in layout.order[first : first + count]
    }
    unknowns = sorted(early, key=lambda s: (group_of[s.partition(".")[0]], position[s]))
    counts = [sum(group_of[s.partition(".")[0]] == g for s in unknowns) for g in range(len(layout.groups))]
    return Loops(
        parts=_begins(layout.groups),
        unknowns=_begins(counts),
        signal=_indices(position[s] for s in unknowns),
        matrix=_begins(n * n for n in counts),
        least=np.full(len(unknowns), 1e-9),
    )
