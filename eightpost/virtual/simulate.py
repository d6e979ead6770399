"""Simulation of a car on the virtual rig, and the channels that a rig records of its motion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache, partial
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError, StepError
from eightpost.rig.geometry import MODES, displacement_modes, force_modes, ride_heights
from eightpost.shock import ShockLaw
from eightpost.shock.compiled import LAW_NUMBERS, law_numbers
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.virtual import flexible_motion, kernel
from eightpost.virtual.damper import PhysicalDamper
from eightpost.virtual.drivefiles import LEAD, RATE, STEPS
from eightpost.virtual.flexible import FlexibleCar
from eightpost.virtual.synthetic import TruthDamper
from eightpost.virtual.truths import LinearDamper, Shock
from eightpost.workers.process import usable_processors

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eightpost.virtual.car import Car, RigCar
    from eightpost.virtual.synthetic import ValveSide
    from eightpost.virtual.truths import AnyCar
    from eightpost.virtual.valves import Passage

    Channels = dict[str, tuple[str, Array]]


# ==== Simulation =====================================================================================================

# ---- Inputs of the integration --------------------------------------------------------------------------------------


class Drives:
    """Drives of all runs as cubic Hermite splines through their samples.

    During the lead-in, the drive is its first sample multiplied by a factor that grows from 0 to 1 over the first third
    of the lead-in.
    """

    def __init__(self, inputs: Sequence[Array], lead: int, steps: int = STEPS) -> None:
        """Prepare the drives.

        Args:
            inputs: Roads and loads (U, N) of each run at 1250 Hz. Runs may share an array.
            lead: Number of samples of the lead-in.
            steps: Number S of integration steps per sample.
        """
        self.lead = lead  #: Number of samples of the lead-in.
        own = {id(values): values for values in inputs}
        rows = {key: np.ascontiguousarray(values.T) for key, values in own.items()}
        slopes = {key: np.gradient(values, axis=0) for key, values in rows.items()}
        #: Roads and loads (N, U) of each run, contiguous in memory by rows.
        self.values = [rows[id(values)] for values in inputs]
        self.slopes = [slopes[id(values)] for values in inputs]  #: Changes of the values per sample (N, U).
        #: Factor of the drive during the lead-in and its change per sample (lead + N + 1, 2), for the longest run.
        self.growth = _growth(lead, max(map(len, self.values)))
        #: Weights (2, S, 4) of value, slope, next value and next slope, for the drive and for its slope.
        self.weights = np.stack(_hermite(np.arange(1, steps + 1) / steps))


def _growth(lead: int, samples: int) -> Array:
    """Return the factor of the drive, a raised cosine, and its change per sample (lead + samples + 1, 2)."""
    ramp = max(lead // 3, 1)
    share = np.minimum(np.arange(lead + samples + 1) / ramp, 1.0)
    if lead == 0:
        share[:] = 1.0
    return np.stack([0.5 - 0.5 * np.cos(np.pi * share), 0.5 * np.pi / ramp * np.sin(np.pi * share)], axis=1)


def _hermite(s: Array) -> tuple[Array, Array]:
    """Return the weights (S, 4) of value, slope, next value and next slope, for the curve and for its slope."""
    curve = np.stack([2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, 3 * s**2 - 2 * s**3, s**3 - s**2], axis=1)
    slope = np.stack([6 * s**2 - 6 * s, 3 * s**2 - 4 * s + 1, 6 * s - 6 * s**2, 3 * s**2 - 2 * s], axis=1)
    return curve, slope


# ---- Conversion of cars, shocks and drives to arrays for the compiled integration, and runs on all cores ------------


def _records(car: AnyCar, shocks: Sequence[Sequence[Shock]], drives: Drives) -> list[Array]:
    """Return the records (N, 3 D + 3 C) of each run: q, q', q'', shock, friction and tire forces."""
    own = {id(shock): shock for corners in shocks for shock in corners}
    places = {key: k for k, key in enumerate(own)}
    bank, march = _shock_numbers(tuple(own.values())), _march(car)
    width = 3 * _coordinates(car) + 3 * len(car.corners)

    def run_records(run: int) -> Array:
        which = np.array([places[id(shock)] for shock in shocks[run]])
        values, slopes = drives.values[run], drives.slopes[run]
        records = np.empty((len(values), width))
        inputs = kernel.Inputs(values, slopes, drives.lead, drives.growth, drives.weights, RATE)
        failed = march(which, bank, inputs, records)
        if failed >= -drives.lead:
            raise StepError(_divergence_message(car, failed))
        return records

    with ThreadPoolExecutor(usable_processors()) as pool:
        return list(pool.map(run_records, range(len(shocks))))


