"""Conversion of a system and its scenario to the flat arrays that the loop uses and records."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.components.component import DISCRETE, Conversion, FunctionTable, to_si
from cosim.engine.march import Tape
from cosim.engine.plan import Bonds, Direct, Driven, Indices, Inputs, Levels, Loops, Parts, Plan, Signals, Terms, Watch
from cosim.systems.coupling import Coupling, Feed, Scenario
from cosim.systems.system import System
from eightpost.array_types import Integers
from eightpost.errors import InputError, StepError, WiringError
from eightpost.signals import TimeSeries

# ---- Plan -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Layout:
    """Numbering of everything in the arrays: parts, signals and extras by name, terms by (source, target)."""

    #: Names of the components in the order of stepping, with the components of each connected group together.
    parts: tuple[str, ...]
    #: Variables read after every step, as `component.variable`; those of one part are adjacent.
    signals: tuple[str, ...]
    extras: tuple[str, ...]  #: Variables read at recorded points only, in the same form.
    terms: Mapping[tuple[str, str], int]  #: Number of each connection's term, by source and target.
    #: Sizes of the levels of each group of connected parts; parts of a level take nothing from each other.
    levels: tuple[tuple[int, ...], ...]

    @property
    def groups(self) -> tuple[int, ...]:
        """Number of parts of each group."""
        return tuple(sum(counts) for counts in self.levels)


def lay_out(coupling: Coupling, order: Sequence[str]) -> Layout:
    """Return the numbering of everything; `order` is the order of stepping."""
    takes = {
        name: {term.source.partition(".")[0] for feed in coupling.feeds[name] for term in feed.terms} for name in order
    }
    groups = _groups(takes, order)
    parts = tuple(name for group in groups for name in group)
    feeds = [(name, feed) for name in parts for feed in _moving(coupling.feeds[name])]
    pairs = [(term.source, f"{name}.{feed.target}") for name, feed in feeds for term in feed.terms]
    return Layout(
        parts=parts,
        signals=tuple(f"{name}.{v}" for name in parts for v in coupling.outputs[name]),
        extras=tuple(f"{name}.{v}" for name in parts for v in coupling.recorded[name]),
        terms={pair: k for k, pair in enumerate(pairs)},
        levels=tuple(_levels(group, takes) for group in groups),
    )


class Limit(NamedTuple):
    """Limit of a signal: it is exceeded where `sign` (1 or -1) times the signal is above `limit`."""

    signal: str
    sign: float
    limit: float


def make_plan(
    system: System,
    coupling: Coupling,
    layout: Layout,
    tables: Mapping[str, FunctionTable],
    *,
    watched: Iterable[Limit],
    following: Collection[str],
    recorded: Sequence[str],
    sequential: bool,
) -> Plan:
    """Return the loop's arrays.

    Args:
        system: System with the bonds.
        coupling: Coupling with the feeds.
        layout: Layout of this coupling.
        tables: Functions of each part.
        watched: Limits of signals; the time beyond each is counted.
        following: Parts that are stepped from each point of the drive to the next.
        recorded: Variables by the tape's columns, as `component.variable`.
        sequential: Whether the outputs of a part that has stepped are known to those after it.
    """
    position = {name: k for k, name in enumerate(layout.signals)}
    watch = list(watched)
    return Plan(
        parts=_parts(coupling, layout, tables, following),
        inputs=_inputs(coupling, layout, tables),
        terms=_terms(coupling, layout, position),
        driven=_driven(coupling, layout),
        signals=_signals(layout, tables),
        bonds=_bonds(system, layout),
        watch=Watch(
            _indices(position[each.signal] for each in watch),
            sign=_reals(each.sign for each in watch),
            limit=_reals(each.limit for each in watch),
        ),
        loops=_loops(layout, position),
        levels=Levels(
            parts=_begins(count for counts in layout.levels for count in counts),
            groups=_begins(len(counts) for counts in layout.levels),
        ),
        direct=_direct(coupling, layout, tables, recorded, sequential=sequential),
    )


def _moving(feeds: Iterable[Feed]) -> tuple[Feed, ...]:
    """Return the inputs that change during a run; the others are set once."""
    return tuple(feed for feed in feeds if feed.terms or feed.drive is not None)


def _groups(takes: Mapping[str, Iterable[str]], order: Sequence[str]) -> list[list[str]]:
    """Return groups of parts that are connected, directly or through others, in the order of stepping."""
    home = {name: name for name in order}

    def root(name: str) -> str:
        while home[name] != name:
            home[name] = home[home[name]]
            name = home[name]
        return name

    for name in order:
        for source in takes[name]:
            home[root(source)] = root(name)
    groups: dict[str, list[str]] = {}
    for name in order:
        groups.setdefault(root(name), []).append(name)
    return list(groups.values())


def _levels(group: Sequence[str], takes: Mapping[str, Collection[str]]) -> tuple[int, ...]:
    """Return the sizes of consecutive levels of parts, in which no part takes anything from another."""
    levels: list[list[str]] = [[]]
    for name in group:
        if any(source in levels[-1] for source in takes[name]):
            levels.append([])
        levels[-1].append(name)
    return tuple(map(len, levels))


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
    moving = [_moving(coupling.feeds[name]) for name in layout.parts]
    inputs = [len(feeds) for feeds in moving]
    signals = [len(coupling.outputs[name]) for name in layout.parts]
    extras = [len(coupling.recorded[name]) for name in layout.parts]
    addresses = {column: _integers(getattr(tables[name], column) for name in layout.parts) for column in columns}
    return Parts(
        **addresses,
        ramps=_integers(int(coupling.components[n].capabilities.interpolates_inputs) for n in layout.parts),
        follows=_integers(int(name in following) for name in layout.parts),
        inputs=_begins(inputs),
        terms=_begins(sum(len(feed.terms) for feed in feeds) for feeds in moving),
        driven=_begins(sum(feed.drive is not None for feed in feeds) for feeds in moving),
        signals=_begins(signals),
        extras=_begins(extras),
        input_count=_integers(inputs),
        signal_count=_integers(signals),
        extra_count=_integers(extras),
    )


def _inputs(coupling: Coupling, layout: Layout, tables: Mapping[str, FunctionTable]) -> Inputs:
    rows = _rows(coupling, layout)
    return Inputs(
        reference=np.array([tables[name].references[feed.target] for name, feed in rows], dtype=np.uint32),
        order=np.ones(len(rows), np.int32),
        constant=_reals(feed.constant for _, feed in rows),
    )


def _rows(coupling: Coupling, layout: Layout) -> list[tuple[str, Feed]]:
    """Return all inputs with their parts, in the order of their numbers."""
    return [(name, feed) for name in layout.parts for feed in _moving(coupling.feeds[name])]


def _reals(values: Iterable[float]) -> NDArray[np.float64]:
    return np.array(list(values), dtype=np.float64)


def _driven(coupling: Coupling, layout: Layout) -> Driven:
    rows = [(k, feed) for k, (_, feed) in enumerate(_rows(coupling, layout)) if feed.drive is not None]
    return Driven(
        target=_indices(k for k, _ in rows),
        channel=_indices(feed.drive or 0 for _, feed in rows),
        factor=_reals(feed.drive_conversion.factor for _, feed in rows),
        offset=_reals(feed.drive_conversion.offset for _, feed in rows),
    )


def _terms(coupling: Coupling, layout: Layout, position: Mapping[str, int]) -> Terms:
    rank = {name: k for k, name in enumerate(layout.parts)}
    held = {name for name in layout.parts if not coupling.components[name].capabilities.interpolates_inputs}
    direct = {name: coupling.direct_inputs(name) for name in held}
    feeds = _rows(coupling, layout)
    rows = [(k, name, term) for k, (name, feed) in enumerate(feeds) for term in feed.terms]
    ends = [1.0 if feeds[k][1].target in direct.get(name, ()) else 0.5 for k, name, _ in rows]
    return Terms(
        source=_indices(position[term.source] for _, _, term in rows),
        target=_indices(k for k, _, _ in rows),
        early=_integers(int(rank[term.source.partition(".")[0]] < rank[name]) for _, name, term in rows),
        weight=_reals(term.gain * term.conversion.factor for _, _, term in rows),
        offset=_reals(term.gain * term.conversion.offset for _, _, term in rows),
        start=_reals(1.0 - end for end in ends),
        end=_reals(ends),
    )


def _direct(
    coupling: Coupling,
    layout: Layout,
    tables: Mapping[str, FunctionTable],
    recorded: Sequence[str],
    *,
    sequential: bool,
) -> Direct:
    """Return the recorded outputs that follow inputs whose end values are assumed, of parts that give derivatives.

    Only continuous variables have derivatives.
    """
    rank = {name: k for k, name in enumerate(layout.parts)}
    assumed: dict[str, dict[str, int]] = {name: {} for name in layout.parts}
    for i, (name, feed) in enumerate(_rows(coupling, layout)):
        component = coupling.components[name]
        unknown = (not sequential or rank[term.source.partition(".")[0]] >= rank[name] for term in feed.terms)
        is_assumed = not component.capabilities.interpolates_inputs or any(unknown)
        if is_assumed and component.variables[feed.target].variability == "continuous":
            assumed[name][feed.target] = i
    follows: dict[str, list[int]] = {}
    for column, name in enumerate(recorded):
        part, _, output = name.partition(".")
        component = coupling.components[part]
        variable = component.variables[output]
        has_derivatives = component.capabilities.derivatives and variable.variability == "continuous"
        if has_derivatives and variable.direct & assumed[part].keys():
            follows.setdefault(part, []).append(column)
    parts = [name for name in layout.parts if name in follows and tables[name].derive]
    columns = [column for name in parts for column in follows[name]]
    inputs = [f"{name}.{target}" for name in parts for target in assumed[name]]
    return Direct(
        part=_indices(rank[name] for name in parts),
        derive=_integers(tables[name].derive for name in parts),
        outputs=_begins(len(follows[name]) for name in parts),
        column=_indices(columns),
        unknown=_references((recorded[column] for column in columns), tables),
        inputs=_begins(len(assumed[name]) for name in parts),
        input=_indices(i for name in parts for i in assumed[name].values()),
        known=_references(inputs, tables),
    )


def _references(names: Iterable[str], tables: Mapping[str, FunctionTable]) -> NDArray[np.uint32]:
    pairs = (name.partition(".")[::2] for name in names)
    return np.array([tables[part].references[variable] for part, variable in pairs], dtype=np.uint32)


def _signals(layout: Layout, tables: Mapping[str, FunctionTable]) -> Signals:
    return Signals(_references(layout.signals, tables), _references(layout.extras, tables))


def _bonds(system: System, layout: Layout) -> Bonds:
    velocities, forces = [bond.velocity for bond in system.bonds], [bond.force for bond in system.bonds]
    ends = {name for c in (*velocities, *forces) for name in (c.source, c.target)}
    factor = {name: to_si(system.output(name))[0].factor for name in ends}
    pairs = list(zip(velocities, forces, strict=True))
    return Bonds(
        _indices(layout.terms[c.source, c.target] for c in velocities),
        _indices(layout.terms[c.source, c.target] for c in forces),
        given=_reals(0.5 * factor[v.source] * factor[f.target] for v, f in pairs),
        taken=_reals(0.5 * factor[f.source] * factor[v.target] for v, f in pairs),
    )


def _loops(layout: Layout, position: Mapping[str, int]) -> Loops:
    """Return the unknowns of each group: sources that do not come before their target in the order."""
    rank = {name: k for k, name in enumerate(layout.parts)}
    early = {
        source for source, target in layout.terms if rank[source.partition(".")[0]] >= rank[target.partition(".")[0]]
    }
    group_of = {
        name: g
        for g, (first, count) in enumerate(zip(_begins(layout.groups), layout.groups, strict=False))
        for name in layout.parts[first : first + count]
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


# ---- Recording: names, times and arrays of the recorded signals -----------------------------------------------------

Flags = NDArray[np.int64]

_NUMBERS = ("Real", *DISCRETE)


def recorded_names(system: System, scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the recorded variables: those of the scenario, else every output that is a number.

    Raises:
        WiringError: A name is unknown or its values are not numbers.
    """
    names = tuple(dict.fromkeys(scenario.record)) or _every_output(system)
    for name in names:
        if system.output(name).type not in _NUMBERS:
            raise WiringError(f"{name} is a {system.output(name).type} and cannot be recorded; record numbers")
    return names


