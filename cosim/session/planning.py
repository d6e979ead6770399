"""The flat arrays that the loop uses and records, for the setup of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from cosim.components.component import Conversion, FunctionTable, to_si
from cosim.engine.march import Tape
from cosim.engine.plan import (
    JACOBI,
    Bonds,
    Direct,
    Driven,
    Indices,
    Inputs,
    Integers,
    Levels,
    Loops,
    Parts,
    Plan,
    Reals,
    Signals,
    Terms,
    Watch,
)
from cosim.session.setup import Layout, RunSetup
from cosim.systems.coupling import Coupling, Feed
from cosim.systems.system import System
from eightpost.errors import StepError
from eightpost.signals import TimeSeries

# ---- Plan -----------------------------------------------------------------------------------------------------------


def make_plan(setup: RunSetup, tables: Mapping[str, FunctionTable]) -> Plan:
    """Return the loop's arrays; `tables` are the functions of each component."""
    coupling, layout, watched = setup.coupling, setup.layout, setup.limits.watched
    position = {name: k for k, name in enumerate(layout.signals)}
    rows = [(name, feed) for name in layout.parts for feed in _moving(coupling, name)]
    driven = [(k, feed) for k, (_, feed) in enumerate(rows) if feed.drive is not None]
    return Plan(
        parts=_parts(setup, tables),
        inputs=Inputs(
            reference=np.array([tables[name].references[feed.target] for name, feed in rows], dtype=np.uint32),
            order=np.ones(len(rows), np.int32),
            constant=_reals(feed.constant for _, feed in rows),
        ),
        terms=_terms(coupling, layout, rows, position),
        driven=Driven(
            target=_indices(k for k, _ in driven),
            channel=_indices(feed.drive or 0 for _, feed in driven),
            factor=_reals(feed.drive_conversion.factor for _, feed in driven),
            offset=_reals(feed.drive_conversion.offset for _, feed in driven),
        ),
        signals=Signals(_references(layout.signals, tables), _references(layout.extras, tables)),
        bonds=_bonds(setup.system, layout),
        watch=Watch(
            _indices(position[limit.signal] for limit in watched),
            sign=_reals(limit.sign for limit in watched),
            limit=_reals(limit.limit for limit in watched),
        ),
        loops=_loops(layout, position),
        levels=Levels(
            parts=_begins(count for counts in layout.levels for count in counts),
            groups=_begins(len(counts) for counts in layout.levels),
        ),
        direct=_direct(setup, tables, rows),
    )


def _moving(coupling: Coupling, name: str) -> list[Feed]:
    """Return the inputs of a component that change during a run; the others are set once."""
    return [feed for feed in coupling.feeds[name] if feed.is_moving]


def _integers(values: Iterable[int]) -> Integers:
    return np.array(list(values), dtype=np.int64)


def _indices(values: Iterable[int]) -> Indices:
    return np.array(list(values), dtype=np.uint32)


def _reals(values: Iterable[float]) -> Reals:
    return np.array(list(values), dtype=np.float64)


def _begins(counts: Iterable[int]) -> Indices:
    return _indices(accumulate(counts, initial=0))


def _references(names: Iterable[str], tables: Mapping[str, FunctionTable]) -> NDArray[np.uint32]:
    pairs = (name.partition(".")[::2] for name in names)
    return np.array([tables[part].references[variable] for part, variable in pairs], dtype=np.uint32)


def _parts(setup: RunSetup, tables: Mapping[str, FunctionTable]) -> Parts:
    coupling, names, following = setup.coupling, setup.layout.parts, setup.following
    columns = ("set_real", "set_slopes", "do_step", "get_real", "save", "restore", "instance")
    moving = [_moving(coupling, name) for name in names]
    inputs = [len(feeds) for feeds in moving]
    signals = [len(coupling.outputs[name]) for name in names]
    extras = [len(coupling.recorded[name]) for name in names]
    return Parts(
        **{column: _integers(getattr(tables[name], column) for name in names) for column in columns},
        ramps=_integers(int(coupling.components[name].capabilities.interpolates_inputs) for name in names),
        follows=_integers(int(name in following) for name in names),
        inputs=_begins(inputs),
        terms=_begins(sum(len(feed.terms) for feed in feeds) for feeds in moving),
        driven=_begins(sum(feed.drive is not None for feed in feeds) for feeds in moving),
        signals=_begins(signals),
        extras=_begins(extras),
        input_count=_integers(inputs),
        signal_count=_integers(signals),
        extra_count=_integers(extras),
    )


def _terms(coupling: Coupling, layout: Layout, feeds: Sequence[tuple[str, Feed]], position: Mapping[str, int]) -> Terms:
    rank = {name: k for k, name in enumerate(layout.parts)}
    held = (name for name in layout.parts if not coupling.components[name].capabilities.interpolates_inputs)
    direct = {name: coupling.direct_inputs(name) for name in held}
    rows = [(k, name, term) for k, (name, feed) in enumerate(feeds) for term in feed.terms]
    ends = [1.0 if feeds[k][1].target in direct.get(name, ()) else 0.5 for k, name, _ in rows]
    return Terms(
        source=_indices(position[term.source] for _, _, term in rows),
        target=_indices(k for k, _, _ in rows),
        early=_integers(int(rank[term.part] < rank[name]) for _, name, term in rows),
        weight=_reals(term.gain * term.conversion.factor for _, _, term in rows),
        offset=_reals(term.gain * term.conversion.offset for _, _, term in rows),
        start=_reals(1.0 - end for end in ends),
        end=_reals(ends),
    )


