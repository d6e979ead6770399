"""One run of a system with loaded FMUs, from the equilibrium start to the end, at fixed or adaptive steps."""

from __future__ import annotations

import signal
import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from functools import lru_cache
from math import isnan

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.components.component import Callbacks, Native, function_table, to_si
from cosim.components.fmu_component import FmuComponent
from cosim.components.watch import Surroundings, calling_loop, loop_words, watching
from cosim.engine import plan as reasons
from cosim.engine.march import Bind, Control, Grid, Knots, loop, record
from cosim.engine.march import Progress as Reached
from cosim.engine.plan import DONE, IMPLICIT, STOPPED, STUCK, Drive, Integers, memory
from cosim.session.planning import Ending, Equilibrium, Outcome, Running, blank_tape, check_repeat, make_plan
from cosim.session.result import Result
from cosim.session.setup import (
    ROUNDING,
    RunSetup,
    Times,
    among,
    coupling_times,
    joined,
    merged,
    step_sizes,
    summed_steps,
)
from cosim.systems.algorithm import Adaptive, Algorithm
from cosim.systems.coupling import Coupling, Scenario
from cosim.systems.system import System
from eightpost.errors import DivergedError, StepError, TerminatedError, WiringError
from eightpost.fmi import DISCARD
from eightpost.progress import Progress
from eightpost.signals import Drivefile

# ==== Session ========================================================================================================

#: Number of steps of the compiled loop between checks of shared state.
_CHUNK = 1000


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C during a run; `result` holds the result so far."""

    def __init__(self, result: Result) -> None:
        super().__init__("the run was interrupted")
        self.result = result


class Session:
    """A system, a scenario, an algorithm and a step, ready to run.

    Args:
        system: Components and connections.
        scenario: Drive, duration and recording.
        algorithm: Algorithm of the run.
        step: Coupling step [s]; for an adaptive run the first step to try.

    Raises:
        WiringError: System, scenario and algorithm do not fit together.
        InputError: The coupling step does not fit.
    """

    def __init__(self, system: System, scenario: Scenario, algorithm: Algorithm, step: float) -> None:
        self._setup = RunSetup.of(system, scenario, algorithm, step)

    def run(self, engine: str = "auto", progress: Progress | None = None) -> Result:
        """Begin, find the equilibrium start and step to the end. The components are finished in any case.

        Args:
            engine: `compiled`, `python`, or `auto`: compiled if a component is native.
            progress: Callback that receives the completed share and 1, about ten times per second.

        Raises:
            StepError: A component failed, or the coupling diverged.
            RunInterrupted: Ctrl-C was pressed; the exception holds the result so far.
        """
        setup, components = self._setup, self._setup.system.components
        guarded = {name: c for name, c in components.items() if isinstance(c, FmuComponent) and c.is_guarded}
        names = [f"{name!r} ({components[name].source})" for name in setup.layout.parts]
        with watching(names) if guarded else nullcontext():
            began = clock.perf_counter()
            try:
                setup.discrete.begin()
                for name, component in components.items():
                    component.begin(0.0, setup.scenario.stop, setup.system.start_values(name))
                equilibrium = _equilibrium_start(setup)
                running = _prepare(setup)
                progress = progress or (lambda _done, _total: None)
                ending = self._march(running, engine, _undoing(guarded, progress) if guarded else progress)
                seconds = (ending.began - began, clock.perf_counter() - ending.began)
                result = Outcome(setup, running, equilibrium, ending, seconds).result()
                if ending.why == STOPPED:
                    raise RunInterrupted(result)
                check_repeat(setup, result.series)
                return result
            finally:
                for component in components.values():
                    component.finish()

    def _march(self, running: Running, engine: str, progress: Progress) -> Ending:
        """Step to the end; interpreted if every component is Python, where compiling gains nothing."""
        setup, components = self._setup, self._setup.system.components.values()
        native = any(isinstance(component, Native) for component in components)
        adaptive = isinstance(setup.algorithm, Adaptive)
        used = engine if native or engine == "compiled" else "python"
        bind, chunk = loop(used, adaptive=adaptive, implicit=setup.mode.kind == IMPLICIT)
        if any(isinstance(component, FmuComponent) and component.is_guarded for component in components):
            chunk = min(chunk, _CHUNK)
        try:
            with interrupts_deferred(running.stop):
                with calling_loop():
                    record(running.plan, running.memory, running.tape, 0.0)
                setup.discrete.record(1)
                ending = (_march_adaptive if adaptive else _march_fixed)(setup, running, bind, chunk, progress)
                progress(1.0, 1.0)
                return ending
        finally:
            with calling_loop():
                running.free_states(setup)


@contextmanager
def interrupts_deferred(pressed: Callable[[], None]) -> Iterator[None]:
    """Call `pressed` for Ctrl-C instead of raising KeyboardInterrupt. In other threads this does nothing."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.signal(signal.SIGINT, lambda _number, _frame: pressed())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)