def real_names(system: System, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names that the loop records; discrete variables are recorded outside the loop."""
    return tuple(name for name in names if system.output(name).type == "Real")


def recorded_steps(scenario: Scenario, step: float, count: int) -> Flags:
    """Return 1 for each of the communication points 0 to `count` that is recorded: the first, the last, and every n-th.

    Raises:
        InputError: The record step is not a whole number of coupling steps.
    """
    flags = np.zeros(count + 1, np.int64)
    flags[:: _stride(scenario, step)] = 1
    flags[-1] = 1
    return flags


def blank_tape(layout: Layout, names: tuple[str, ...], rows: int) -> Tape:
    """Return a tape with space for `rows` communication points."""
    places = {name: k for k, name in enumerate((*layout.signals, *layout.extras))}
    columns = np.array([places[name] for name in names], dtype=np.uint32)
    return Tape(np.zeros((rows, len(names))), np.zeros(rows), columns, np.zeros(1, np.int64))


def recorded_series(
    system: System, names: tuple[str, ...], tape: Tape, discrete: Sequence[Sequence[float]] = ()
) -> TimeSeries:
    """Return the contents of a tape and the rows of discrete variables, in SI.

    Raises:
        StepError: A recorded value is not a number.
    """
    count = int(tape.position[0])
    values, units = _values(system, names, tape.rows[:count], discrete), []
    for row, name in zip(values, names, strict=True):
        conversion, unit = to_si(system.output(name))
        units.append(unit)
        if conversion != Conversion():
            row[:] = conversion.factor * row + conversion.offset
        if not np.isfinite(row).all():
            raise StepError(_not_a_number(name, tape.times[int(np.argmin(np.isfinite(row)))]))
    values.setflags(write=False)  # no other references exist, so no copy is needed
    return TimeSeries(tape.times[:count], values, names, tuple(units))


def _values(
    system: System, names: tuple[str, ...], real: NDArray[np.float64], discrete: Sequence[Sequence[float]]
) -> NDArray[np.float64]:
    """Return one row per name (M, R) from the rows per time of both kinds."""
    is_real = np.array([system.output(name).type == "Real" for name in names], dtype=bool)
    if is_real.all():
        return np.ascontiguousarray(real.T)
    values = np.empty((len(names), real.shape[0]))
    values[is_real] = real.T
    values[~is_real] = np.array(discrete, dtype=np.float64).reshape(real.shape[0], -1).T
    return values


def _not_a_number(name: str, time: float) -> str:
    return (
        f"{name} is not a number from {time:g} s on: check the inputs and the log of its component, or remove it from "
        "the record list ([scenario] record)"
    )


def _every_output(system: System) -> tuple[str, ...]:
    return tuple(
        f"{name}.{v.name}"
        for name, component in system.components.items()
        for v in component.variables.values()
        if v.causality == "output" and v.type in _NUMBERS
    )


def _stride(scenario: Scenario, step: float) -> int:
    if scenario.record_step is None:
        return 1
    stride = round(scenario.record_step / step)
    if stride < 1 or abs(stride * step - scenario.record_step) > 1e-9 * scenario.record_step:
        raise InputError(
            f"record_step {scenario.record_step} s is not a whole number of coupling steps of {step} s; change one"
        )
    return stride
