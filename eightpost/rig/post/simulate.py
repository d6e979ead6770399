"""Simulation of a car on the virtual rig."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import TYPE_CHECKING, Literal

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError, StepError
from eightpost.rig.damper import PhysicalDamper
from eightpost.rig.post.drivefiles import LEAD, RATE, STEPS, Drives
from eightpost.rig.post.kernel import (
    FLUID,
    LAW,
    LINEAR,
    NUMBERS,
    PHYSICAL,
    STATES,
    CarNumbers,
    Inputs,
    ShockNumbers,
    march,
)
from eightpost.rig.post.shocks import LinearDamper, Shock, ShockSet
from eightpost.rig.truth_damper import TruthDamper
from eightpost.shock import ShockLaw
from eightpost.shock.compiled import LAW_NUMBERS, law_numbers
from eightpost.signals.timeseries import TimeSeries
from eightpost.workers.process import usable_processors

if TYPE_CHECKING:
    from eightpost.rig.damper.valves import Passage
    from eightpost.rig.post.car import Car
    from eightpost.rig.truth_damper import ValveSide


# ---- Conversion of cars, shocks and drives to arrays for the compiled integration, and runs on all cores ------------


def _compiled_march(car: Car, shocks: Sequence[Sequence[Shock]], drives: Drives) -> list[Array]:
    """Return the records (N, 3 D + 3 C) of each run, like `reference_march`, using all cores in parallel."""
    own = {id(shock): shock for corners in shocks for shock in corners}
    places = {key: k for k, key in enumerate(own)}
    numbers, bank = _car_numbers(car), _shock_numbers(tuple(own.values()))

    def run_records(run: int) -> Array:
        which = np.array([places[id(shock)] for shock in shocks[run]])
        values, slopes = drives.values[run], drives.slopes[run]
        records = np.empty((len(values), 3 * car.mass.size + 3 * len(car.corners)))
        inputs = Inputs(values, slopes, drives.lead, drives.growth, drives.weights, RATE)
        failed = march(numbers, which, bank, inputs, records)
        if failed >= -drives.lead:
            raise StepError(_divergence_message(car, failed))
        return records

    with ThreadPoolExecutor(usable_processors()) as pool:
        return list(pool.map(run_records, range(len(shocks))))


def _divergence_message(car: Car, sample: int) -> str:
    """Return the message for a motion that is no longer finite at a sample."""
    return f"the motion of the {car.name} diverged near {sample / RATE:.2f} s; check its shocks and its drive"


def _car_numbers(car: Car) -> CarNumbers:
    inverse = (1.0 / car.mass)[:, None]
    springs, tires, friction = car.springs, car.tires, car.friction
    stribeck = np.full_like(friction.coulomb, friction.stribeck_velocity)
    return CarNumbers(
        np.vstack([car.shock, car.wheel, car.spring]).astype(np.float64),
        np.ascontiguousarray(inverse * np.hstack([-car.shock.T, car.wheel.T, -car.spring.T, car.load.T])),
        np.ascontiguousarray(-inverse * car.stiffness),
        np.ascontiguousarray(-inverse * car.damping),
        np.hstack([springs.rate, springs.progression, springs.stop_gap, springs.stop_rate]),
        np.hstack([tires.stiffness, tires.damping, tires.static_load]),
        np.hstack([friction.coulomb, friction.breakaway, friction.stiffness, stribeck]),
    )


def _shock_numbers(shocks: tuple[Shock, ...]) -> ShockNumbers:
    kinds, numbers, starts = [], np.zeros((len(shocks), NUMBERS)), np.zeros((len(shocks), STATES))
    laws = np.zeros(len(shocks), LAW_NUMBERS)
    for k, shock in enumerate(shocks):
        kind, row = _numbers_of(shock)
        kinds.append(kind)
        numbers[k, : len(row)] = row
        if isinstance(shock, PhysicalDamper):
            starts[k, :3] = shock._rest(0.0)
        if isinstance(shock, ShockLaw):
            laws[k : k + 1] = law_numbers([shock])
    return ShockNumbers(np.array(kinds), numbers, starts, laws)


def _numbers_of(shock: Shock) -> tuple[int, list[float]]:
    """Return a shock's type and its row of numbers, in the order documented in the kernel."""
    if isinstance(shock, LinearDamper):
        return LINEAR, [shock.damping]
    if isinstance(shock, TruthDamper):
        return FLUID, _fluid_numbers(shock)
    if isinstance(shock, PhysicalDamper):
        return PHYSICAL, list(_physical_numbers(shock))
    return LAW, []


def _fluid_numbers(damper: TruthDamper) -> list[float]:
    own = [damper.fluid_stiffness, damper.stiffening_force, damper.gas_stiffness, damper.gas_preload]
    return [*own, damper.seal_drag, damper.seal_velocity, *_side(damper.compression), *_side(damper.rebound)]


def _side(side: ValveSide) -> list[float]:
    return [side.bleed_linear, side.bleed_square, side.opening_force, side.opening_width, side.open_damping]