def _undoing(guarded: dict[str, FmuComponent], progress: Progress) -> Progress:
    """Return `progress`, extended to undo changes that FMUs made while the loop ran, and to record them as notes.

    FMUs that this project built are suspected only if there are no others.
    """
    before, parts = Surroundings.now(), {name: part for name, part in guarded.items() if not part.is_ours} or guarded

    def check(done: float, total: float) -> None:
        for changed in before.restore():
            for name, part in parts.items():
                others = [f"{other!r}" for other in parts if other != name]
                part.blame(f"{changed} while stepping" + (f", or {' or '.join(others)} did" if others else ""))
        progress(done, total)

    return check


def _prepare(setup: RunSetup) -> Running:
    """Leave initialization; return the loop's arrays for components that are at the equilibrium start."""
    now = setup.coupling.now
    for name in setup.layout.parts:
        setup.system.components[name].end_initialization()
        now.update(setup.coupling.read(name))
    tables = {name: function_table(component) for name, component in setup.system.components.items()}
    plan = make_plan(setup, tables)
    m = memory(plan)
    if (words := loop_words()) is not None:
        m = m._replace(calls=words[0], clock=words[1])
    m.now[:] = m.ahead[:] = m.past[:] = m.older[:] = [now[name] for name in setup.layout.signals]
    return Running(plan, m, blank_tape(setup), tables)


# ==== Equilibrium start: inputs and outputs that agree in initialization mode, before t = 0 ==========================

_SWEEPS = 30
_TOLERANCE = 1e-12

#: Maximum number of solutions of the equilibrium start, which is repeated if a discrete value has changed.
_ROUNDS = 10


def _equilibrium_start(setup: RunSetup) -> Equilibrium:
    """Find the state in which inputs and outputs agree; discrete values, which may jump, are exchanged in between."""
    setup.discrete.exchange(0.0)
    for _ in range(_ROUNDS):
        equilibrium = _solve_equilibrium(setup.coupling, setup.layout.parts)
        if not setup.discrete.exchange(0.0):
            return equilibrium
    return replace(equilibrium, converged=False)


def _solve_equilibrium(coupling: Coupling, order: tuple[str, ...]) -> Equilibrium:
    """Make inputs and outputs agree in initialization mode, gas force included; leave the outputs in `coupling.now`.

    The components are evaluated one after the other first, each with the newest values, which is sufficient for weak
    springs across a bond. If this does not converge, the connected outputs are solved for by a Newton-like method
    (MINPACK's hybrd), in which every component is evaluated with the same values.
    """
    names = sorted({term.source for feeds in coupling.feeds.values() for feed in feeds for term in feed.terms})

    def outputs() -> NDArray[np.float64]:
        return np.array([coupling.now[name] for name in names])

    residual = np.inf
    for sweep in range(1, _SWEEPS):
        before = outputs() if sweep > 1 else None
        for name in order:
            coupling.feed_start(name)
            coupling.now.update(coupling.read(name))
        if before is not None:
            residual = _relative(outputs() - before, before)
        if residual <= _TOLERANCE:
            return Equilibrium(converged=True, sweeps=sweep, residual=residual)
    evaluations = 0

    def disagreement(values: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal evaluations
        evaluations += 1
        coupling.now.update(zip(names, values.tolist(), strict=True))
        ahead: dict[str, float] = {}
        for name in order:
            coupling.feed_start(name)
            ahead |= coupling.read(name)
        coupling.now.update(ahead)
        return np.asarray(outputs() - values)

    start = np.nan_to_num(outputs(), posinf=0.0, neginf=0.0)
    start = np.where(np.abs(start) < 1e12, start, 0.0)
    solution = scipy.optimize.root(disagreement, start, method="hybr", tol=_TOLERANCE)
    residual = _relative(disagreement(solution.x), solution.x)
    return Equilibrium(converged=residual <= 1e-9, sweeps=_SWEEPS + evaluations, residual=residual)


def _relative(change: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(change) / (np.abs(values) + 1.0), initial=0.0))


