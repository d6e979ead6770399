"""Simulation of a car on the virtual rig, for several runs or for one drive with many setups."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Literal

import numpy as np

from eightpost.errors import ParameterError, StepError
from eightpost.rig.post.compiled import can_compile, compiled_march, divergence_message
from eightpost.rig.post.drive import LEAD, RATE, STEPS, Drives
from eightpost.rig.post.reference import reference_march
from eightpost.rig.post.shocks import Shock
from eightpost.signals.timeseries import TimeSeries

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from numpy.typing import NDArray

    from eightpost.rig.post.car import Car

    Array = NDArray[np.float64]

Engine = Literal["compiled", "reference"]

#: Number of setups that are computed at once and whose records are in memory together.
_TOGETHER = 16


@dataclass(frozen=True, slots=True)
class Run:
    """Inputs of one run.

    Attributes:
        drive: Actual motion and force of the actuators at `RATE`, with the car's `inputs` as channels.
        shocks: One shock per corner.
    """

    drive: TimeSeries
    shocks: tuple[Shock, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Exact motion of the car in a run, relative to the static state under gravity alone.

    Attributes:
        time: Times (N,) [s].
        drive: Roads and loads (U, N) in the order of the car's inputs.
        position: Coordinates q (D, N).
        velocity: Velocities q' (D, N).
        acceleration: Accelerations q'' (D, N).
        shock_force: Forces of the shocks (C, N) [N].
        friction_force: Friction forces (C, N) [N].
        tire_force: Changes of the tire forces from static (C, N) [N].
    """

    time: Array
    drive: Array
    position: Array
    velocity: Array
    acceleration: Array
    shock_force: Array
    friction_force: Array
    tire_force: Array


def simulate(
    car: Car, runs: Sequence[Run], *, lead: float = LEAD, steps: int = STEPS, engine: Engine = "compiled"
) -> list[Motion]:
    """Return the motion of the car in every run.

    Each run starts at rest. During the lead-in before the record, the roads and loads grow to the values of the first
    sample and are then held.

    Args:
        car: Car to simulate.
        runs: Drives and shocks of the runs.
        lead: Duration of the lead-in [s].
        steps: Number of integration steps per sample; default 4, which is 5 kHz.
        engine: "compiled" uses all cores (and "reference" for laws that it does not support); "reference" computes the
            same steps in numpy, slower and equal up to rounding.

    Raises:
        ParameterError: A drive lacks an input or has another sample rate, or a run does not have one shock per corner.
        StepError: The motion diverged.
    """
    for run in runs:
        _check(car, run)
    inputs = {id(run.drive): _inputs(car, run.drive) for run in runs}
    drives = Drives([inputs[id(run.drive)] for run in runs], round(lead * RATE), steps)
    shocks = [run.shocks for run in runs]
    march = compiled_march if engine == "compiled" and can_compile(shocks) else reference_march
    with np.errstate(over="ignore", invalid="ignore"):
        records = march(car, shocks, drives)
    return [_motion(car, run, inputs[id(run.drive)], rows) for run, rows in zip(runs, records, strict=True)]


def simulate_setups(
    car: Car, drive: TimeSeries, setups: Iterable[Sequence[Shock]], *, lead: float = LEAD, steps: int = STEPS
) -> Iterator[Motion]:
    """Yield the motion of the car with each setup for one drive, in the order of the setups.

    Only a few setups are computed at once, so there may be thousands. The caller should keep measures of the motions,
    not the motions.

    Args:
        car: Car to simulate.
        drive: Actual motion and force of the actuators, at `RATE`.
        setups: Setups with one shock per corner; setups should share shock objects.
        lead: Duration of the lead-in [s]; see `simulate`.
        steps: Number of integration steps per sample; see `simulate`. 2 steps (2.5 kHz) take half the time and change
            RMS measures by under 0.1 % (with physical dampers by 0.25 %).

    Raises:
        ParameterError: A drive or setup is refused by `simulate`.
        StepError: The motion diverged.
    """
    rest = iter(setups)
    while batch := list(islice(rest, _TOGETHER)):
        yield from simulate(car, [Run(drive, tuple(shocks)) for shocks in batch], lead=lead, steps=steps)


def _check(car: Car, run: Run) -> None:
    missing = [name for name in car.inputs if name not in run.drive]
    if missing:
        raise ParameterError(f"the drive lacks {', '.join(missing)}; the {car.name} needs {', '.join(car.inputs)}")
    if run.drive.time.size < 2 or abs(run.drive.sample_rate - RATE) > 1e-6 * RATE:
        raise ParameterError(f"the drive must be sampled at {RATE:g} Hz; resample it first")
    if len(run.shocks) != len(car.corners):
        raise ParameterError(f"the {car.name} needs {len(car.corners)} shocks, not {len(run.shocks)}")


def _inputs(car: Car, drive: TimeSeries) -> Array:
    return np.stack([drive[name] for name in car.inputs])


def _motion(car: Car, run: Run, inputs: Array, records: Array) -> Motion:
    """Return a run's motion from its records (N, 3 D + 3 C)."""
    if not np.isfinite(records[:, 0]).all():
        raise StepError(divergence_message(car, int(np.argmin(np.isfinite(records[:, 0])))))
    dofs, corners = car.mass.size, len(car.corners)
    bounds = np.cumsum([dofs, dofs, dofs, corners, corners])
    parts = np.split(records.T, bounds)
    return Motion(run.drive.time, inputs, *(np.ascontiguousarray(part) for part in parts))
