"""True cars of the virtual rigs without sensors: their channels on a drive, and RMS measures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from eightpost.array_types import Array
from eightpost.rig.geometry import displacement_modes, ride_heights
from eightpost.signals import TimeSeries
from eightpost.virtual import AnyCar, Motion, Run, Shock, simulate
from eightpost.virtual.drivefiles import RATE

#: Time at the start of a simulation that is left out of the measures [s].
SETTLING = 3.0

#: Sum of the tire forces, whose RMS is the measure of grip (2.5).
TOTAL = "total_tire_force"


def channels_of(car: AnyCar, motion: Motion) -> dict[str, tuple[str, Array]]:
    """Return shock velocities, tire forces, hub accelerations and ride heights of a true car, with their units."""
    rows: dict[str, tuple[str, Array]] = {}
    for quantity, unit, values in (
        ("velocity", "m/s", car.shock @ motion.velocity),
        ("tire_force", "N", motion.tire_force),
        ("hub_acceleration", "m/s2", car.wheel @ motion.acceleration),
    ):
        rows |= {name: (unit, row) for name, row in zip(car.named(quantity), values, strict=True)}
    roads = motion.drive[: len(car.corners)]
    if car.geometry is None:
        chassis = (car.chassis @ motion.position)[0]
        return rows | {"ride_height": ("m", chassis - roads[0]), "chassis_position": ("m", chassis)}
    if car.loads == car.named("aero"):
        heave, pitch = (displacement_modes(car.geometry) @ (-car.load @ motion.position))[:2]
    else:
        heave, pitch = car.points["heave"] @ motion.position, car.points["pitch"] @ motion.position
    front, rear = ride_heights(heave, pitch, roads, car.geometry)
    return rows | {"front.ride_height": ("m", front), "rear.ride_height": ("m", rear)}


def perfect_records(car: AnyCar, drive: TimeSeries, setups: Sequence[Sequence[Shock]]) -> tuple[TimeSeries, ...]:
    """Return records without noise at 1250 Hz: roads, loads, shock forces and the channels of `channels_of`.

    Args:
        car: True car.
        drive: Roads [m] and loads by name at 1250 Hz.
        setups: Shocks at the corners, for each record.
    """
    motions = simulate(car, [Run(drive, tuple(shocks)) for shocks in setups])
    return tuple(_record(car, drive, motion) for motion in motions)


def _record(car: AnyCar, drive: TimeSeries, motion: Motion) -> TimeSeries:
    forces = zip(car.named("force"), motion.shock_force, strict=True)
    rows = {name: (drive.unit(name), drive[name]) for name in drive.names}
    rows |= {name: ("N", force) for name, force in forces}
    return TimeSeries.from_channels(motion.time, rows | channels_of(car, motion))


def rms(values: Array, rate: float = RATE) -> float:
    """Return the standard deviation of a signal (N,) after the settling time."""
    return float(values[round(SETTLING * rate) :].std())


def measures_of(channels: Mapping[str, Array], rate: float = RATE) -> dict[str, float]:
    """Return the RMS about the mean of each channel, and of the sum of the tire forces of four corners."""
    found = {name: rms(values, rate) for name, values in channels.items()}
    tires = [values for name, values in channels.items() if name.endswith(".tire_force")]
    return found | {TOTAL: rms(np.sum(tires, axis=0), rate)} if tires else found


def flat_noise(seed: int, seconds: float, high: float, peak: float) -> Array:
    """Return Gaussian noise (N,) at 1250 Hz with a flat spectrum up to a frequency [Hz] and a peak magnitude."""
    count = round(seconds * RATE) + 1
    lines = np.fft.rfft(np.random.default_rng(seed).standard_normal(count))
    lines[np.fft.rfftfreq(count, 1.0 / RATE) > high] = 0.0
    values = np.fft.irfft(lines, count)
    return np.asarray(values * (peak / np.abs(values).max()))
