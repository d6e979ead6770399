"""Stepping with coupling steps of one size."""

from __future__ import annotations

import time as clock
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cosim.engine.march import Grid
from cosim.engine.plan import DONE, STOPPED, Drive, Integers
from cosim.session.failure import ended_or_failed
from cosim.session.running import Ending, Marching, Running
from cosim.session.setup import Setup
from cosim.session.times import ROUNDING, Times, coupling_times, joined, step_sizes
from eightpost.signals import Drivefile


def march_fixed(setup: Setup, running: Running, marching: Marching) -> Ending:
    """Step from the first communication point to the last, or until an interrupt.

    Raises:
        StepError: A component failed, or the coupling diverged.
    """
    grid, count = _grid(setup), setup.times.size - 1
    march = marching.bind(running.plan, running.memory, running.tape, grid, marching.mode)
    began, end, ended_by = clock.perf_counter(), DONE, ""
    chunk = _chunk(setup, marching)
    for first in range(0, count, chunk):
        last = min(first + chunk, count)
        setup.discrete.exchange(float(setup.times[first]))
        end = march(first, last)
        setup.discrete.record(int(running.tape.position[0]))
        if end == STOPPED:
            break
        if end != DONE:
            ended_by, end = ended_or_failed(setup, running, end, _reached(setup, running)), DONE
            break
        marching.progress(last / count)
    reached = _reached(setup, running)
    return Ending(end, reached, least=setup.step, largest=setup.step, began=began, ended_by=ended_by)


def _chunk(setup: Setup, marching: Marching) -> int:
    """Return the number of steps per call of the loop: discrete variables are exchanged or read between calls."""
    if not setup.discrete.is_needed:
        return marching.chunk
    return 1 if setup.discrete.is_coupled else int(np.argmax(setup.recorded[1:])) + 1


def _reached(setup: Setup, running: Running) -> float:
    """Return the communication point at which the loop ended [s]."""
    return float(setup.times[int(running.memory.failure[3])])


def _grid(setup: Setup) -> Grid:
    """Return the communication points, and the drive at these and at its own points between them."""
    scenario, times = setup.scenario, setup.times
    steps = step_sizes(times, setup.step)
    if scenario.drive is None:
        return Grid(times, steps, setup.recorded, np.arange(times.size), _without_drive(times))
    request = _DriveRequest(scenario.stop, setup.step, scenario.drive_start, bool(setup.following), setup.system.ramps)
    begins, drive = _driven(scenario.drive, request)
    return Grid(times, steps, setup.recorded, begins, drive)


class _DriveRequest(NamedTuple):
    """Parameters by which a drive is sampled for a run.

    Args:
        stop: Duration of the run [s].
        step: Coupling step [s].
        start: Time in the drive at which the run starts [s].
        follows: Whether a component is stepped from each of the drive's points to the next.
        ramps: Whether all components ramp their inputs, so that no means are needed.
    """

    stop: float
    step: float
    start: float
    follows: bool
    ramps: bool


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
    starts = samples if request.follows else _starts(drive, times + request.start, samples)
    means = _rows(drive.means(times + request.start)) if not request.ramps else np.zeros((times.size - 1, 0))
    return begins, Drive(times, samples, starts, means)


def _starts(drive: Drivefile, times: Times, samples: Times) -> Times:
    """Return the start (T+1, D) of each step's straight line, which ends at the drive and has the drive's mean."""
    starts, own, near = samples.copy(), drive.series.time, ROUNDING * times[-1]
    bent = np.searchsorted(own, times[:-1] + near) < np.searchsorted(own, times[1:] - near)
    starts[:-1][bent] = (2.0 * _rows(drive.means(times)) - samples[1:])[bent]
    return starts


def _rows(channels: Times) -> Times:
    """A row per time, (T, D) of (D, T)."""
    return np.ascontiguousarray(channels.T)
