"""One run of a system with one algorithm: everything resolved and checked before the first component begins."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.algorithm import HELD_INPUTS, Accuracy, Adaptive, Algorithm
from cosim.conversion import to_si
from cosim.coupling import Coupling
from cosim.energy import BondEnergy
from cosim.engine.loop import can_compile, loop
from cosim.engine.march import Control, Grid, Knots, Progress, Tape, record
from cosim.engine.plan import (
    DIVERGED,
    DONE,
    ITERATIONS,
    LOOSE,
    REJECTED,
    STEPS,
    STOPPED,
    STUCK,
    Memory,
    Mode,
    Plan,
    memory,
)
from cosim.equilibrium import Equilibrium, solve_equilibrium
from cosim.functions import Callbacks, FunctionTable, Native, free_states, function_table
from cosim.interrupt import interrupts_deferred
from cosim.limits import LimitWatch
from cosim.notes import notes_of
from cosim.planning import lay_out, make_plan
from cosim.recorder import blank_tape, recorded_names, recorded_series, recorded_steps
from cosim.result import Coupled, Result, held_direct_outputs
from cosim.scenario import Scenario
from cosim.system import System
from eightpost.errors import InputError, StepError, WiringError

Array = NDArray[np.float64]

_CALLS = ("set inputs", "set input derivatives", "step", "give outputs", "save its state", "restore its state")


#: Local error that is allowed from the start on, by SI unit: far below what a sensor tells.
_LEAST_ERROR = {"m/s": 1e-5, "m": 1e-6, "N": 1e-2}


#: What else may be stable where a scheme is not.
_OTHERS = {"jacobi": ", gauss-seidel, or implicit", "gauss-seidel": ", or implicit"}


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C during a run; `result` holds what was computed."""

    def __init__(self, result: Result) -> None:
        super().__init__("the run was interrupted")
        self.result = result


@dataclass
class _Running:
    """What exists while components step."""

    plan: Plan
    memory: Memory
    tape: Tape
    tables: Mapping[str, FunctionTable]


