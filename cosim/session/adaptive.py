"""Stepping with coupling steps that an error estimate controls."""

from __future__ import annotations

import time as clock

import numpy as np

from cosim.algorithm import Adaptive
from cosim.conversion import to_si
from cosim.engine.march import Control, Knots, Progress
from cosim.engine.plan import DONE, STOPPED, STUCK, Drive, memory
from cosim.session.failure import ended_or_failed, terminated_at
from cosim.session.running import Ending, Marching, Running
from cosim.session.setup import Setup
from cosim.session.times import among, merged
from eightpost.errors import WiringError

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
        marching.progress(min(1.0, time / setup.scenario.stop))


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


def _first_progress(step: float, control: Control, signals: int, channels: int) -> Progress:
    """Return the initial state of a run that tries `step` [s] first."""
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
        drive=Drive(np.zeros(2), np.zeros((2, channels)), np.zeros((2, channels)), np.zeros((1, channels))),
    )
