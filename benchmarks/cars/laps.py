"""Laps of true cars: drives that differ from those of the tests, and their records."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.cars.car import Car
from benchmarks.cars.rig import RATE, Drive, noise_lines, recorded, run, write_map, write_record
from eightpost.signals import TimeSeries, write_parquet

Array = NDArray[np.float64]

#: Kinds of laps: RMS of the roads [m], spectrum, delay of the rear axle [s], share of the mean aeroload, its RMS [N].
#: own: rougher, with power to 38 Hz, a higher mean load than the tests and large slow loads.
LAPS: dict[str, tuple[float, tuple[float, float, float], float, float, float]] = {
    "track": (0.0032, (0.3, 25.0, 1.0), 0.05, 1.0, 220.0),
    "own": (0.0026, (0.3, 38.0, 0.8), 0.04, 1.4, 420.0),
}


def lap_drive(car: Car, seconds: float, seed: int, kind: str = "track") -> Drive:
    """Return the drive of a lap: the rear axle follows the front one, left and right are partly alike."""
    rms, spectrum, delay, share, load = LAPS[kind]
    generator = np.random.default_rng([44, seed])
    both, left, right = (noise_lines(generator, seconds, spectrum) for _ in range(3))
    f = np.arange(both.size) / seconds
    sides = [0.75 * both + 0.66 * one for one in (left, right)]
    late = np.exp(-2j * np.pi * f * delay)
    roads = [rms * side * turn for turn in (1.0, late) for side in sides]
    speed = noise_lines(generator, seconds, (0.05, 1.0, 0.5))
    gusts = [load * (0.8 * speed + 0.6 * noise_lines(generator, seconds, (0.2, 6.0, 0.5))) for _ in range(4)]
    means = np.concatenate([np.zeros(4), share * np.repeat(car.downforce, 2)])
    return Drive(np.array([*roads, *gusts]), means, seconds)


def lap_series(drive: Drive, rate: float = RATE) -> TimeSeries:
    """Return the drive as inputs of a vehicle, exactly."""
    values = drive.at(rate)
    names = tuple(f"{c}.{n}" for n in ("road", "aero") for c in ("lf", "rf", "lr", "rr"))
    return TimeSeries(np.arange(values.shape[1]) / rate, values, names, ("m",) * 4 + ("N",) * 4)


def write_drive(drive: Drive, path: Path) -> Path:
    """Write the drive as the drive file of a study (.parquet)."""
    write_parquet(lap_series(drive), path, note="SYNTHETIC")
    return path


def write_lap(
    car: Car, folder: Path, shocks: Sequence[int], kind: str = "track", *, seconds: float = 30.0, seed: int = 0
) -> Path:
    """Write the record of a lap with shocks of the bank at the corners, and its map.toml."""
    folder.mkdir(parents=True, exist_ok=True)
    motion = run(car, [car.bank[k] for k in shocks], lap_drive(car, seconds, seed, kind))
    channels = recorded(car, motion, 70000 + seed)
    write_map(car, channels, folder / "map.toml")
    return write_record(car, channels, folder / f"lap_{kind}")
