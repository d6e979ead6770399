"""Outcome of a run: from recorded arrays to a result, with its notes."""

from __future__ import annotations

import weakref
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.components.component import Component, FunctionTable, free_states, to_si
from cosim.components.fmu_file import OpenedFmu
from cosim.engine.march import Tape
from cosim.engine.plan import ITERATIONS, LOOSE, REJECTED, STEPS, STOPPED, STUCK, Memory, Plan
from cosim.session.planning import real_names, recorded_series
from cosim.session.result import Result, judged_by
from cosim.session.setup import Setup
from cosim.session.verdict import BondEnergy, Coupled, models_of
from cosim.systems.algorithm import Algorithm
from cosim.systems.coupling import Coupling
from cosim.systems.system import Connection, System
from eightpost.errors import StepError
from eightpost.signals import TimeSeries

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

    def free_states(self, setup: Setup) -> None:
        """Free the states that the loop saved."""
        free_states([self.tables[name] for name in setup.layout.parts], self.memory.states, self.memory.calls)


@dataclass(frozen=True)
class Ending:
    """Ending of the loop."""

    why: int  #: Reason: DONE, STOPPED or STUCK of cosim.engine.plan.
    time: float  #: Time that was reached [s].
    least: float  #: Smallest step [s].
    largest: float  #: Largest step [s].
    began: float  #: Value of the clock (time.perf_counter) before the first step [s].
    ended_by: str = ""  #: Component that ended the simulation before the stop time; empty if none did.


# ---- Check that a repeated run gives the same bits, for systems with FMUs that this project did not build -----------

#: Number of different runs of one system that are remembered.
_RUNS = 16

#: Odd number, 2^64 divided by the golden ratio: multiplying a channel by an odd multiple of it keeps all of its bits.
_SPREAD = 0x9E3779B97F4A7C15


class _Run(NamedTuple):
    """Hashes of the bits of a run."""

    times: NDArray[np.uint64]  #: Hash per row (R,).
    components: Mapping[str, NDArray[np.uint64]]  #: Hash of the recorded variables of each component, per row (R,).


_known: dict[int, dict[object, _Run]] = {}


def check_repeat(setup: Setup, series: TimeSeries) -> None:
    """Compare a run with the first one of the same system, scenario, algorithm and step, if there is one.

    Args:
        setup: Setup of the run.
        series: Recorded series.

    Raises:
        StepError: The bits differ; the message names the foreign FMUs whose values differ first.
    """
    if all(map(_is_known, setup.system.components.values())):
        return
    runs, run = _runs_of(setup.system), _hashed(series)
    first = runs.setdefault(_key(setup), run)
    if len(runs) > _RUNS:
        del runs[next(iter(runs))]
    if first is not run:
        _compare(setup, series, first, run)


def _is_known(component: Component) -> bool:
    """Return whether a component needs no check: FMUs of eightpost and Python components need none."""
    return not isinstance(component, OpenedFmu) or component.is_ours


def _runs_of(system: System) -> dict[object, _Run]:
    """Return the runs of a system that are remembered, as long as the system exists."""
    if id(system) not in _known:
        _known[id(system)] = {}
        weakref.finalize(system, _known.pop, id(system), None)
    return _known[id(system)]


def _key(setup: Setup) -> object:
    scenario, algorithm = setup.scenario, setup.algorithm
    where = (scenario.stop, scenario.drive_start, tuple(scenario.targets.items()), setup.names)
    return where, scenario.record_step, scenario.drive, repr(algorithm), setup.step


def _hashed(series: TimeSeries) -> _Run:
    components: dict[str, NDArray[np.uint64]] = {}
    for k, name in enumerate(series.names):
        part = name.partition(".")[0]
        bits = series.values[k].view(np.uint64) * np.uint64(_SPREAD * (2 * k + 1) % 2**64)
        components[part] = components[part] + bits if part in components else bits
    return _Run(series.time.view(np.uint64).copy(), components)


