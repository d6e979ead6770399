"""One run of a system with loaded FMUs, from the equilibrium start to the end, at fixed or adaptive steps."""

from __future__ import annotations

import signal
import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.components.component import Callbacks, FunctionTable, Native, function_table, to_si
from cosim.components.fmu_component import FmuComponent
from cosim.components.watch import Surroundings, calling_loop, loop_words, watching
from cosim.engine.march import Bind, Control, Grid, Knots, loop, record
from cosim.engine.march import Progress as Reached
from cosim.engine.plan import (
    DISCARD,
    DIVERGED,
    DONE,
    IMPLICIT,
    JACOBI,
    STEP,
    STOPPED,
    STUCK,
    Drive,
    Integers,
    Mode,
    memory,
)
from cosim.session.outcome import Ending, Equilibrium, Outcome, Running, check_repeat
from cosim.session.planning import blank_tape, make_plan, real_names
from cosim.session.result import Result
from cosim.session.setup import ROUNDING, Setup, Times, among, coupling_times, joined, merged, step_sizes
from cosim.systems.algorithm import Adaptive, Algorithm
from cosim.systems.coupling import Coupling, Scenario
from cosim.systems.system import System
from eightpost.errors import DivergedError, StepError, TerminatedError, WiringError
from eightpost.progress import Progress
from eightpost.signals import Drivefile

# ==== State of a run: equilibrium start, components in progress, and errors that name the component that fails =======

# ==== Equilibrium start: inputs and outputs that agree in initialization mode, before t = 0 ==========================

_SWEEPS = 30
_TOLERANCE = 1e-12


def solve_equilibrium(coupling: Coupling, order: tuple[str, ...]) -> Equilibrium:
    """Make inputs and outputs agree in initialization mode, gas force included; leave the outputs in `coupling.now`.

    The components are evaluated one after the other first, which is sufficient for weak springs across a bond. If this
    does not converge, the connected outputs are solved for by a Newton-like method (MINPACK's hybrd).
    """
    names = _connected(coupling)
    _sweep(coupling, order)
    residual = np.inf
    for sweep in range(2, _SWEEPS):
        before = _vector(coupling, names)
        _sweep(coupling, order)
        residual = _relative(_vector(coupling, names) - before, before)
        if residual <= _TOLERANCE:
            return Equilibrium(converged=True, sweeps=sweep, residual=residual)
    return _solve(coupling, order, names)


def _solve(coupling: Coupling, order: tuple[str, ...], names: list[str]) -> Equilibrium:
    evaluations = 0

    def disagreement(values: NDArray[np.float64]) -> NDArray[np.float64]:
        nonlocal evaluations
        evaluations += 1
        coupling.now.update(zip(names, values.tolist(), strict=True))
        _sweep_at_once(coupling, order)
        return np.asarray(_vector(coupling, names) - values)

    start = np.nan_to_num(_vector(coupling, names), posinf=0.0, neginf=0.0)
    solution = scipy.optimize.root(
        disagreement, np.where(np.abs(start) < 1e12, start, 0.0), method="hybr", tol=_TOLERANCE
    )
    residual = _relative(disagreement(solution.x), solution.x)
    return Equilibrium(converged=residual <= 1e-9, sweeps=_SWEEPS + evaluations, residual=residual)


def _connected(coupling: Coupling) -> list[str]:
    return sorted({term.source for feeds in coupling.feeds.values() for feed in feeds for term in feed.terms})


def _sweep(coupling: Coupling, order: tuple[str, ...]) -> None:
    """Evaluate the components one after the other, each with the newest values."""
    for name in order:
        coupling.feed_start(name)
        coupling.now.update(coupling.read(name))


def _sweep_at_once(coupling: Coupling, order: tuple[str, ...]) -> None:
    """Evaluate every component with the same values."""
    for name in order:
        coupling.feed_start(name)
        coupling.ahead.update(coupling.read(name))
    coupling.accept()


def _vector(coupling: Coupling, names: list[str]) -> NDArray[np.float64]:
    return np.array([coupling.now[name] for name in names])