# ==== Coupling steps of one size =====================================================================================

#: Time between two calls of the loop, between which progress is reported and Ctrl-C handled [s], and number of steps of
#: the first call.
_BETWEEN, _FIRST_STEPS = 0.05, 20


def _march_fixed(setup: RunSetup, running: Running, bind: Bind, chunk: int, progress: Progress) -> Ending:
    """Step from the first communication point to the last, or until an interrupt.

    A call of the loop takes about the time between two reports. Discrete variables are exchanged or read between calls.
    """
    grid, count, discrete = _grid(setup), setup.times.size - 1, setup.discrete
    if discrete.is_needed:
        chunk = 1 if discrete.is_coupled else int(np.argmax(setup.recorded[1:])) + 1
    march = bind(running.plan, running.memory, running.tape, grid, setup.mode)
    began, end, ended_by = clock.perf_counter(), DONE, ""
    last, size, since = 0, chunk if discrete.is_needed else min(chunk, _FIRST_STEPS), clock.perf_counter()
    while last < count:
        first, last = last, min(last + size, count)
        discrete.exchange(float(setup.times[first]))
        with calling_loop():
            end = march(first, last)
        discrete.record(int(running.tape.position[0]))
        if end == STOPPED:
            break
        if end != DONE:
            ended_by, end = _ended_or_failed(setup, running, end, _reached(setup, running)), DONE
            break
        progress(last / count, 1.0)
        if not discrete.is_needed:
            now = clock.perf_counter()
            ratio = min(max(_BETWEEN / max(now - since, 1e-9), 0.25), 4.0)
            size, since = min(chunk, max(1, round(size * ratio))), now
    return Ending(end, _reached(setup, running), setup.step, setup.step, began, ended_by)


def _reached(setup: RunSetup, running: Running) -> float:
    """Return the communication point at which the loop ended [s]."""
    return float(setup.times[int(running.memory.failure[3])])


def _grid(setup: RunSetup) -> Grid:
    """Return the communication points, and the drive at these and at its own points between them."""
    scenario, times = setup.scenario, setup.times
    if scenario.drive is None:
        none = np.zeros((times.size, 0))
        begins, drive = np.arange(times.size), Drive(times, none, none, none[1:])
    else:
        arguments = scenario.stop, setup.step, scenario.drive_start, bool(setup.following), setup.system.ramps
        begins, drive = _driven(scenario.drive, *arguments)
    if not setup.system.has_foreign_fmus:
        return Grid(times, times, step_sizes(times, setup.step), setup.recorded, begins, drive)
    points, steps = summed_steps(times, setup.step)
    moved = drive.times.copy()
    moved[begins] = points
    return Grid(times, points, steps, setup.recorded, begins, drive._replace(times=moved))


@lru_cache(maxsize=4)
def _driven(
    drive: Drivefile, stop: float, step: float, start: float, follows: bool, ramps: bool
) -> tuple[Integers, Drive]:
    """Return the row of the drive at which each step begins (K+1,), and the rows; cached for the runs of a study."""
    coupling = coupling_times(stop, step)
    points = drive.series.time - start
    points = points[(points > 0.0) & (points < stop)]
    times = joined(coupling, points) if follows else coupling
    begins = np.searchsorted(times, coupling) if times.size > coupling.size else np.arange(times.size)
    samples = np.ascontiguousarray(drive.sample(times + start).T)
    means = np.ascontiguousarray(drive.means(times + start).T)
    starts = samples if follows else _line_starts(drive, times + start, samples, means)
    return begins, Drive(times, samples, starts, np.zeros((times.size - 1, 0)) if ramps else means)