class Session:
    """A system, a scenario, an algorithm and a step, ready to run once.

    Raises:
        WiringError: System, scenario and algorithm do not fit together.
        InputError: The coupling step does not fit.
    """

    def __init__(self, system: System, scenario: Scenario, algorithm: Algorithm, step: float) -> None:
        self._system, self._scenario, self._algorithm, self._step = system, scenario, algorithm, step
        self._names = recorded_names(system, scenario)
        self._limits = LimitWatch(system)
        self._coupling = Coupling(system, scenario, every_step=self._limits.names, recorded=self._names)
        self._layout = lay_out(self._coupling, algorithm.order(self._coupling))
        own = isinstance(algorithm, Adaptive) and scenario.record_step is not None
        grid = scenario.record_step if own and scenario.record_step is not None else step
        self._times = coupling_times(scenario.stop, grid)
        self._recorded = recorded_steps(scenario, grid, self._times.size - 1)
        _check_variable_step(system, self._times, step, algorithm)
        _check_repeats(system, algorithm)

    def run(self, engine: str = "auto", progress: Callable[[float], None] | None = None) -> Result:
        """Begin, find the coupled start, step to the end. The components are finished whatever happens.

        Raises:
            StepError: A component failed, or the coupling diverged.
            RunInterrupted: Ctrl-C; it holds the result so far.
        """
        began = clock.perf_counter()
        try:
            equilibrium = self._start()
            running = self._prepare()
            seconds = clock.perf_counter()
            try:
                with interrupts_deferred(lambda: running.memory.stop.fill(1)):
                    end = self._march(running, engine, progress or (lambda _: None))
            finally:
                free_states([running.tables[name] for name in self._layout.parts], running.memory.states)
            result = self._result(running, equilibrium, (seconds - began, clock.perf_counter() - seconds), end)
            if end == STOPPED:
                raise RunInterrupted(result)
            return result
        finally:
            for component in self._system.components.values():
                component.finish()

    def _start(self) -> Equilibrium:
        coupling = self._coupling
        for name, component in self._system.components.items():
            component.begin(0.0, self._scenario.stop, self._system.parameters.get(name, {}))
        equilibrium = solve_equilibrium(coupling, self._layout.order)
        for name in self._layout.order:
            self._system.components[name].end_initialization()
            coupling.now.update(coupling.read(name))
        return equilibrium

    def _prepare(self) -> _Running:
        tables = {name: function_table(component) for name, component in self._system.components.items()}
        plan = make_plan(
            self._system,
            self._coupling,
            self._layout,
            tables,
            watched=self._limits.watched,
            following=self._following(),
        )
        m = memory(plan)
        m.now[:] = m.ahead[:] = m.past[:] = [self._coupling.now[name] for name in self._layout.signals]
        rows = int(self._recorded.sum()) + 1
        return _Running(plan, m, blank_tape(self._layout, self._names, rows), tables)

    def _following(self) -> frozenset[str]:
        """Components that the drive moves and that take any step: they go from each of its points to the next."""
        driven = {name for name, feeds in self._coupling.feeds.items() if any(f.drive is not None for f in feeds)}
        return frozenset(name for name in driven if self._system.components[name].capabilities.variable_step)

    def _march(self, running: _Running, engine: str, progress: Callable[[float], None]) -> int:
        adaptive = isinstance(self._algorithm, Adaptive)
        native = any(isinstance(component, Native) for component in self._system.components.values())
        march, chunk = loop(engine if native or engine == "compiled" else "python", adaptive=adaptive)
        if engine == "compiled" and not can_compile():
            raise InputError("the compiled loop needs numba, which is not installed: pip install numba, or engine auto")
        mode = self._algorithm.mode(self._scenario.settling)
        record(running.plan, running.memory, running.tape, 0.0)
        step_on = self._march_adaptive if adaptive else self._march_fixed
        end = step_on(running, march, chunk, mode, progress)
        progress(1.0)
        return end

    def _march_fixed(
        self, running: _Running, march: Callable[..., int], chunk: int, mode: Mode, progress: Callable[[float], None]
    ) -> int:
        grid, count = self._grid(), self._times.size - 1
        for first in range(0, count, chunk):
            last = min(first + chunk, count)
            end = march(running.plan, running.memory, running.tape, grid, mode, first, last)
            if end == STOPPED:
                return end
            if end != DONE:
                self._fail(running, end, float(self._times[int(running.memory.failure[3])]))
            progress(last / count)
        return DONE

    def _grid(self) -> Grid:
        """Coupling points, and with them the drive's own points between them."""
        drive, times = self._scenario.drive, self._times
        if drive is not None and self._following():
            own = drive.series.time - self._scenario.drive_start
            times = _joined(times, own[(own > 0.0) & (own < self._scenario.stop)])
        begins = np.searchsorted(times, self._times)
        return Grid(self._times, self._recorded, begins, times, *self._drive_rows(times))

    def _drive_rows(self, times: Array) -> tuple[Array, Array]:
        drive = self._scenario.drive
        if drive is None:
            return np.zeros((times.size, 0)), np.zeros((times.size - 1, 0))
        times = times + self._scenario.drive_start
        samples = np.ascontiguousarray(drive.sample(times).T)
        if all(c.capabilities.interpolates_inputs for c in self._system.components.values()):
            return samples, np.zeros((times.size - 1, 0))
        return samples, np.ascontiguousarray(drive.means(times).T)

    def _march_adaptive(
        self, running: _Running, march: Callable[..., int], chunk: int, mode: Mode, progress: Callable[[float], None]
    ) -> int:
        assert isinstance(self._algorithm, Adaptive)
        knots, control = self._knots(), self._control()
        state = _first_progress(self._step, control, running.memory.now.size, knots.values.shape[1])
        self._kept, self._progress = memory(running.plan), state
        arguments = (running.plan, running.memory, self._kept, running.tape, knots, mode, control, state)
        while True:
            end = march(*arguments, max(1, chunk // 10))
            if end in (STOPPED, STUCK) or running.memory.failure[3] == 1:
                return end
            if end != DONE:
                self._fail(running, end, float(state.time[0]))
            progress(min(1.0, float(state.time[0]) / self._scenario.stop))

    def _knots(self) -> Knots:
        """The drive's own points within the run, and every time to land on."""
        stop, recorded = self._scenario.stop, self._times[self._recorded == 1][1:]
        drive = self._scenario.drive
        if drive is None:
            return Knots(np.zeros(0), np.zeros((1, 0)), recorded, np.ones(recorded.size, np.int64))
        own = drive.series.time - self._scenario.drive_start
        own = np.concatenate([[0.0], own[(own > 0.0) & (own < stop)], [stop]])
        values = np.ascontiguousarray(drive.sample(own + self._scenario.drive_start).T)
        events = _merged(np.concatenate([own[1:], recorded]))
        near = np.abs(events - recorded[np.clip(np.searchsorted(recorded, events), 0, recorded.size - 1)])
        before = np.abs(events - recorded[np.clip(np.searchsorted(recorded, events) - 1, 0, recorded.size - 1)])
        return Knots(own, values, events, (np.minimum(near, before) < 1e-9 * stop).astype(np.int64))

    def _control(self) -> Control:
        algorithm = self._algorithm
        assert isinstance(algorithm, Adaptive)
        coupled = sorted({source for source, _ in self._layout.terms})
        if unknown := sorted(set(algorithm.absolute) - set(coupled)):
            raise WiringError(f"adaptive: {unknown[0]} is no coupled signal; those are {', '.join(coupled)}")
        return Control(
            np.array([self._layout.signals.index(name) for name in coupled], dtype=np.int64),
            np.array([algorithm.absolute.get(name, self._least_error(name)) for name in coupled]),
            algorithm.relative,
            self._accuracy().order,
            algorithm.least,
            min(algorithm.largest, self._scenario.stop),
        )

    def _least_error(self, name: str) -> float:
        """What an adaptive run allows in every step, in the signal's own unit."""
        conversion, unit = to_si(self._system.output(name))
        return _LEAST_ERROR.get(unit, 1e-9) / abs(conversion.factor)

    def _accuracy(self) -> Accuracy:
        ramped = all(c.capabilities.interpolates_inputs for c in self._system.components.values())
        return self._algorithm.accuracy if ramped else HELD_INPUTS

    def _fail(self, running: _Running, end: int, time: float) -> None:
        failure = running.memory.failure
        if end == DIVERGED:
            name = self._layout.signals[int(failure[1])]
            raise StepError(
                f"the coupling diverged: {name} is {running.memory.ahead[failure[1]]:g} after {time:g} s; take a "
                f"smaller coupling step{_OTHERS.get(self._algorithm.name, '')} (docs/coupling.md)"
            )
        part = int(failure[1])
        name = self._layout.parts[part]
        table = running.tables[name]
        if isinstance(table.keep, tuple) and isinstance(table.keep[0], Callbacks) and table.keep[0].error is not None:
            raise table.keep[0].error
        component, what = self._system.components[name], _CALLS[int(failure[2])]
        if isinstance(component, Native):
            raise component.refused(what, int(failure[0]), time, self._inputs_of(running, part))
        raise StepError(f"component {name!r} ({component.source}) failed to {what} at {time:g} s")

    def _inputs_of(self, running: _Running, part: int) -> dict[str, float]:
        name, rows = self._layout.parts[part], running.plan.parts.inputs
        moving = [f.target for f in self._coupling.feeds[name] if f.terms or f.drive is not None]
        return dict(zip(moving, running.memory.value[rows[part] : rows[part + 1]].tolist(), strict=True))

    def _result(self, running: _Running, equilibrium: Equilibrium, seconds: tuple[float, float], end: int) -> Result:
        m, counts = running.memory, running.memory.counts
        bonds = {bond.name: k for k, bond in enumerate(self._system.bonds)}
        energy = {name: BondEnergy(float(m.residual[k]), float(m.transferred[k])) for name, k in bonds.items()}
        coupled = {
            name: _coupled(self._system, running.plan, m, k, self._accuracy().share) for name, k in bonds.items()
        }
        settled = equilibrium.converged and end != STUCK and counts[LOOSE] == 0
        progress = getattr(self, "_progress", None)
        watched = m.watched.tolist()
        return Result(
            series=recorded_series(self._system, self._names, running.tape),
            converged=bool(settled),
            notes=notes_of(
                self._system, self._coupling, self._algorithm, equilibrium, energy, coupled, self._troubles(m, end)
            ),
            algorithm=self._algorithm.name,
            order=self._layout.order,
            step=self._step if progress is None else float(progress.smallest[0]),
            steps=int(counts[STEPS]),
            seconds=sum(seconds),
            stepping_seconds=seconds[1],
            equilibrium_sweeps=equilibrium.sweeps,
            energy=energy,
            coupled=coupled,
            iterations=int(counts[ITERATIONS]),
            rejected_steps=int(counts[REJECTED]),
            largest_step=self._step if progress is None else float(progress.greatest[0]),
            partial=end in (STOPPED, STUCK),
            held_direct=held_direct_outputs(self._system, self._coupling.held_inputs(), self._names),
            identities={name: component.identity for name, component in self._system.components.items()},
            sources={name: component.source for name, component in self._system.components.items()},
            parameters={name: dict(values) for name, values in self._system.parameters.items() if values},
            settling=self._scenario.settling,
            share_beyond_fit=self._limits.beyond_fit(watched),
            share_tire_off=self._limits.tire_off(watched),
        )

    def _troubles(self, m: Memory, end: int) -> Iterator[str]:
        if m.counts[LOOSE]:
            yield (
                f"{m.counts[LOOSE]} of {m.counts[STEPS]} steps did not converge: take a smaller coupling step, and do "
                "not use this result"
            )
        if end == STUCK:
            yield (
                f"the coupling step went down to its least at {float(self._progress.time[0]):g} s without meeting the "
                "tolerance: the run ends there; allow a smaller step or a larger tolerance"
            )
        if end == STOPPED:
            yield "the run was interrupted: this is what was computed until then"


def coupling_times(stop: float, step: float) -> Array:
    """Return the coupling points (K+1,) [s]: whole multiples of the step, so that they do not drift, and the stop.

    Raises:
        InputError: The step is not positive, or longer than the run.
    """
    if not (np.isfinite(step) and 0.0 < step <= stop):
        raise InputError(f"the coupling step must be positive and at most the run ({stop} s), not {step!r} s")
    count = max(1, int(np.ceil(stop / step * (1.0 - 1e-12))))
    times: Array = np.arange(count + 1, dtype=np.float64) * step
    times[-1] = stop
    return times


def _joined(times: Array, others: Array) -> Array:
    """All times in order; of those that differ by rounding only, the first array's, to the bit."""
    place = np.searchsorted(times, others)
    near = np.minimum(np.abs(others - times[np.maximum(place - 1, 0)]), np.abs(others - times[place]))
    return np.union1d(times, others[near > 1e-9 * times[-1]])


def _merged(times: Array) -> Array:
    """Sorted, without those that differ by rounding only."""
    times = np.sort(times)
    kept: Array = times[np.append(np.diff(times) > 1e-9 * times[-1], True)]
    return kept


def _first_progress(step: float, control: Control, signals: int, channels: int) -> Progress:
    first = min(max(step, control.least), control.largest)
    return Progress(
        time=np.zeros(1),
        step=np.array([first]),
        error=np.ones(1),
        event=np.zeros(1, np.int64),
        knot=np.zeros(1, np.int64),
        smallest=np.full(1, np.inf),
        greatest=np.zeros(1),
        scale=np.zeros(control.signal.size),
        once=np.zeros(signals),
        drive=np.zeros((3, channels)),
        ends=np.zeros(2),
    )


def _coupled(system: System, plan: Plan, m: Memory, bond: int, share: float) -> Coupled:
    """What the ends of a bond assumed of each other, over the whole run, in SI."""
    velocity, force = system.bonds[bond].velocity, system.bonds[bond].force
    to_velocity, to_force = (to_si(system.output(end.target))[0].factor for end in (velocity, force))
    return Coupled(
        *_way(m, int(plan.bonds.velocity[bond]), to_velocity, share),
        *_way(m, int(plan.bonds.force[bond]), to_force, share),
    )


def _way(m: Memory, term: int, factor: float, share: float) -> tuple[float, float]:
    """Local error and spread of what a term gives, root mean squares."""
    time = float(m.duration[0]) or 1.0
    spread = m.squares[term] / time - (m.total[term] / time) ** 2
    return share * float(np.sqrt(m.defect[term] / time)) * factor, float(np.sqrt(max(spread, 0.0))) * factor


def _check_variable_step(system: System, times: Array, step: float, algorithm: Algorithm) -> None:
    """Refuse steps of several sizes for a component that takes one only."""
    if not isinstance(algorithm, Adaptive) and abs(times[-1] - times[-2] - step) <= 1e-9 * step:
        return
    for name, component in system.components.items():
        if not component.capabilities.variable_step:
            raise WiringError(
                f"{name} takes steps of one size only, and the stop time is not a whole number of coupling steps of "
                f"{step} s; change one of them"
                if not isinstance(algorithm, Adaptive)
                else f"{name} takes steps of one size only: adaptive cannot step it"
            )


def _check_repeats(system: System, algorithm: Algorithm) -> None:
    if not algorithm.repeats:
        return
    for name, component in system.components.items():
        if not component.capabilities.state:
            raise WiringError(
                f"{algorithm.name} repeats steps, and {name} ({component.source}) cannot save and restore its state "
                "(canGetAndSetFMUstate); use gauss-seidel"
            )