def _relative(change: NDArray[np.float64], values: NDArray[np.float64]) -> float:
    return float(np.max(np.abs(change) / (np.abs(values) + 1.0), initial=0.0))


# ==== Components in progress =========================================================================================

# ---- Guard of a run -------------------------------------------------------------------------------------------------

#: Number of steps of the compiled loop between checks of shared state.
CHUNK = 1000


def guarded(setup: Setup) -> dict[str, FmuComponent]:
    """Return the components of a run that are checked."""
    parts = setup.system.components.items()
    return {name: part for name, part in parts if isinstance(part, FmuComponent) and part.is_guarded}


def watched(setup: Setup) -> AbstractContextManager[None]:
    """Return a context that watches the run if it has components to check."""
    if not guarded(setup):
        return nullcontext()
    return watching([f"{name!r} ({setup.system.components[name].source})" for name in setup.layout.parts])


def undoing(setup: Setup, progress: Progress) -> Progress:
    """Return `progress`, extended to undo changes that FMUs made while the loop ran, and to record them as notes.

    FMUs that this project built are suspected only if there are no others.
    """
    parts, before = guarded(setup), Surroundings.now()
    if not parts:
        return progress
    parts = {name: part for name, part in parts.items() if not part.is_ours} or parts

    def check(done: float, total: float) -> None:
        for changed in before.restore():
            for name, part in parts.items():
                others = [f"{other!r}" for other in parts if other != name]
                part.blame(f"{changed} while stepping" + (f", or {' or '.join(others)} did" if others else ""))
        progress(done, total)

    return check


# ---- State of a run while its components step -----------------------------------------------------------------------


#: Maximum number of solutions of the equilibrium start, which is repeated if a discrete value has changed.
_ROUNDS = 10


@dataclass(frozen=True)
class Marching:
    """The loop and the parameters of its calls."""

    bind: Bind  #: Function that takes the loop's named tuples and returns the loop.
    chunk: int  #: Number of steps per call.
    mode: Mode  #: Settings of the scheme for a step.
    progress: Progress  #: Callback that receives the completed share and 1, after each call of the loop.


def begin(setup: Setup) -> None:
    """Begin every component, which is then in initialization.

    Raises:
        StepError: A component failed.
    """
    setup.discrete.begin()
    for name, component in setup.system.components.items():
        component.begin(0.0, setup.scenario.stop, setup.system.start_values(name))


def equilibrium_start(setup: Setup) -> Equilibrium:
    """Find the state in which inputs and outputs agree; discrete values, which may jump, are exchanged in between.

    Raises:
        StepError: A component failed.
    """
    setup.discrete.exchange(0.0)
    for _ in range(_ROUNDS):
        equilibrium = solve_equilibrium(setup.coupling, setup.layout.parts)
        if not setup.discrete.exchange(0.0):
            return equilibrium
    return replace(equilibrium, converged=False)


def prepare(setup: Setup) -> Running:
    """Leave initialization; return the loop's arrays for components that are at the equilibrium start.

    Raises:
        StepError: A component failed.
    """
    for name in setup.layout.parts:
        setup.system.components[name].end_initialization()
        setup.coupling.now.update(setup.coupling.read(name))
    tables = {name: function_table(component) for name, component in setup.system.components.items()}
    plan = make_plan(
        setup.system,
        setup.coupling,
        setup.layout,
        tables,
        watched=setup.limits.watched,
        following=setup.following,
        recorded=real_names(setup.system, setup.names),
        sequential=setup.algorithm.mode(0.0).kind != JACOBI,
    )
    m = memory(plan)
    if (words := loop_words()) is not None:
        m = m._replace(calls=words[0], clock=words[1])
    m.now[:] = m.ahead[:] = m.past[:] = m.older[:] = [setup.coupling.now[name] for name in setup.layout.signals]
    rows = int(setup.recorded.sum()) + 1
    return Running(plan, m, blank_tape(setup.layout, real_names(setup.system, setup.names), rows), tables)


# ---- Errors for a loop that ended early -----------------------------------------------------------------------------

#: Size of an exchanged signal in its SI unit from which a discarded step is a divergence of the coupling.
_FAR = 1e7