@lru_cache(maxsize=64)
def _physical_numbers(damper: PhysicalDamper) -> tuple[float, ...]:
    fluid, cylinder, gas, plant = damper.fluid, damper.cylinder, damper.gas, damper.plant
    oil = (fluid.vapour_pressure, fluid.span, fluid.gas_exponent, fluid.gas_fraction)
    give = (1.0 / fluid.bulk_modulus, 1.0 / fluid.wall_modulus)
    room = (cylinder.compression_area, cylinder.rebound_area, cylinder.compression_length, cylinder.rebound_length)
    passages = [_passage(p) for valve in (plant.main, plant.head) for p in (valve.forward, valve.backward)]
    flows = tuple(number for passage in passages for number in passage)
    own = (gas.charge, gas.exponent, 1.0 / gas.volume)
    return (*oil, *give, *room, *own, *flows, plant.force(0.0, 0.0), damper.seals.drag, damper.seals.length)


def _passage(passage: Passage) -> tuple[float, ...]:
    return (passage.orifice, passage.transition, passage.opening, passage.port, passage.preload)


# ---- Reference integration in numpy ---------------------------------------------------------------------------------


def reference_march(car: Car, shocks: Sequence[Sequence[Shock]], drives: Drives) -> list[Array]:
    """Return the records (N, 3 D + 3 C) of each run: q, q', q'', shock, friction and tire forces.

    Args:
        car: Car to simulate.
        shocks: Shocks at the corners for each run.
        drives: Drives of the runs.
    """
    runs, steps = len(drives.values), drives.weights.shape[1]
    stepper = _Stepper(car, ShockSet(shocks), 1.0 / (RATE * steps), runs)
    records = np.empty((drives.samples, 3 * car.mass.size + 3 * len(car.corners), runs))
    for sample in range(-drives.lead, drives.samples):
        if sample >= 0:
            records[sample] = stepper.record()
        values, slopes = drives.between(sample)
        for k in range(steps):
            stepper.step(values[k], slopes[k])
    return [records[: len(values), :, i] for i, values in enumerate(drives.values)]


class _Stepper:
    """States of all runs, and their integration by one step."""

    def __init__(self, car: Car, shocks: ShockSet, step: float, runs: int) -> None:
        self._car, self._shocks, self._step = car, shocks, step
        dofs, corners = car.mass.size, len(car.corners)
        self._corners = corners
        self.q, self.v, self.a = (np.zeros((dofs, runs)) for _ in range(3))
        self._speed, self._bend = np.zeros((corners, runs)), np.zeros((corners, runs))
        self._shock_force, self._friction, self._tire = (np.zeros((corners, runs)) for _ in range(3))
        self._ports = np.vstack([car.shock, car.wheel, car.spring])
        inverse = (1.0 / car.mass)[:, None]
        self._push = inverse * np.hstack([-car.shock.T, car.wheel.T, -car.spring.T, car.load.T])
        self._stiffness, self._damping = -inverse * car.stiffness, -inverse * car.damping
        self._linear = bool(np.any(car.stiffness) or np.any(car.damping))

    def record(self) -> Array:
        """Return q, v, a, shock, friction and tire forces, stacked (3 D + 3 C, B)."""
        return np.vstack([self.q, self.v, self.a, self._shock_force, self._friction, self._tire])

    def step(self, drive: Array, slope: Array) -> None:
        """Advance by one step, at whose end the inputs are `drive` (U, B) with the slope `slope` (U, B) [1/s]."""
        h, car, n = self._step, self._car, self._corners
        self.q = self.q + h * (self.v + (0.5 * h) * self.a)
        guess = self.v + h * self.a
        places, speeds = self._ports @ self.q, self._ports @ guess
        speed = speeds[:n]
        self._shock_force = self._shocks.advance(self._speed, speed, places[:n], h)
        self._bend = car.friction.bend(self._bend, 0.5 * (self._speed + speed), h)
        self._friction = car.friction.force(self._bend)
        self._tire = car.tires.force(drive[:n] - places[n : 2 * n], slope[:n] - speeds[n : 2 * n])
        spring = car.springs.force(places[2 * n :])
        forces = np.vstack([self._shock_force + self._friction, self._tire, spring, drive[n:]])
        a = self._push @ forces
        if self._linear:
            a = a + self._stiffness @ self.q + self._damping @ guess
        self.v = self.v + (0.5 * h) * (self.a + a)
        self.a, self._speed = a, self._ports[:n] @ self.v


# ---- Simulation of a car on the virtual rig, for several runs or for one drive with many setups ---------------------

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
        engine: "compiled" uses all cores; "reference" computes the same steps in Python, equal up to rounding.

    Raises:
        ParameterError: A drive lacks an input or has another sample rate, or a run does not have one shock per corner.
        StepError: The motion diverged.
    """
    for run in runs:
        _check(car, run)
    inputs = {id(run.drive): _inputs(car, run.drive) for run in runs}
    drives = Drives([inputs[id(run.drive)] for run in runs], round(lead * RATE), steps)
    shocks = [run.shocks for run in runs]
    march = _compiled_march if engine == "compiled" else reference_march
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
        raise StepError(_divergence_message(car, int(np.argmin(np.isfinite(records[:, 0])))))
    dofs, corners = car.mass.size, len(car.corners)
    bounds = np.cumsum([dofs, dofs, dofs, corners, corners])
    parts = np.split(records.T, bounds)
    return Motion(run.drive.time, inputs, *(np.ascontiguousarray(part) for part in parts))
