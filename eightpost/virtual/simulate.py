"""Simulation of a car on the virtual rig, and the channels that a rig records of its motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError, StepError
from eightpost.rig.geometry import MODES, displacement_modes, force_modes, ride_heights
from eightpost.shock import ShockLaw
from eightpost.shock.records import LAW_NUMBERS, law_numbers
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.virtual import kernel
from eightpost.virtual.drivefiles import LEAD, RATE, STEPS
from eightpost.workers.process import usable_processors

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eightpost.virtual.car import AnyCar
    from eightpost.virtual.shocks import Shock

    Channels = dict[str, tuple[str, Array]]


# ==== Simulation of several runs, or of one drive with many setups ===================================================

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
    drives = {id(run.drive): run.drive for run in runs}
    inputs = {key: _inputs(car, drive, round(lead * RATE), steps) for key, drive in drives.items()}
    different = {id(shock): shock for run in runs for shock in run.shocks}
    places = {key: place for place, key in enumerate(different)}
    bank, numbers = _bank(tuple(different.values())), car.numbers()

    def motion(run: Run) -> Motion:
        which, driven = np.array([places[id(shock)] for shock in run.shocks]), inputs[id(run.drive)]
        records = np.empty((len(driven.values), 3 * numbers.mass.size + 3 * which.size))
        failed = kernel.march(numbers, which, bank, driven, records)
        finite = np.isfinite(records[:, 0])
        if failed >= -driven.lead or not finite.all():
            at = failed if failed >= -driven.lead else int(np.argmin(finite))
            raise StepError(
                f"the motion of the {car.name} diverged near {at / RATE:.2f} s; check its shocks and its drive"
            )
        parts = (*car.motion(records), *np.split(records.T[-3 * which.size :], 3))
        return Motion(run.drive.time, driven.values.T, *(np.ascontiguousarray(part) for part in parts))

    with ThreadPoolExecutor(usable_processors()) as pool:
        return list(pool.map(motion, runs))


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


def _inputs(car: AnyCar, drive: TimeSeries, lead: int, steps: int) -> kernel.Inputs:
    """Return a drive as cubic Hermite splines through its samples.

    During the lead-in, the drive is its first sample multiplied by a factor, a raised cosine, that grows from 0 to 1
    over the first third of the lead-in.
    """
    values = np.ascontiguousarray(np.stack([drive[name] for name in car.inputs]).T)
    ramp, places = max(lead // 3, 1), np.arange(lead + len(values) + 1)
    share = np.minimum(places / ramp, 1.0) if lead else np.ones(places.size)
    growth = np.stack([0.5 - 0.5 * np.cos(np.pi * share), 0.5 * np.pi / ramp * np.sin(np.pi * share)], axis=1)
    s = np.arange(1, steps + 1) / steps
    curve = np.stack([2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, 3 * s**2 - 2 * s**3, s**3 - s**2], axis=1)
    slope = np.stack([6 * s**2 - 6 * s, 3 * s**2 - 4 * s + 1, 6 * s - 6 * s**2, 3 * s**2 - 2 * s], axis=1)
    return kernel.Inputs(values, np.gradient(values, axis=0), lead, growth, np.stack([curve, slope]), RATE)


def _bank(shocks: Sequence[Shock]) -> kernel.ShockNumbers:
    rows = [kernel.ShockRow(kernel.LAW) if isinstance(shock, ShockLaw) else shock.row for shock in shocks]
    numbers, starts = np.zeros((len(rows), kernel.NUMBERS)), np.zeros((len(rows), kernel.STATES))
    laws = np.zeros(len(rows), LAW_NUMBERS)
    for k, (shock, row) in enumerate(zip(shocks, rows, strict=True)):
        numbers[k, : len(row.numbers)], starts[k, : len(row.start)] = row.numbers, row.start
        if isinstance(shock, ShockLaw):
            laws[k : k + 1] = law_numbers([shock])
    return kernel.ShockNumbers(np.array([row.kind for row in rows]), numbers, starts, laws)


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


def sensor_channels(car: AnyCar, motion: Motion, sensors: RigSensors, generator: np.random.Generator) -> Channels:
    """Return the sensor readings with noise: channels 1 to 16 and 25 to 44 of Table 6.1."""
    channels = {}
    for name, (unit, values) in _true_channels(car, motion).items():
        spread = sensors.noise_of(name, unit) + sensors.relative * float(np.std(values))
        noise = spread * generator.standard_normal(values.size) if spread else 0.0
        channels[name] = (unit, values + noise)
    return channels


def commands(car: AnyCar, command: TimeSeries) -> Channels:
    """Return the commands, channels 17 to 24: `<input>_command`."""
    grid = command.resample(RATE)
    return {f"{name}_command": (grid.unit(name), grid[name]) for name in car.inputs}


def _true_channels(car: AnyCar, motion: Motion) -> Channels:
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


def _corner_channels(car: AnyCar, quantity: str, unit: str, rows: Array) -> Channels:
    return {name: (unit, row) for name, row in zip(car.named(quantity), rows, strict=True)}


def _aero_positions(car: AnyCar, q: Array) -> Channels:
    """Return channels 5 to 8; none for the seven-DOF car, which has modal forces instead of aeroloaders."""
    if car.loads != car.named("aero"):
        return {}
    return _corner_channels(car, "aero_position", "m", -car.load @ q)


def _cockpit(car: AnyCar, q: Array, a: Array) -> Channels:
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


def with_math(car: AnyCar, motion: Motion, series: TimeSeries) -> TimeSeries:
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


def _ride_heights(car: AnyCar, motion: Motion, channels: Mapping[str, tuple[str, Array]]) -> Channels:
    roads = np.stack([channels[name][1] for name in car.named("road")])
    if car.geometry is None:
        return {"ride_height": ("m", (car.chassis @ motion.position)[0] - roads[0])}
    if "aero.heave" in channels:
        heave, pitch = channels["aero.heave"][1], channels["aero.pitch"][1]
    else:
        heave, pitch = (car.points[name] @ motion.position for name in ("heave", "pitch"))
    front, rear = ride_heights(heave, pitch, roads, car.geometry)
    return {"front.ride_height": ("m", front), "rear.ride_height": ("m", rear)}