#: Descriptions of the loop's calls, by their numbers.
_CALLS = (
    "set inputs", "set input derivatives", "step", "give outputs", "save its state", "restore its state",
    "give directional derivatives",
)  # fmt: skip

#: Schemes that may be stable if a scheme diverged.
_OTHERS = {"jacobi": ", gauss-seidel, or implicit", "gauss-seidel": ", or implicit"}


def failure(setup: Setup, running: Running, end: int, time: float) -> BaseException:
    """Return the error for the loop's ending; if a component raised an exception, that one.

    Args:
        setup: Setup of the run.
        running: State in which the loop left the run.
        end: Reason why it ended, a constant of cosim.engine.plan.
        time: Time at which it ended [s].
    """
    if end == DIVERGED:
        return _divergence(setup, running, time)
    status, part, call, _ = (int(number) for number in running.memory.failure)
    name, what = setup.layout.parts[part], _CALLS[call]
    if (raised := _raised(running.tables[name])) is not None:
        return raised
    component = setup.system.components[name]
    if (status, call) == (DISCARD, STEP) and (far := _far_signal(setup, running)):
        return _diverged(setup, *far, time)
    if isinstance(component, Native):
        return component.refused(what, status, time, _inputs(setup, running, part))
    return StepError(f"component {name!r} ({component.source}) failed to {what} at {time:g} s")


def ended_or_failed(setup: Setup, running: Running, end: int, time: float) -> str:
    """Return the name of the component that ended the simulation; for arguments see `failure`.

    Raises:
        StepError: The loop ended for another reason, or before the settling time.
    """
    error = failure(setup, running, end, time)
    if not isinstance(error, TerminatedError) or time <= setup.scenario.settling:
        raise error
    return setup.layout.parts[int(running.memory.failure[1])]


def terminated_at(setup: Setup, running: Running, time: float, step: float) -> str:
    """Return the name of the component that ended the simulation, if the last step was discarded; else an empty string.

    An adaptive run restores its components to `time` [s] before it gives up, which clears their status. Therefore the
    smallest `step` [s] is tried once more.
    """
    status, part, call, _ = (int(number) for number in running.memory.failure)
    if (status, call) != (DISCARD, STEP) or time <= setup.scenario.settling:
        return ""
    name = setup.layout.parts[part]
    try:
        setup.system.components[name].step(time, step)
    except TerminatedError:
        return name
    except StepError:
        return ""
    return ""


def _divergence(setup: Setup, running: Running, time: float) -> DivergedError:
    signal = int(running.memory.failure[1])
    return _diverged(setup, setup.layout.signals[signal], float(running.memory.ahead[signal]), time)


def _diverged(setup: Setup, signal: str, value: float, time: float) -> DivergedError:
    return DivergedError(
        f"the coupling diverged: {signal} is {value:g} after {time:g} s; "
        f"use a smaller coupling step{_OTHERS.get(setup.algorithm.name, '')} (docs/explanation/coupling.md)"
    )


def _far_signal(setup: Setup, running: Running) -> tuple[str, float] | None:
    """Return the largest exchanged signal before the step and its value; None if all are of a sensible size.

    An FMU whose forces grow with powers of its motion (the springs at the ports of a vehicle) can refuse a step of a
    diverging coupling before any signal is as large as the loop's own limit.
    """
    values = dict(zip(setup.layout.signals, running.memory.now.tolist(), strict=True))
    worst = max(values, key=lambda name: abs(values[name]), default=None)
    return None if worst is None or abs(values[worst]) < _FAR else (worst, values[worst])


def _raised(table: FunctionTable) -> BaseException | None:
    """Return the exception that a Python component raised in a callback."""
    keep = table.keep
    return keep[0].error if isinstance(keep, tuple) and isinstance(keep[0], Callbacks) else None


def _inputs(setup: Setup, running: Running, part: int) -> dict[str, float]:
    """Return the last values given to a part, in its own units."""
    rows = running.plan.parts.inputs
    feeds = setup.coupling.feeds[setup.layout.parts[part]]
    moving = [feed.target for feed in feeds if feed.terms or feed.drive is not None]
    return dict(zip(moving, running.memory.value[rows[part] : rows[part + 1]].tolist(), strict=True))