def _compare(setup: Setup, series: TimeSeries, first: _Run, run: _Run) -> None:
    count = min(first.times.size, run.times.size)
    pairs = {name: (first.components[name][:count], run.components[name][:count]) for name in run.components}
    differs = {name: np.flatnonzero(a != b) for name, (a, b) in pairs.items()}
    row = min((int(rows[0]) for rows in differs.values() if rows.size), default=count)
    if row == count and first.times.size == run.times.size:
        return
    changed = [name for name, rows in differs.items() if rows.size and rows[0] == row]
    raise StepError(_text(setup, changed, float(series.time[min(row, series.time.size - 1)])))


def _text(setup: Setup, changed: list[str], time: float) -> str:
    foreign = [name for name, component in setup.system.components.items() if not _is_known(component)]
    named = [name for name in foreign if name in changed] or foreign
    files = ", ".join(f"{name!r} ({setup.system.components[name].source})" for name in named)
    return (
        f"this run differs from the last one of the same system, from {time:g} s on: component {files} keeps a state "
        "from run to run, or depends on random numbers or the clock, so none of its results can be trusted; run it "
        "in its own process, which is new for each run: --isolate, IsolatedComponent. If that does not help, "
        "ask its maker"
    )


# ---- Notes for the reader of a result, in sentences -----------------------------------------------------------------


def notes_of(
    system: System,
    coupling: Coupling,
    algorithm: Algorithm,
    equilibrium: Equilibrium,
    troubles: Iterable[str],
) -> tuple[str, ...]:
    """Return all notes of a run, the most important first."""
    return (
        *troubles,
        *_equilibrium_notes(equilibrium),
        *_order_notes(coupling, algorithm),
        *_held_notes(system, algorithm),
        *_unit_notes(system),
        *_gas_notes(system),
        *(f"{name}: {message}" for name, c in system.components.items() for message in c.messages),
    )


def _equilibrium_notes(equilibrium: Equilibrium) -> Iterator[str]:
    if not equilibrium.converged:
        yield (
            f"the start is not an equilibrium: a connection still changes by {equilibrium.residual:.1e} of its size; "
            "the beginning of the result contains a transient"
        )


def _order_notes(coupling: Coupling, algorithm: Algorithm) -> Iterator[str]:
    if not coupling.order()[1]:
        yield (
            "the declared direct terms form a loop between components: "
            f"{algorithm.name} steps through it with a lag of one step"
        )


def _unit_notes(system: System) -> Iterator[str]:
    unstated = sorted(
        f"{name}.{v.name}"
        for name, component in system.components.items()
        for v in component.variables.values()
        if v.unit is None and v.type == "Real" and v.causality in ("input", "output")
    )
    if unstated:
        yield f"no unit stated, values used without conversion: {', '.join(unstated)}"


def _gas_notes(system: System) -> Iterator[str]:
    """Note that a gas force may be counted twice: in the static loads of the car and in a shock's own preload."""
    values = {
        f"{name}.{v.name}": system.parameters.get(name, {}).get(v.name, v.start)
        for name, component in system.components.items()
        for v in component.variables.values()
        if v.name == "gas_preload" or v.name.endswith("static_tire_force")
    }
    given = [name for name, value in values.items() if float(value or 0.0) != 0.0]
    shocks = [name.partition(".")[0] for name in given if name.endswith("gas_preload")]
    if shocks and len(shocks) < len(given):
        yield (
            f"the car has static tire forces, and {', '.join(shocks)} have a gas preload of their own: if the static "
            "state includes the gas force, it counts twice (fit with --gas included, or set gas_preload = 0)"
        )


def _held_notes(system: System, algorithm: Algorithm) -> Iterator[str]:
    """Note the components that hold their inputs although the algorithm ramps coupling values."""
    held = sorted(name for name, c in system.components.items() if not c.capabilities.interpolates_inputs)
    if held and getattr(algorithm, "values", "") != "held":
        yield f"{', '.join(held)} cannot interpolate inputs (canInterpolateInputs): they are held over each step"


# ---- Result of a run ------------------------------------------------------------------------------------------------

#: Directions of a bond.
_WAYS = ("velocity", "force")


class _End(NamedTuple):
    """Values for one direction of a bond: root mean square of its local error, standard deviation, SI unit of both."""

    error: float
    spread: float
    unit: str