def _direct(setup: RunSetup, tables: Mapping[str, FunctionTable], feeds: Sequence[tuple[str, Feed]]) -> Direct:
    """Return the recorded outputs that follow inputs whose end values are assumed, of parts that give derivatives.

    Only continuous variables have derivatives.
    """
    components, recorded, is_jacobi = setup.system.components, setup.reals, setup.mode.kind == JACOBI
    rank = {name: k for k, name in enumerate(setup.layout.parts)}
    assumed: dict[str, dict[str, int]] = {name: {} for name in setup.layout.parts}
    for i, (name, feed) in enumerate(feeds):
        component = components[name]
        unknown = (is_jacobi or rank[term.part] >= rank[name] for term in feed.terms)
        is_assumed = not component.capabilities.interpolates_inputs or any(unknown)
        if is_assumed and component.variables[feed.target].variability == "continuous":
            assumed[name][feed.target] = i
    follows: dict[str, list[int]] = {}
    for column, name in enumerate(recorded):
        part, _, output = name.partition(".")
        variable = components[part].variables[output]
        has_derivatives = components[part].capabilities.derivatives and variable.variability == "continuous"
        if has_derivatives and variable.direct & assumed[part].keys():
            follows.setdefault(part, []).append(column)
    parts = [name for name in setup.layout.parts if name in follows and tables[name].derive]
    columns = [column for name in parts for column in follows[name]]
    return Direct(
        part=_indices(rank[name] for name in parts),
        derive=_integers(tables[name].derive for name in parts),
        outputs=_begins(len(follows[name]) for name in parts),
        column=_indices(columns),
        unknown=_references((recorded[column] for column in columns), tables),
        inputs=_begins(len(assumed[name]) for name in parts),
        input=_indices(i for name in parts for i in assumed[name].values()),
        known=_references((f"{name}.{target}" for name in parts for target in assumed[name]), tables),
    )


def _bonds(system: System, layout: Layout) -> Bonds:
    pairs = [(bond.velocity, bond.force) for bond in system.bonds]
    factor = {name: to_si(system.output(name))[0].factor for v, f in pairs for c in (v, f) for name in c.ends}
    return Bonds(
        _indices(layout.terms[v.ends] for v, _ in pairs),
        _indices(layout.terms[f.ends] for _, f in pairs),
        given=_reals(0.5 * factor[v.source] * factor[f.target] for v, f in pairs),
        taken=_reals(0.5 * factor[f.source] * factor[v.target] for v, f in pairs),
    )


def _loops(layout: Layout, position: Mapping[str, int]) -> Loops:
    """Return the unknowns of each group: sources that do not come before their target in the order."""
    rank = {name: k for k, name in enumerate(layout.parts)}
    group_of = np.repeat(np.arange(len(layout.groups)), layout.groups)
    home = {source: rank[source.partition(".")[0]] for source, _ in layout.terms}
    early = {source for source, target in layout.terms if home[source] >= rank[target.partition(".")[0]]}
    unknowns = sorted(early, key=lambda source: (group_of[home[source]], position[source]))
    counts = [sum(group_of[home[source]] == g for source in unknowns) for g in range(len(layout.groups))]
    return Loops(
        parts=_begins(layout.groups),
        unknowns=_begins(counts),
        signal=_indices(position[source] for source in unknowns),
        matrix=_begins(n * n for n in counts),
        least=np.full(len(unknowns), 1e-9),
    )


# ---- Recording: arrays of the recorded signals ----------------------------------------------------------------------


def blank_tape(setup: RunSetup) -> Tape:
    """Return a tape with space for all communication points that are recorded."""
    places = {name: k for k, name in enumerate((*setup.layout.signals, *setup.layout.extras))}
    columns, rows = np.array([places[name] for name in setup.reals], dtype=np.uint32), int(setup.recorded.sum()) + 1
    return Tape(np.zeros((rows, columns.size)), np.zeros(rows), columns, np.zeros(1, np.int64))


def recorded_series(setup: RunSetup, tape: Tape) -> TimeSeries:
    """Return the contents of a tape and the recorded discrete variables, in SI.

    Raises:
        StepError: A recorded value is not a number.
    """
    system, names, count = setup.system, setup.names, int(tape.position[0])
    is_real = np.array([name in setup.reals for name in names], dtype=bool)
    if is_real.all():
        values = np.ascontiguousarray(tape.rows[:count].T)
    else:
        values = np.empty((len(names), count))
        values[is_real] = tape.rows[:count].T
        values[~is_real] = np.array(setup.discrete.rows, dtype=np.float64).reshape(count, -1).T
    units = []
    for row, name in zip(values, names, strict=True):
        conversion, unit = to_si(system.output(name))
        units.append(unit)
        if conversion != Conversion():
            row[:] = conversion.factor * row + conversion.offset
        if not np.isfinite(row).all():
            raise StepError(
                f"{name} is not a number from {tape.times[int(np.argmin(np.isfinite(row)))]:g} s on: check the inputs "
                "and the log of its component, or remove it from the record list ([scenario] record)"
            )
    values.setflags(write=False)  # no other references exist, so no copy is needed
    return TimeSeries(tape.times[:count], values, names, tuple(units))
