"""Session: one run after another of a system with loaded FMUs, at fixed or adaptive steps."""

from __future__ import annotations

import signal
import threading
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cosim.components.component import to_si
from cosim.components.functions import Native
from cosim.components.watch import calling_loop
from cosim.engine.loop import loop
from cosim.engine.march import Control, Grid, Knots, record
from cosim.engine.march import Progress as Reached
from cosim.engine.plan import DONE, IMPLICIT, STOPPED, STUCK, Drive, Integers, memory
from cosim.results.result import Result
from cosim.session.outcome import Outcome, check_repeat
from cosim.session.running import (
    CHUNK,
    Ending,
    Marching,
    Running,
    begin,
    ended_or_failed,
    equilibrium_start,
    guarded,
    prepare,
    terminated_at,
    undoing,
    watched,
)
from cosim.session.setup import ROUNDING, Setup, Times, among, coupling_times, joined, merged, step_sizes
from cosim.systems.algorithm import Adaptive, Algorithm
from cosim.systems.coupling import Scenario
from cosim.systems.system import System
from eightpost.errors import WiringError
from eightpost.progress import Progress
from eightpost.signals import Drivefile

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