@dataclass(frozen=True)
class Outcome:
    """A run that has ended."""

    setup: Setup  #: Setup of the run.
    running: Running  #: State in which the loop left the run.
    equilibrium: Equilibrium  #: Status of the equilibrium start.
    ending: Ending  #: Ending of the loop.
    seconds: tuple[float, float]  #: Wall time before the steps and of the steps [s].

    def result(self) -> Result:
        """Return the result.

        Raises:
            StepError: A recorded value is not a number.
        """
        setup, counts, watched = self.setup, self.running.memory.counts, self.running.memory.watched.tolist()
        components, energy, coupled = setup.system.components, self._energy(), self._coupled()
        return Result(
            series=recorded_series(setup.system, setup.names, self.running.tape, setup.discrete.rows),
            converged=bool(self.equilibrium.converged and self.ending.why != STUCK and counts[LOOSE] == 0),
            notes=notes_of(setup.system, setup.coupling, setup.algorithm, self.equilibrium, self._troubles()),
            algorithm=setup.algorithm.name,
            order=setup.layout.parts,
            step=self.ending.least,
            steps=int(counts[STEPS]),
            seconds=sum(self.seconds),
            stepping_seconds=self.seconds[1],
            equilibrium_sweeps=self.equilibrium.sweeps,
            energy=energy,
            coupled=coupled,
            iterations=int(counts[ITERATIONS]),
            rejected_steps=int(counts[REJECTED]),
            unsettled_steps=int(counts[LOOSE]),
            steps_of_all_runs=int(counts[STEPS]),
            largest_step=self.ending.largest,
            partial=self.ending.why in (STOPPED, STUCK),
            ended_by=self.ending.ended_by,
            ended_at=self.ending.time if self.ending.ended_by else None,
            held_direct=self._held_direct(),
            identities={name: component.identity for name, component in components.items()},
            sources={name: component.source for name, component in components.items()},
            parameters={name: dict(values) for name, values in setup.system.parameters.items() if values},
            settling=setup.scenario.settling,
            **setup.limits.shares(watched),
            decisive=setup.system.decisive,
            models=models_of(setup.system, setup.names),
        )

    def _held_direct(self) -> tuple[str, ...]:
        """Return the recorded outputs that follow, without delay, an input that was held over each step.

        Those of components that give directional derivatives are corrected.
        """
        system, held = self.setup.system, self.setup.coupling.held_inputs()
        reals = real_names(system, self.setup.names)
        corrected = {reals[column] for column in self.running.plan.direct.column}
        return tuple(
            name
            for name in self.setup.names
            if name not in corrected
            and any(f"{name.partition('.')[0]}.{source}" in held for source in system.output(name).direct)
        )

    def _energy(self) -> dict[str, BondEnergy]:
        m = self.running.memory
        return {
            bond.name: BondEnergy(float(m.residual[k]), float(m.transferred[k]))
            for k, bond in enumerate(self.setup.system.bonds)
        }

    def _coupled(self) -> dict[str, Coupled]:
        """Return the local errors of each bond over the whole run, in SI."""
        ends = {(bond.name, way): self._end(k, way) for k, bond in enumerate(self.setup.system.bonds) for way in _WAYS}
        scale = judged_by({key: end.spread for key, end in ends.items()}, {key: end.unit for key, end in ends.items()})
        return {
            bond.name: Coupled(
                *(x for way in _WAYS for x in ends[bond.name, way][:2]), *(scale[bond.name, way] for way in _WAYS)
            )
            for bond in self.setup.system.bonds
        }

    def _end(self, number: int, way: str) -> _End:
        """Return the local error and the spread of one direction of a bond."""
        connection: Connection = getattr(self.setup.system.bonds[number], way)
        m, term = self.running.memory, int(getattr(self.running.plan.bonds, way)[number])
        conversion, unit = to_si(self.setup.system.output(connection.target))
        time = float(m.duration[0]) or 1.0
        variance = m.squares[term] / time - (m.total[term] / time) ** 2
        share = self.setup.accuracy_of(connection.target).share
        return _End(
            share * float(np.sqrt(m.defect[term] / time)) * conversion.factor,
            float(np.sqrt(max(variance, 0.0))) * conversion.factor,
            unit,
        )

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
