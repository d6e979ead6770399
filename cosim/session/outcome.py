"""Outcome of a run: from recorded arrays to a result, with its notes."""

from __future__ import annotations

import weakref
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.components.component import FunctionTable, free_states, to_si
from cosim.components.fmu_log import OpenedFmu
from cosim.engine.march import Tape
from cosim.engine.plan import ITERATIONS, LOOSE, REJECTED, STEPS, STOPPED, STUCK, Memory, Plan
from cosim.session.planning import recorded_series
from cosim.session.result import Result, judged_by
from cosim.session.setup import RunSetup
from cosim.session.verdict import BondEnergy, Coupled, models_of
from cosim.systems.system import System
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
            series=recorded_series(setup, self.running.tape),
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
