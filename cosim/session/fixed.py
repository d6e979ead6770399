"""Stepping with coupling steps of one size."""

from __future__ import annotations

import numpy as np

from cosim.engine.march import Grid
from cosim.engine.plan import DONE, STOPPED, Drive
from cosim.session.failure import failure
from cosim.session.running import Ending, Marching, Running
from cosim.session.setup import Setup
from cosim.session.times import Times, joined, step_sizes


def march_fixed(setup: Setup, running: Running, marching: Marching) -> Ending:
    """Step from the first coupling point to the last, or until it is interrupted.

    Raises:
        StepError: A component failed, or the coupling diverged.
    """
    grid, count = _grid(setup), setup.times.size - 1
    march = marching.bind(running.plan, running.memory, running.tape, grid, marching.mode)
    end = DONE
    for first in range(0, count, marching.chunk):
        last = min(first + marching.chunk, count)
        end = march(first, last)
        if end == STOPPED:
            break
        if end != DONE:
            raise failure(setup, running, end, _reached(setup, running))
        marching.progress(last / count)
    return Ending(end, _reached(setup, running), least=setup.step, largest=setup.step)


def _reached(setup: Setup, running: Running) -> float:
    """The coupling point at which the loop ended [s]."""
    return float(setup.times[int(running.memory.failure[3])])


def _grid(setup: Setup) -> Grid:
    """Coupling points, and with them the drive's own points between them."""
    scenario, times = setup.scenario, setup.times
    if scenario.drive is not None and setup.following:
        own = scenario.drive.series.time - scenario.drive_start
        times = joined(times, own[(own > 0.0) & (own < scenario.stop)])
    begins = np.searchsorted(times, setup.times) if times.size > setup.times.size else np.arange(times.size)
    steps = step_sizes(setup.times, setup.step)
    return Grid(setup.times, steps, setup.recorded, begins, Drive(times, *_drive_rows(setup, times)))


def _drive_rows(setup: Setup, times: Times) -> tuple[Times, Times]:
    """The drive (T+1, D) at times (T+1,) [s], and its means between them (T, D), 0 where no component asks for them."""
    drive = setup.scenario.drive
    if drive is None:
        return np.zeros((times.size, 0)), np.zeros((times.size - 1, 0))
    times = times + setup.scenario.drive_start
    samples = np.ascontiguousarray(drive.sample(times).T)
    if setup.system.ramps:
        return samples, np.zeros((times.size - 1, 0))
    return samples, np.ascontiguousarray(drive.means(times).T)
