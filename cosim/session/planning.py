"""The flat arrays that the loop uses and records, for the setup of a run; their result, with its notes."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.components.component import Conversion, FunctionTable, free_states, to_si
from cosim.components.watch import OpenedFmu
from cosim.engine.march import Tape
from cosim.engine.plan import (
    ITERATIONS,
    JACOBI,
    LOOSE,
    REJECTED,
    STEPS,
    STOPPED,
    STUCK,
    Bonds,
    Direct,
    Driven,
    Indices,
    Inputs,
    Integers,
    Levels,
    Loops,
    Memory,
    Parts,
    Plan,
    Reals,
    Signals,
    Terms,
    Watch,
)
from cosim.session.result import Result, judged_by
from cosim.session.setup import Layout, RunSetup
from cosim.session.verdict import BondEnergy, Coupled, models_of
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


def _recorded_series(setup: RunSetup, tape: Tape) -> TimeSeries:
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


# ---- State of a run, and its end ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Equilibrium:
    """Status of the equilibrium start."""

    converged: bool  #: Whether every connection agrees to 1e-9 of its size.
    sweeps: int  #: Number of evaluations of all components.
    residual: float  #: Largest remaining disagreement, relative to its connection's size.


@dataclass(frozen=True)
class Running:
    """Components that have begun, in the form that the loop uses."""

    plan: Plan  #: Arrays that do not change.
    memory: Memory  #: Arrays that the run changes.
    tape: Tape  #: Recorded values.
    tables: Mapping[str, FunctionTable]  #: Functions by component.

    def stop(self) -> None:
        """Make the loop stop before its next step."""
        self.memory.stop.fill(1)

    def free_states(self, setup: RunSetup) -> None:
        """Free the states that the loop saved."""
        free_states([self.tables[name] for name in setup.layout.parts], self.memory.states, self.memory.calls)


class Ending(NamedTuple):
    """Ending of the loop."""

    why: int  #: Reason: DONE, STOPPED or STUCK of cosim.engine.plan.
    time: float  #: Time that was reached [s].
    least: float  #: Smallest step [s].
    largest: float  #: Largest step [s].
    began: float  #: Value of the clock (time.perf_counter) before the first step [s].
    ended_by: str  #: Component that ended the simulation before the stop time; empty if none did.


# ---- Check that a repeated run gives the same bits, for systems with FMUs that this project did not build -----------

#: Number of different runs of one system that are remembered.
_RUNS = 16

#: Odd number, 2^64 divided by the golden ratio: multiplying a channel by an odd multiple of it keeps all of its bits.
_SPREAD = 0x9E3779B97F4A7C15


#: Hashes of the bits of a run: times (R,), and the recorded variables of each component (R,).
_Run = tuple[NDArray[np.uint64], dict[str, NDArray[np.uint64]]]

_first_runs: dict[int, dict[object, _Run]] = {}


def check_repeat(setup: RunSetup, series: TimeSeries) -> None:
    """Compare a run with the first one of the same system, scenario, algorithm and step, if there is one.

    Raises:
        StepError: The bits differ; the message names the foreign FMUs whose values differ first.
    """
    system, scenario = setup.system, setup.scenario
    if not system.has_foreign_fmus:
        return
    if id(system) not in _first_runs:
        _first_runs[id(system)] = {}
        weakref.finalize(system, _first_runs.pop, id(system), None)
    runs, run = _first_runs[id(system)], _hashed(series)
    where = (scenario.stop, scenario.drive_start, tuple(scenario.targets.items()), setup.names)
    key = where, scenario.record_step, scenario.drive, repr(setup.algorithm), setup.step
    first = runs.setdefault(key, run)
    if len(runs) > _RUNS:
        del runs[next(iter(runs))]
    if first is not run:
        _compare(setup, series, first, run)


def _hashed(series: TimeSeries) -> _Run:
    components: dict[str, NDArray[np.uint64]] = {}
    for k, name in enumerate(series.names):
        part = name.partition(".")[0]
        bits = series.values[k].view(np.uint64) * np.uint64(_SPREAD * (2 * k + 1) % 2**64)
        components[part] = components[part] + bits if part in components else bits
    return series.time.view(np.uint64).copy(), components


def _compare(setup: RunSetup, series: TimeSeries, first: _Run, run: _Run) -> None:
    count = min(first[0].size, run[0].size)
    differs = {name: np.flatnonzero(first[1][name][:count] != bits[:count]) for name, bits in run[1].items()}
    row = min((int(rows[0]) for rows in differs.values() if rows.size), default=count)
    if row == count and first[0].size == run[0].size:
        return
    components = setup.system.components.items()  # Python components are not checked
    foreign = {name: c.source for name, c in components if isinstance(c, OpenedFmu) and not c.is_ours}
    changed = [name for name in foreign if name in differs and row in differs[name][:1]]
    files = ", ".join(f"{name!r} ({foreign[name]})" for name in changed or foreign)
    time = float(series.time[min(row, series.time.size - 1)])
    raise StepError(
        f"this run differs from the last one of the same system, from {time:g} s on: component {files} keeps a state "
        "from run to run, or depends on random numbers or the clock, so none of its results can be trusted; run it "
        "in its own process, which is new for each run: --isolate, IsolatedComponent. If that does not help, "
        "ask its maker"
    )


# ---- Notes for the reader of a result, in sentences -----------------------------------------------------------------


def _unit_notes(system: System) -> Iterator[str]:
    unstated = sorted(
        name
        for name, v in system.variables()
        if v.unit is None and v.type == "Real" and v.causality in ("input", "output")
    )
    if unstated:
        yield f"no unit stated, values used without conversion: {', '.join(unstated)}"


def _gas_notes(system: System) -> Iterator[str]:
    """Note that a gas force may be counted twice: in the static loads of the car and in a shock's own preload."""
    values = {
        name: system.parameters.get(name.partition(".")[0], {}).get(v.name, v.start)
        for name, v in system.variables()
        if v.name == "gas_preload" or v.name.endswith("static_tire_force")
    }
    stated = [name for name, value in values.items() if float(value or 0.0) != 0.0]
    shocks = [name.partition(".")[0] for name in stated if name.endswith("gas_preload")]
    if shocks and len(shocks) < len(stated):
        yield (
            f"the car has static tire forces, and {', '.join(shocks)} have a gas preload of their own: if the static "
            "state includes the gas force, it counts twice (fit with --gas included, or set gas_preload = 0)"
        )