def _march(car: AnyCar) -> Callable[..., int]:
    """Return the compiled integration of a car."""
    if isinstance(car, FlexibleCar):
        return partial(flexible_motion.march, flexible_motion.numbers_of(car))
    return partial(kernel.march, _car_numbers(car))


def _coordinates(car: AnyCar) -> int:
    """Return the number of coordinates of the integration."""
    return flexible_motion.COORDINATES if isinstance(car, FlexibleCar) else car.mass.size


def _divergence_message(car: AnyCar, sample: int) -> str:
    """Return the message for a motion that is no longer finite at a sample."""
    return f"the motion of the {car.name} diverged near {sample / RATE:.2f} s; check its shocks and its drive"


def _car_numbers(car: Car) -> kernel.CarNumbers:
    inverse = (1.0 / car.mass)[:, None]
    springs, tires, friction = car.springs, car.tires, car.friction
    stribeck = np.full_like(friction.coulomb, friction.stribeck_velocity)
    return kernel.CarNumbers(
        np.vstack([car.shock, car.wheel, car.spring]).astype(np.float64),
        np.ascontiguousarray(inverse * np.hstack([-car.shock.T, car.wheel.T, -car.spring.T, car.load.T])),
        np.ascontiguousarray(-inverse * car.stiffness),
        np.ascontiguousarray(-inverse * car.damping),
        np.hstack([springs.rate, springs.progression, springs.stop_gap, springs.stop_rate]),
        np.hstack([tires.stiffness, tires.damping, tires.static_load]),
        np.hstack([friction.coulomb, friction.breakaway, friction.stiffness, stribeck]),
    )


def _shock_numbers(shocks: tuple[Shock, ...]) -> kernel.ShockNumbers:
    kinds, numbers, starts = [], np.zeros((len(shocks), kernel.NUMBERS)), np.zeros((len(shocks), kernel.STATES))
    laws = np.zeros(len(shocks), LAW_NUMBERS)
    for k, shock in enumerate(shocks):
        kind, row = _numbers_of(shock)
        kinds.append(kind)
        numbers[k, : len(row)] = row
        if isinstance(shock, PhysicalDamper):
            starts[k, :3] = shock._rest(0.0)
        if isinstance(shock, ShockLaw):
            laws[k : k + 1] = law_numbers([shock])
    return kernel.ShockNumbers(np.array(kinds), numbers, starts, laws)


def _numbers_of(shock: Shock) -> tuple[int, list[float]]:
    """Return a shock's type and its row of numbers, in the order documented in the kernel."""
    if isinstance(shock, LinearDamper):
        return kernel.LINEAR, [shock.damping]
    if isinstance(shock, TruthDamper):
        return kernel.FLUID, _fluid_numbers(shock)
    if isinstance(shock, PhysicalDamper):
        return kernel.PHYSICAL, list(_physical_numbers(shock))
    return kernel.LAW, []


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


# ---- Simulation of a car on the virtual rig, for several runs or for one drive with many setups ---------------------

#: Number of setups that are computed at once and whose records are in memory together.
_TOGETHER = 16