# ==== Session: one run after another of a system with loaded FMUs, at fixed or adaptive steps ========================

# ---- Ctrl-C handling between steps ----------------------------------------------------------------------------------


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


# ---- Stepping with coupling steps of one size -----------------------------------------------------------------------


def march_fixed(setup: Setup, running: Running, marching: Marching) -> Ending:
    """Step from the first communication point to the last, or until an interrupt.

    Raises:
        StepError: A component failed, or the coupling diverged.
    """
    grid, count = grid_of(setup), setup.times.size - 1
    march = marching.bind(running.plan, running.memory, running.tape, grid, marching.mode)
    began, end, ended_by = clock.perf_counter(), DONE, ""
    last, pace = 0, _Pace(_chunk(setup, marching), is_fixed=setup.discrete.is_needed)
    while last < count:
        first, last = last, min(last + pace.steps(), count)
        setup.discrete.exchange(float(setup.times[first]))
        with calling_loop():
            end = march(first, last)
        setup.discrete.record(int(running.tape.position[0]))
        if end == STOPPED:
            break
        if end != DONE:
            ended_by, end = ended_or_failed(setup, running, end, _reached(setup, running)), DONE
            break
        marching.progress(last / count, 1.0)
    reached = _reached(setup, running)
    return Ending(end, reached, least=setup.step, largest=setup.step, began=began, ended_by=ended_by)


#: Time between two calls of the loop, between which progress is reported and Ctrl-C handled [s], and number of steps of
#: the first call.
_BETWEEN, _FIRST_STEPS = 0.05, 20


class _Pace:
    """Number of steps per call of the loop, so that a call takes about the time between two reports.

    Args:
        most: Largest number of steps per call.
        is_fixed: Whether every call makes the largest number.
    """

    def __init__(self, most: int, *, is_fixed: bool) -> None:
        self._most, self._is_fixed = most, is_fixed
        self._steps, self._since = min(most, _FIRST_STEPS), 0.0

    def steps(self) -> int:
        """Return the number of steps of the next call."""
        now, since = clock.perf_counter(), self._since
        self._since = now
        if self._is_fixed:
            return self._most
        if since:
            ratio = min(max(_BETWEEN / max(now - since, 1e-9), 0.25), 4.0)
            self._steps = min(self._most, max(1, round(self._steps * ratio)))
        return self._steps


def _chunk(setup: Setup, marching: Marching) -> int:
    """Return the number of steps per call of the loop: discrete variables are exchanged or read between calls."""
    if not setup.discrete.is_needed:
        return marching.chunk
    return 1 if setup.discrete.is_coupled else int(np.argmax(setup.recorded[1:])) + 1


def _reached(setup: Setup, running: Running) -> float:
    """Return the communication point at which the loop ended [s]."""
    return float(setup.times[int(running.memory.failure[3])])


def grid_of(setup: Setup) -> Grid:
    """Return the communication points, and the drive at these and at its own points between them."""
    scenario, times = setup.scenario, setup.times
    steps = step_sizes(times, setup.step)
    if scenario.drive is None:
        return Grid(times, steps, setup.recorded, np.arange(times.size), _without_drive(times))
    request = _DriveRequest(scenario.stop, setup.step, scenario.drive_start, bool(setup.following), setup.system.ramps)
    begins, drive = _driven(scenario.drive, request)
    return Grid(times, steps, setup.recorded, begins, drive)


class _DriveRequest(NamedTuple):
    """Parameters by which a drive is sampled for a run."""

    stop: float  #: Duration of the run [s].
    step: float  #: Coupling step [s].
    start: float  #: Time in the drive at which the run starts [s].
    follows: bool  #: Whether a component is stepped from each of the drive's points to the next.
    ramps: bool  #: Whether all components ramp their inputs, so that no means are needed.


def _without_drive(times: Times) -> Drive:
    none = np.zeros((times.size, 0))
    return Drive(times, none, none, none[1:])


