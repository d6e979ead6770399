"""What a car does on the virtual rig: run by run, or one drive with many setups."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING, Literal

import numpy as np

from eightpost.errors import ParameterError, StepError
from eightpost.rig.post.compiled import can_compile, compiled_march, left_all_bounds
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

#: Setups that are computed at once: their records are in memory together.
_TOGETHER = 16


@dataclass(frozen=True, slots=True)
class Run:
    """What one run is made of.

    Attributes:
        drive: What the actuators really do, at `RATE`, with the car's `inputs` as channels.
        shocks: One per corner.
    """

    drive: TimeSeries
    shocks: tuple[Shock, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What a run's car really did; changes from the static state under gravity alone.

    Attributes:
        time: (N,) [s].
        drive: (U, N), roads and loads in the order of the car's inputs.
        position: q (D, N).
        velocity: (D, N).
        acceleration: (D, N).
        shock_force: (C, N) [N].
        friction_force: (C, N) [N].
        tire_force: (C, N), the change from static [N].
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
    """Return what the car does in every run.

    Each run starts at rest; during `lead` before the record its first samples' roads and loads are brought in and held.

    Args:
        car: The truth.
        runs: Drives and shocks.
        lead: [s].
        steps: Of the integration per sample; 4, which is 5 kHz.
        engine: `compiled`, on all cores (a law that it does not know is stepped by the reference), or `reference`:
            the same steps in numpy, slower, equal to rounding.

    Raises:
        ParameterError: A drive lacks an input or has another rate; a run has not one shock per corner.
        StepError: The motion grew beyond all bounds.
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
    """Yield what the car does with each setup on one drive, in their order.

    A few setups are computed at once, so thousands may be asked for: keep measures of the motions, not the motions.

    Args:
        car: The truth.
        drive: What the actuators do, at `RATE`.
        setups: One shock per corner each; use the same shock objects again and again.
        lead: As of `simulate` [s].
        steps: As of `simulate`; 2 (2.5 kHz) cost half as much and change RMS measures by under 0.1 % (those with
            physical dampers by 0.25 %).

    Raises:
        ParameterError: As of `simulate`.
        StepError: As of `simulate`.
    """
    rest = iter(setups)
    while some := list(islice(rest, _TOGETHER)):
        yield from simulate(car, [Run(drive, tuple(shocks)) for shocks in some], lead=lead, steps=steps)


def _check(car: Car, run: Run) -> None:
    missing = [name for name in car.inputs if name not in run.drive]
    if missing:
        raise ParameterError(f"the drive lacks {', '.join(missing)}; the {car.name} has {', '.join(car.inputs)}")
    if run.drive.time.size < 2 or abs(run.drive.sample_rate - RATE) > 1e-6 * RATE:
        raise ParameterError(f"the drive must be sampled at {RATE:g} Hz; resample it first")
    if len(run.shocks) != len(car.corners):
        raise ParameterError(f"the {car.name} takes {len(car.corners)} shocks, not {len(run.shocks)}")


def _inputs(car: Car, drive: TimeSeries) -> Array:
    return np.stack([drive[name] for name in car.inputs])


def _motion(car: Car, run: Run, inputs: Array, records: Array) -> Motion:
    """Return a run's motion from its records (N, 3 D + 3 C)."""
    if not np.isfinite(records[:, 0]).all():
        raise StepError(left_all_bounds(car, int(np.argmin(np.isfinite(records[:, 0])))))
    dofs, corners = car.mass.size, len(car.corners)
    bounds = np.cumsum([dofs, dofs, dofs, corners, corners])
    parts = np.split(records.T, bounds)
    return Motion(run.drive.time, inputs, *(np.ascontiguousarray(part) for part in parts))