@dataclass(frozen=True, slots=True)
class Run:
    """Inputs of one run."""

    drive: TimeSeries  #: Actual motion and force of the actuators at `RATE`, with the car's `inputs` as channels.
    shocks: tuple[Shock, ...]  #: One shock per corner.


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Exact motion of the car in a run, relative to the static state under gravity alone."""

    time: Array  #: Times (N,) [s].
    drive: Array  #: Roads and loads (U, N) in the order of the car's inputs.
    position: Array  #: Coordinates q (D, N); those in which the rig measures for the flexible car.
    velocity: Array  #: Velocities q' (D, N).
    acceleration: Array  #: Accelerations q'' (D, N).
    shock_force: Array  #: Forces of the shocks (C, N) [N].
    friction_force: Array  #: Friction forces (C, N) [N].
    tire_force: Array  #: Changes of the tire forces from static (C, N) [N].


def simulate(car: AnyCar, runs: Sequence[Run], *, lead: float = LEAD, steps: int = STEPS) -> list[Motion]:
    """Return the motion of the car in every run.

    Each run starts at rest. During the lead-in before the record, the roads and loads grow to the values of the first
    sample and are then held.

    Args:
        car: Car to simulate.
        runs: Drives and shocks of the runs.
        lead: Duration of the lead-in [s].
        steps: Number of integration steps per sample; default 4, which is 5 kHz.

    Raises:
        ParameterError: A drive lacks an input or has another sample rate, or a run does not have one shock per corner.
        StepError: The motion diverged.
    """
    for run in runs:
        _check(car, run)
    inputs = {id(run.drive): _inputs(car, run.drive) for run in runs}
    drives = Drives([inputs[id(run.drive)] for run in runs], round(lead * RATE), steps)
    shocks = [run.shocks for run in runs]
    with np.errstate(over="ignore", invalid="ignore"):
        records = _records(car, shocks, drives)
    return [_motion(car, run, inputs[id(run.drive)], rows) for run, rows in zip(runs, records, strict=True)]


def simulate_setups(
    car: AnyCar, drive: TimeSeries, setups: Iterable[Sequence[Shock]], *, lead: float = LEAD, steps: int = STEPS
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


def _check(car: AnyCar, run: Run) -> None:
    missing = [name for name in car.inputs if name not in run.drive]
    if missing:
        raise ParameterError(f"the drive lacks {', '.join(missing)}; the {car.name} needs {', '.join(car.inputs)}")
    if run.drive.time.size < 2 or abs(run.drive.sample_rate - RATE) > 1e-6 * RATE:
        raise ParameterError(f"the drive must be sampled at {RATE:g} Hz; resample it first")
    if len(run.shocks) != len(car.corners):
        raise ParameterError(f"the {car.name} needs {len(car.corners)} shocks, not {len(run.shocks)}")


def _inputs(car: AnyCar, drive: TimeSeries) -> Array:
    return np.stack([drive[name] for name in car.inputs])


def _motion(car: AnyCar, run: Run, inputs: Array, records: Array) -> Motion:
    """Return a run's motion from its records (N, 3 D + 3 C)."""
    if not np.isfinite(records[:, 0]).all():
        raise StepError(_divergence_message(car, int(np.argmin(np.isfinite(records[:, 0])))))
    dofs, corners = _coordinates(car), len(car.corners)
    bounds = np.cumsum([dofs, dofs, dofs, corners, corners])
    parts = np.split(records.T, bounds)
    if isinstance(car, FlexibleCar):
        parts[:3] = flexible_motion.measured(car, records)
    return Motion(run.drive.time, inputs, *(np.ascontiguousarray(part) for part in parts))


# ==== Channels of Table 6.1: sensor readings, commands and math channels =============================================

#: Low-pass of the shock potentiometer before differentiation (our own choice; 6.1.2 does not state it) [Hz].
POT_CUTOFF = 50.0

_GRAVITY = convert(1.0, "g_0", "m/s2")


@dataclass(frozen=True, slots=True)
class RigSensors:
    """White noise of the sensors of rig and car, as standard deviations."""

    position: float = convert(5e-4, "in", "m")  #: Noise of the position sensors (LVDTs) of the actuators [m].
    travel: float = convert(1e-3, "in", "m")  #: Noise of the shock potentiometers [m].
    load: float = convert(3.0, "lbf", "N")  #: Noise of the load cells of wheelloaders and aeroloaders [N].
    shock_load: float = convert(1.0, "lbf", "N")  #: Noise of the load cells of the shocks [N].
    acceleration: float = convert(0.01, "g_0", "m/s2")  #: Noise of the accelerometers [m/s2].
    relative: float = 0.0  #: Additional white noise, relative to the standard deviation of each measured channel [1].

    @classmethod
    def perfect(cls, *, relative: float = 0.0) -> RigSensors:
        """Return sensors without noise except for the relative noise."""
        return cls(0.0, 0.0, 0.0, 0.0, 0.0, relative)

    def noise_of(self, name: str, unit: str) -> float:
        """Return the standard deviation of a measured channel's noise."""
        quantity = name.rpartition(".")[2]
        if quantity in ("displacement", "force"):
            return self.travel if quantity == "displacement" else self.shock_load
        return {"m": self.position, "N": self.load, "m/s2": self.acceleration}.get(unit, 0.0)


def sensor_channels(car: RigCar, motion: Motion, sensors: RigSensors, generator: np.random.Generator) -> Channels:
    """Return the sensor readings with noise: channels 1 to 16 and 25 to 44 of Table 6.1."""
    channels = {}
    for name, (unit, values) in _true_channels(car, motion).items():
        spread = sensors.noise_of(name, unit) + sensors.relative * float(np.std(values))
        noise = spread * generator.standard_normal(values.size) if spread else 0.0
        channels[name] = (unit, values + noise)
    return channels