@lru_cache(maxsize=4)
def _driven(drive: Drivefile, request: _DriveRequest) -> tuple[Integers, Drive]:
    """Return the row of the drive at which each step begins (K+1,), and the rows; cached for the runs of a study."""
    coupling = coupling_times(request.stop, request.step)
    own = drive.series.time - request.start
    own = own[(own > 0.0) & (own < request.stop)]
    times = joined(coupling, own) if request.follows else coupling
    begins = np.searchsorted(times, coupling) if times.size > coupling.size else np.arange(times.size)
    samples = _rows(drive.sample(times + request.start))
    means = _rows(drive.means(times + request.start))
    starts = samples if request.follows else _starts(drive, times + request.start, samples, means)
    return begins, Drive(times, samples, starts, means if not request.ramps else np.zeros((times.size - 1, 0)))


def _starts(drive: Drivefile, times: Times, samples: Times, means: Times) -> Times:
    """Return the start (T+1, D) of each step's straight line, which ends at the drive and has the drive's mean."""
    starts, own, near = samples.copy(), drive.series.time, ROUNDING * times[-1]
    bent = np.searchsorted(own, times[:-1] + near) < np.searchsorted(own, times[1:] - near)
    starts[:-1][bent] = (2.0 * means - samples[1:])[bent]
    return starts


def _rows(channels: Times) -> Times:
    """A row per time, (T, D) of (D, T)."""
    return np.ascontiguousarray(channels.T)


# ---- Stepping with coupling steps that an error estimate controls ---------------------------------------------------

#: Absolute part of the allowed local error by SI unit: far below the resolution of sensors.
_LEAST_ERROR = {"m/s": 1e-5, "m": 1e-6, "N": 1e-2}


