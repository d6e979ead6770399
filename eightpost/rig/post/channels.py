"""Channels of Table 6.1, computed from the exact motion of a car: sensor readings, commands and math channels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.rig.post.car import MODES, displacement_modes, force_modes, ride_heights
from eightpost.rig.post.drivefiles import RATE
from eightpost.signals.filters import velocity_from_displacement
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eightpost.rig.post.car import RigCar
    from eightpost.rig.post.simulate import Motion

    Channels = dict[str, tuple[str, Array]]

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