def commands(car: RigCar, command: TimeSeries) -> Channels:
    """Return the commands, channels 17 to 24: `<input>_command`."""
    grid = command.resample(RATE)
    return {f"{name}_command": (grid.unit(name), grid[name]) for name in car.inputs}


def _true_channels(car: RigCar, motion: Motion) -> Channels:
    q, a, corners = motion.position, motion.acceleration, len(car.corners)
    roads, loads = motion.drive[:corners], motion.drive[corners:]
    channels: Channels = {}
    channels |= _corner_channels(car, "road", "m", roads)
    channels |= _aero_positions(car, q)
    channels |= _corner_channels(car, "tire_force", "N", motion.tire_force + car.static_load)
    channels |= {n: (u, row) for n, u, row in zip(car.loads, car.load_units, loads, strict=True)}
    channels |= _corner_channels(car, "displacement", "m", car.shock @ q)
    channels |= _corner_channels(car, "force", "N", motion.shock_force)
    channels |= _corner_channels(car, "hub_acceleration", "m/s2", car.wheel @ a)
    channels |= _corner_channels(car, "chassis_acceleration", "m/s2", car.chassis @ a)
    return channels | _cockpit(car, q, a)


def _corner_channels(car: RigCar, quantity: str, unit: str, rows: Array) -> Channels:
    return {name: (unit, row) for name, row in zip(car.named(quantity), rows, strict=True)}


def _aero_positions(car: RigCar, q: Array) -> Channels:
    """Return channels 5 to 8; none for the seven-DOF car, which has modal forces instead of aeroloaders."""
    if car.loads != car.named("aero"):
        return {}
    return _corner_channels(car, "aero_position", "m", -car.load @ q)


def _cockpit(car: RigCar, q: Array, a: Array) -> Channels:
    """Return channels 41 to 44; lateral and longitudinal acceleration include gravity through the chassis' tilt."""
    if not car.points:
        return {}
    points = car.points
    return {
        "cg.vertical_acceleration": ("m/s2", points["heave"] @ a),
        "cg.longitudinal_acceleration": ("m/s2", _GRAVITY * (points["pitch"] @ q)),
        "cg.lateral_acceleration": ("m/s2", _GRAVITY * (points["roll"] @ q)),
        "driver.acceleration": ("m/s2", points["driver"] @ a),
    }


def with_math(car: RigCar, motion: Motion, series: TimeSeries) -> TimeSeries:
    """Return the record with the math channels 45 to 62, computed from the measured channels as in 6.1.2.

    The ride heights of the linear cars are exact, because these cars have no aeroloaders from which to compute them.
    """
    channels = {n: (u, row) for n, u, row in zip(series.names, series.units, series.values, strict=True)}
    geometry = car.geometry
    if geometry is not None and car.named("aero_position")[0] in series:
        modes = displacement_modes(geometry) @ np.stack([series[n] for n in car.named("aero_position")])
        channels |= _mode_channels(modes, ("m", "rad", "rad", "rad"), ("", "", "", ""))
        for suffix, names in (("", car.named("aero")), ("_command", car.named("aero_command"))):
            forces = -force_modes(geometry) @ np.stack([series[n] for n in names])
            kinds = (f"_force{suffix}", *(f"_moment{suffix}",) * 3)
            channels |= _mode_channels(forces, ("N", "N.m", "N.m", "N.m"), kinds)
    channels |= _ride_heights(car, motion, channels)
    for name, pot in zip(car.named("velocity"), car.named("displacement"), strict=True):
        channels[name] = ("m/s", velocity_from_displacement(series[pot], RATE, POT_CUTOFF))
    return TimeSeries.from_channels(series.time, channels)


def _mode_channels(rows: Array, units: tuple[str, ...], suffixes: tuple[str, ...]) -> Channels:
    names = (f"aero.{mode}{suffix}" for mode, suffix in zip(MODES, suffixes, strict=True))
    return dict(zip(names, zip(units, rows, strict=True), strict=True))


def _ride_heights(car: RigCar, motion: Motion, channels: Mapping[str, tuple[str, Array]]) -> Channels:
    roads = np.stack([channels[name][1] for name in car.named("road")])
    if car.geometry is None:
        return {"ride_height": ("m", (car.chassis @ motion.position)[0] - roads[0])}
    if "aero.heave" in channels:
        heave, pitch = channels["aero.heave"][1], channels["aero.pitch"][1]
    else:
        heave, pitch = (car.points[name] @ motion.position for name in ("heave", "pitch"))
    front, rear = ride_heights(heave, pitch, roads, car.geometry)
    return {"front.ride_height": ("m", front), "rear.ride_height": ("m", rear)}