def march_adaptive(setup: Setup, running: Running, marching: Marching, algorithm: Adaptive) -> Ending:
    """Step from one recorded time to the next, until the stop, an interrupt, or a step that is too small.

    Raises:
        WiringError: A tolerance is given for a name that is not a coupled signal.
        StepError: A component failed, or the coupling diverged.
    """
    knots, control = _knots(setup), _control(setup, algorithm)
    state = _first_progress(setup.step, control, running.memory.now.size, knots.values.shape[1])
    kept = memory(running.plan)
    march = marching.bind(running.plan, running.memory, kept, running.tape, knots, marching.mode, control, state)
    began, ended_by = clock.perf_counter(), ""
    while True:
        setup.discrete.exchange(float(state.time[0]))
        with calling_loop():
            end = march(1 if setup.discrete.is_needed else max(1, marching.chunk // 10))
        setup.discrete.record(int(running.tape.position[0]))
        time = float(state.time[0])
        if end == STUCK and (ended_by := terminated_at(setup, running, time, control.least)):
            end = DONE
        elif end not in (DONE, STOPPED, STUCK):
            ended_by, end = ended_or_failed(setup, running, end, time), DONE
        if end != DONE or ended_by or running.memory.failure[3] == 1:
            least, largest = float(state.smallest[0]), float(state.greatest[0])
            return Ending(end, time, least=least, largest=largest, began=began, ended_by=ended_by)
        marching.progress(min(1.0, time / setup.scenario.stop), 1.0)


def _knots(setup: Setup) -> Knots:
    """Return the drive's own points within the run, and all times at which a step must end."""
    scenario, recorded = setup.scenario, setup.times[setup.recorded == 1][1:]
    drive = scenario.drive
    if drive is None:
        return Knots(np.zeros(0), np.zeros((1, 0)), recorded, np.ones(recorded.size, np.int64))
    own = drive.series.time - scenario.drive_start
    own = np.concatenate([[0.0], own[(own > 0.0) & (own < scenario.stop)], [scenario.stop]])
    values = np.ascontiguousarray(drive.sample(own + scenario.drive_start).T)
    events = merged(np.concatenate([own[1:], recorded]))
    return Knots(own, values, events, among(events, recorded, scenario.stop).astype(np.int64))


def _control(setup: Setup, algorithm: Adaptive) -> Control:
    coupled = sorted({source for source, _ in setup.layout.terms})
    if unknown := sorted(set(algorithm.absolute) - set(coupled)):
        raise WiringError(f"adaptive: {unknown[0]} is not a coupled signal; those are {', '.join(coupled)}")
    return Control(
        np.array([setup.layout.signals.index(name) for name in coupled], dtype=np.int64),
        np.array([algorithm.absolute.get(name, _least_error(setup, name)) for name in coupled]),
        algorithm.relative,
        min(setup.accuracy_of(target).order for _, target in setup.layout.terms) if setup.layout.terms else 1,
        algorithm.least,
        min(algorithm.largest, setup.scenario.stop),
    )


def _least_error(setup: Setup, name: str) -> float:
    """Return the default absolute error of a signal, in its own unit."""
    conversion, unit = to_si(setup.system.output(name))
    return _LEAST_ERROR.get(unit, 1e-9) / abs(conversion.factor)


def _first_progress(step: float, control: Control, signals: int, channels: int) -> Reached:
    """Return the initial state of a run that tries `step` [s] first."""
    first = min(max(step, control.least), control.largest)
    return Reached(
        time=np.zeros(1),
        step=np.array([first]),
        error=np.ones(1),
        event=np.zeros(1, np.int64),
        knot=np.zeros(1, np.int64),
        smallest=np.full(1, np.inf),
        greatest=np.zeros(1),
        scale=np.zeros(control.signal.size),
        once=np.zeros(signals),
        drive=Drive(np.zeros(2), np.zeros((2, channels)), np.zeros((2, channels)), np.zeros((1, channels))),
    )


# ---- One run of a system with one algorithm -------------------------------------------------------------------------


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
        self._setup = Setup.of(system, scenario, algorithm, step)

    def run(self, engine: str = "auto", progress: Progress | None = None) -> Result:
        """Begin, find the equilibrium start and step to the end. The components are finished in any case.

        Args:
            engine: `compiled`, `python`, or `auto`: compiled if a component is native.
            progress: Callback that receives the completed share and 1, about ten times per second.

        Raises:
            StepError: A component failed, or the coupling diverged.
            RunInterrupted: Ctrl-C was pressed; the exception holds the result so far.
        """
        setup = self._setup
        with watched(setup):
            began = clock.perf_counter()
            try:
                begin(setup)
                equilibrium = equilibrium_start(setup)
                running = prepare(setup)
                ending = self._march(running, engine, undoing(setup, progress or (lambda _done, _total: None)))
                seconds = (ending.began - began, clock.perf_counter() - ending.began)
                result = Outcome(setup, running, equilibrium, ending, seconds).result()
                if ending.why == STOPPED:
                    raise RunInterrupted(result)
                check_repeat(setup, result.series)
                return result
            finally:
                for component in setup.system.components.values():
                    component.finish()

    def _march(self, running: Running, engine: str, progress: Progress) -> Ending:
        setup = self._setup
        try:
            with interrupts_deferred(running.stop):
                marching = self._marching(engine, progress)
                with calling_loop():
                    record(running.plan, running.memory, running.tape, 0.0)
                setup.discrete.record(1)
                if isinstance(setup.algorithm, Adaptive):
                    ending = march_adaptive(setup, running, marching, setup.algorithm)
                else:
                    ending = march_fixed(setup, running, marching)
                progress(1.0, 1.0)
                return ending
        finally:
            with calling_loop():
                running.free_states(setup)

    def _marching(self, engine: str, progress: Progress) -> Marching:
        """Return the requested loop; interpreted if every component is Python, where compiling gains nothing."""
        setup = self._setup
        native = any(isinstance(component, Native) for component in setup.system.components.values())
        mode = setup.algorithm.mode(setup.scenario.settling)
        bind, chunk = loop(
            engine if native or engine == "compiled" else "python",
            adaptive=isinstance(setup.algorithm, Adaptive),
            implicit=mode.kind == IMPLICIT,
        )
        chunk = min(chunk, CHUNK) if guarded(setup) else chunk
        return Marching(bind, chunk, mode, progress)