# ---- Result of a run ------------------------------------------------------------------------------------------------

#: Directions of a bond.
_WAYS = ("velocity", "force")


@dataclass(frozen=True)
class Outcome:
    """A run that has ended."""

    setup: RunSetup  #: Setup of the run.
    running: Running  #: State in which the loop left the run.
    equilibrium: Equilibrium  #: Status of the equilibrium start.
    ending: Ending  #: Ending of the loop.
    seconds: tuple[float, float]  #: Wall time before the steps and of the steps [s].

    def result(self) -> Result:
        """Return the result.

        Raises:
            StepError: A recorded value is not a number.
        """
        setup, m, ending = self.setup, self.running.memory, self.ending
        system, counts = setup.system, m.counts
        return Result(
            series=_recorded_series(setup, self.running.tape),
            converged=bool(self.equilibrium.converged and ending.why != STUCK and counts[LOOSE] == 0),
            notes=tuple(self._notes()),
            algorithm=setup.algorithm.name,
            order=setup.layout.parts,
            step=ending.least,
            steps=int(counts[STEPS]),
            seconds=sum(self.seconds),
            stepping_seconds=self.seconds[1],
            equilibrium_sweeps=self.equilibrium.sweeps,
            energy={
                bond.name: BondEnergy(float(m.residual[k]), float(m.transferred[k]))
                for k, bond in enumerate(system.bonds)
            },
            coupled=self._coupled(),
            iterations=int(counts[ITERATIONS]),
            rejected_steps=int(counts[REJECTED]),
            unsettled_steps=int(counts[LOOSE]),
            steps_of_all_runs=int(counts[STEPS]),
            largest_step=ending.largest,
            partial=ending.why in (STOPPED, STUCK),
            ended_by=ending.ended_by,
            ended_at=ending.time if ending.ended_by else None,
            held_direct=self._held_direct(),
            identities={name: component.identity for name, component in system.components.items()},
            sources={name: component.source for name, component in system.components.items()},
            parameters={name: dict(values) for name, values in system.parameters.items() if values},
            settling=setup.scenario.settling,
            **setup.limits.shares(m.watched.tolist()),
            has_loop=setup.coupling.has_loop,
            decisive=system.decisive,
            models=models_of(system, setup.names),
        )

    def _held_direct(self) -> tuple[str, ...]:
        """Return the recorded outputs that follow, without delay, an input that was held over each step.

        Those of components that give directional derivatives are corrected.
        """
        setup, held = self.setup, self.setup.coupling.held_inputs()
        corrected = {setup.reals[column] for column in self.running.plan.direct.column}
        return tuple(
            name
            for name in setup.names
            if name not in corrected
            and any(f"{name.partition('.')[0]}.{source}" in held for source in setup.system.output(name).direct)
        )

    def _coupled(self) -> dict[str, Coupled]:
        bonds = self.setup.system.bonds
        ends = {(bond.name, way): self._end(k, way) for k, bond in enumerate(bonds) for way in _WAYS}
        scale = judged_by({key: end[1] for key, end in ends.items()}, {key: end[2] for key, end in ends.items()})
        values = {b.name: [x for way in _WAYS for x in ends[b.name, way][:2]] for b in bonds}
        return {name: Coupled(*row, *(float(scale[name, way]) for way in _WAYS)) for name, row in values.items()}

    def _end(self, number: int, way: str) -> tuple[float, float, str]:
        """Return local error and standard deviation of one direction of a bond, and the SI unit of both."""
        target = getattr(self.setup.system.bonds[number], way).target
        m, term = self.running.memory, int(getattr(self.running.plan.bonds, way)[number])
        conversion, unit = to_si(self.setup.system.output(target))
        time = float(m.duration[0]) or 1.0
        variance = m.squares[term] / time - (m.total[term] / time) ** 2
        error = self.setup.accuracy_of(target).share * float(np.sqrt(m.defect[term] / time))
        return error * conversion.factor, float(np.sqrt(max(variance, 0.0))) * conversion.factor, unit

    def _notes(self) -> Iterator[str]:
        setup, system = self.setup, self.setup.system
        yield from self._troubles()
        if not self.equilibrium.converged:
            yield (
                f"the start is not an equilibrium: a connection still changes by {self.equilibrium.residual:.1e} of "
                "its size; the beginning of the result contains a transient"
            )
        if not setup.coupling.order()[1]:
            yield (
                "the declared direct terms form a loop between components: "
                f"{setup.algorithm.name} steps through it with a lag of one step"
            )
        held = sorted(name for name, c in system.components.items() if not c.capabilities.interpolates_inputs)
        if held and getattr(setup.algorithm, "values", "") != "held":
            yield f"{', '.join(held)} cannot interpolate inputs (canInterpolateInputs): they are held over each step"
        yield from _unit_notes(system)
        yield from _gas_notes(system)
        yield from (f"{name}: {message}" for name, c in system.components.items() for message in c.messages)

    def _troubles(self) -> Iterator[str]:
        counts, ending = self.running.memory.counts, self.ending
        if counts[LOOSE]:
            yield (
                f"{counts[LOOSE]} of {counts[STEPS]} steps did not converge: use a smaller coupling step, and do "
                "not use this result"
            )
        if ending.why == STUCK:
            yield (
                f"the coupling step reached its minimum at {ending.time:g} s without meeting the "
                "tolerance: the run ends there; allow a smaller step or a larger tolerance"
            )
        if name := ending.ended_by:
            source, stop = self.setup.system.components[name].source, self.setup.scenario.stop
            yield (
                f"component {name!r} ({source}) ended the simulation at {ending.time:g} s of {stop:g} s: "
                "the result ends there"
            )
        if ending.why == STOPPED:
            yield "the run was interrupted: the result contains what was computed until then"