def _line_starts(drive: Drivefile, times: Times, samples: Times, means: Times) -> Times:
    """Return the start (T+1, D) of each step's straight line, which ends at the drive and has the drive's mean."""
    starts, points, near = samples.copy(), drive.series.time, ROUNDING * times[-1]
    bent = np.searchsorted(points, times[:-1] + near) < np.searchsorted(points, times[1:] - near)
    starts[:-1][bent] = (2.0 * means - samples[1:])[bent]
    return starts


# ==== Coupling steps that an error estimate controls =================================================================

#: Absolute part of the allowed local error by SI unit: far below the resolution of sensors.
_LEAST_ERROR = {"m/s": 1e-5, "m": 1e-6, "N": 1e-2}


def _march_adaptive(setup: RunSetup, running: Running, bind: Bind, chunk: int, progress: Progress) -> Ending:
    """Step from one recorded time to the next, until the stop, an interrupt, or a step that is too small."""
    knots, control = _knots(setup), _control(setup)
    channels, first = knots.values.shape[1], min(max(setup.step, control.least), control.largest)
    state = Reached(
        time=np.zeros(1),
        step=np.array([first]),
        error=np.ones(1),
        event=np.zeros(1, np.int64),
        knot=np.zeros(1, np.int64),
        smallest=np.full(1, np.inf),
        greatest=np.zeros(1),
        scale=np.zeros(control.signal.size),
        once=np.zeros(running.memory.now.size),
        drive=Drive(np.zeros(2), np.zeros((2, channels)), np.zeros((2, channels)), np.zeros((1, channels))),
    )
    march = bind(running.plan, running.memory, memory(running.plan), running.tape, knots, setup.mode, control, state)
    began, ended_by = clock.perf_counter(), ""
    while True:
        setup.discrete.exchange(float(state.time[0]))
        with calling_loop():
            end = march(1 if setup.discrete.is_needed else max(1, chunk // 10))
        setup.discrete.record(int(running.tape.position[0]))
        time = float(state.time[0])
        if end == STUCK and (ended_by := _terminated_at(setup, running, time, control.least)):
            end = DONE
        elif end not in (DONE, STOPPED, STUCK):
            ended_by, end = _ended_or_failed(setup, running, end, time), DONE
        if end != DONE or ended_by or running.memory.failure[3] == 1:
            return Ending(end, time, float(state.smallest[0]), float(state.greatest[0]), began, ended_by)
        progress(min(1.0, time / setup.scenario.stop), 1.0)


def _knots(setup: RunSetup) -> Knots:
    """Return the drive's own points within the run, and all times at which a step must end."""
    scenario, recorded = setup.scenario, setup.times[setup.recorded == 1][1:]
    drive = scenario.drive
    if drive is None:
        return Knots(np.zeros(0), np.zeros((1, 0)), recorded, np.ones(recorded.size, np.int64))
    points = drive.series.time - scenario.drive_start
    points = np.concatenate([[0.0], points[(points > 0.0) & (points < scenario.stop)], [scenario.stop]])
    values = np.ascontiguousarray(drive.sample(points + scenario.drive_start).T)
    events = merged(np.concatenate([points[1:], recorded]))
    return Knots(points, values, events, among(events, recorded, scenario.stop).astype(np.int64))


def _control(setup: RunSetup) -> Control:
    algorithm, terms = setup.algorithm, setup.layout.terms
    assert isinstance(algorithm, Adaptive)
    coupled = sorted({source for source, _ in terms})
    if unknown := sorted(set(algorithm.absolute) - set(coupled)):
        raise WiringError(f"adaptive: {unknown[0]} is not a coupled signal; those are {', '.join(coupled)}")
    units = {
        name: to_si(setup.system.output(name)) for name in coupled
    }  # the default error is in the signal's own unit
    least = {name: _LEAST_ERROR.get(si, 1e-9) / abs(conversion.factor) for name, (conversion, si) in units.items()}
    return Control(
        np.array([setup.layout.signals.index(name) for name in coupled], dtype=np.int64),
        np.array([algorithm.absolute.get(name, least[name]) for name in coupled]),
        algorithm.relative,
        min((setup.accuracy_of(target).order for _, target in terms), default=1),
        algorithm.least,
        min(algorithm.largest, setup.scenario.stop),
    )


# ==== Errors for a loop that ended early =============================================================================

#: Size of an exchanged signal in its SI unit from which a discarded step is a divergence of the coupling.
_FAR = 1e7

#: Descriptions of the loop's calls, by their numbers.
_CALLS = (
    "set inputs", "set input derivatives", "step", "give outputs", "save its state", "restore its state",
    "give directional derivatives",
)  # fmt: skip

#: Schemes that may be stable if a scheme diverged.
_OTHERS = {"jacobi": ", gauss-seidel, or implicit", "gauss-seidel": ", or implicit"}


def _failure(setup: RunSetup, running: Running, end: int, time: float) -> BaseException:
    """Return the error for the reason `end` why the loop ended at `time` [s]; an exception that a component raised."""
    m, layout = running.memory, setup.layout
    sizes = dict(zip(layout.signals, m.now.tolist(), strict=True))
    worst = max(sizes, key=lambda signal: abs(sizes[signal]), default="")
    lost = next((s for s, value in zip(layout.signals, m.ahead.tolist(), strict=True) if isnan(value)), "")
    if lost and not any(abs(size) >= _FAR for size in sizes.values()):
        name, _, output = lost.partition(".")
        return StepError(
            f"component {name!r} ({setup.system.components[name].source}): its output {output} is not a number after "
            f"the step from {time:g} s; check its inputs and its log, or ask its maker"
        )
    if end == reasons.DIVERGED:
        signal_number = int(m.failure[1])
        return _diverged(setup, layout.signals[signal_number], float(m.ahead[signal_number]), time)
    status, part, call = (int(number) for number in m.failure[:3])
    name, what = layout.parts[part], _CALLS[call]
    keep = running.tables[name].keep
    if isinstance(keep, tuple) and isinstance(keep[0], Callbacks) and keep[0].error is not None:
        return keep[0].error
    # An FMU whose forces grow with powers of its motion (the springs at the ports of a vehicle) can refuse a step of a
    # diverging coupling before any signal is as large as the loop's own limit.
    if _discards_step(running) and worst and not abs(sizes[worst]) < _FAR:
        return _diverged(setup, worst, sizes[worst], time)
    component = setup.system.components[name]
    if isinstance(component, Native):
        rows, feeds = running.plan.parts.inputs, setup.coupling.feeds[name]
        moving = [feed.target for feed in feeds if feed.is_moving]
        inputs = dict(zip(moving, m.value[rows[part] : rows[part + 1]].tolist(), strict=True))
        return component.refused(what, status, time, inputs)
    return StepError(f"component {name!r} ({component.source}) failed to {what} at {time:g} s")


def _discards_step(running: Running) -> bool:
    """Return whether the last call that was refused was a step that a component discarded."""
    return (running.memory.failure[0], running.memory.failure[2]) == (DISCARD, reasons.STEP)


def _diverged(setup: RunSetup, signal: str, value: float, time: float) -> DivergedError:
    return DivergedError(
        f"the coupling diverged: {signal} is {value:g} after {time:g} s; "
        f"use a smaller coupling step{_OTHERS.get(setup.algorithm.name, '')} (docs/explanation/coupling.md)"
    )


def _ended_or_failed(setup: RunSetup, running: Running, end: int, time: float) -> str:
    """Return the name of the component that ended the simulation; for arguments see `_failure`."""
    error = _failure(setup, running, end, time)
    if not isinstance(error, TerminatedError) or time <= setup.scenario.settling:
        raise error
    return setup.layout.parts[int(running.memory.failure[1])]


def _terminated_at(setup: RunSetup, running: Running, time: float, step: float) -> str:
    """Return the name of the component that ended the simulation, if the last step was discarded; else an empty string.

    An adaptive run restores its components to `time` [s] before it gives up, which clears their status. Therefore the
    smallest `step` [s] is tried once more.
    """
    if not _discards_step(running) or time <= setup.scenario.settling:
        return ""
    name = setup.layout.parts[int(running.memory.failure[1])]
    try:
        setup.system.components[name].step(time, step)
    except TerminatedError:
        return name
    except StepError:
        return ""
    return ""
