"""Drives of the rig, motions of a true car, and the channels that its sensors record."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import savemat
from scipy.ndimage import shift

from benchmarks.cars.car import CORNERS, GRAVITY, SIZE, Car, TrueShock, march, marched
from eightpost.array_types import Array, Complex
from eightpost.signals import TimeSeries

#: Sample rate of records [Hz], steps of the march per sample, and time before the record in which the drive grows [s].
RATE, STEPS, LEAD = 1000.0, 5, 4.0

#: Spectrum of the roads: lowest and highest frequency [Hz], exponent of the amplitude; the same of the aeroloads.
ROAD, AERO = (0.3, 28.0, 0.75), (0.2, 6.0, 0.5)


@dataclass(frozen=True, slots=True, eq=False)
class Drive:
    """Roads (4) and aeroloads (4) as functions of time, by their lines of a Fourier series."""

    lines: Complex  #: Complex amplitudes (8, lines) of the multiples of 1 / duration.
    means: Array  #: Means (8,); those of the roads are zero.
    seconds: float

    def at(self, rate: float) -> Array:
        """Return the drive (8, N) at a rate, exactly."""
        count = round(self.seconds * rate)
        padded = np.zeros((8, count // 2 + 1), dtype=np.complex128)
        padded[:, : self.lines.shape[1]] = self.lines
        return np.asarray(np.fft.irfft(padded, count, axis=1) * count + self.means[:, None])


def noise_lines(generator: np.random.Generator, seconds: float, spectrum: tuple[float, float, float]) -> Array:
    """Return lines of random phases and an RMS of 1."""
    low, high, exponent = spectrum
    f = np.arange(round(seconds * 60.0)) / seconds
    size = np.where((f >= low) & (f <= high), np.maximum(f, 0.8) ** -exponent, 0.0)
    size *= 1.0 / (1.0 + np.exp(np.clip((f - 0.92 * high) / (0.03 * high), -60.0, 60.0)))  # falls off softly
    lines = size * np.exp(2j * np.pi * generator.random(f.size))
    return np.asarray(lines / np.sqrt(2.0 * np.sum(np.abs(lines) ** 2)))


def random_drive(car: Car, seconds: float, seed: int, road: float = 0.0045, load: float = 400.0) -> Drive:
    """Return the random drive of a rig test: independent roads and aeroloads of a given RMS [m, N]."""
    generator = np.random.default_rng([41, seed])
    lines = [road * noise_lines(generator, seconds, ROAD) for _ in range(4)]
    lines += [load * noise_lines(generator, seconds, AERO) for _ in range(4)]
    return Drive(np.array(lines), np.concatenate([np.zeros(4), np.repeat(car.downforce, 2)]), seconds)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Motion of a car without errors of sensors, at `RATE`."""

    channels: dict[str, Array]  #: Channels of the rig in SI.

    def settled(self, name: str, seconds: float) -> Array:
        """Return a channel without the time at its start."""
        return self.channels[name][round(seconds * RATE) :]


def run(car: Car, shocks: Sequence[TrueShock], drive: Drive, *, steps: int = STEPS) -> Motion:
    """March a car through a drive, after a lead-in in which it grows from zero.

    Args:
        car: Car.
        shocks: Shocks of the corners.
        drive: Drive, which is periodic: the lead-in is its end.
        steps: Steps per sample.
    """
    rate = RATE * steps
    values, lead = drive.at(rate), round(LEAD * rate)
    whole = np.concatenate([values.take(range(-lead, 0), axis=1, mode="wrap"), values], axis=1)
    whole[:, :lead] *= 0.5 - 0.5 * np.cos(np.pi * np.arange(lead) / lead)
    found = march(car.numbers(), marched(tuple(shocks), 1.0 / rate), whole, 1.0 / rate, steps)
    kept = found[:, round(LEAD * RATE) :]
    four = {n: kept[4 * k : 4 * k + 4] for k, n in enumerate(("tire", "force", "x", "v", "x_whole", "v_whole", "hub"))}
    acceleration, q = kept[28 : 28 + SIZE], kept[28 + SIZE :]
    input_ = values[:, ::steps]
    span = "" if car.sensors.pot == "shock" else "_whole"
    rows = {
        "road": input_[:4],
        "aero": input_[4:],
        "tire_force": four["tire"] + car.static_loads[:, None],
        "force": four["force"],
        "displacement": four[f"x{span}"],
        "velocity": four[f"v{span}"],
        "hub_acceleration": four["hub"],
        "chassis_acceleration": car.points(0.85) @ acceleration,
    }
    channels = {f"{c}.{name}": values[k] for name, values in rows.items() for k, c in enumerate(CORNERS)}
    body = np.array([car.height(x, 0.0) for x in (car.axles[0], -car.axles[1])]) @ q  # at the axles
    heights = body - input_[:4].reshape(2, 2, -1).mean(axis=1)
    return Motion(channels | {"front.ride_height": heights[0], "rear.ride_height": heights[1]})


def recorded(car: Car, motion: Motion, seed: int) -> dict[str, Array]:
    """Return the channels as the sensors record them, in SI: late, with errors of gain, with noise; no velocities."""
    sensors, generator = car.sensors, np.random.default_rng([42, seed])
    gains = np.random.default_rng([43, sensors.seed])
    found = {}
    for name, values in motion.channels.items():
        quantity = name.rpartition(".")[2]
        gain = 1.0 + sensors.gain * gains.uniform(-1.0, 1.0)
        if quantity == "velocity":
            continue
        late = RATE * sensors.delays.get(quantity, 0.0)
        own = shift(values, late, order=3, mode="nearest") if late else values
        found[name] = gain * own + sensors.noise * own.std() * generator.standard_normal(own.size)
    return found


LBF = 4.4482216152605

#: Name, unit and SI value of that unit by quantity, for a metric team, with its signs, and for a US team; the names
#: contain the team's own name of the corner.
_COLUMNS = {
    "road": (("WL {} Pos", "mm", 1e-3), ("Pan{} Z", "in", 0.0254)),
    "tire_force": (("WL {} Load", "kN", 1e3), ("Pan{} Fz", "lbf", LBF)),
    "aero": (("AL {} Load", "kN", 1e3), ("Aero{} Fz", "lbf", LBF)),
    "force": (("Damper {} Load", "N", -1.0), ("Shk{} F", "lbf", LBF)),
    "displacement": (("Damper {} Pot", "mm", -1e-3), ("Shk{} X", "in", 0.0254)),
    "hub_acceleration": (("Hub {}", "g", GRAVITY), ("Upright{} Az", "g", GRAVITY)),
    "chassis_acceleration": (("Body {}", "g", GRAVITY), ("Chassis{} Az", "g", GRAVITY)),
    "ride_height": (("RH {}", "mm", 1e-3), ("Ride {}", "in", 0.0254)),
}
_PLACES = {"lf": "FL", "rf": "FR", "lr": "RL", "rr": "RR", "front": "F", "rear": "R"}


def column_of(car: Car, name: str) -> tuple[str, str, float]:
    """Return the team's own name of a channel, its unit, and the SI value of the unit with the team's sign."""
    place, _, quantity = name.rpartition(".")
    text, unit, value = _COLUMNS[quantity][car.sensors.units == "us"]
    return text.format(_PLACES[place]), unit, value


def write_record(car: Car, channels: dict[str, Array], stem: Path) -> Path:
    """Write channels in the team's own names and units: .mat (metric), or .csv with the unit in the header (us)."""
    count = len(next(iter(channels.values())))
    columns, units = {"Time": np.arange(count) / RATE}, {"Time": "s"}
    for name, values in channels.items():
        own, unit, value = column_of(car, name)
        columns[own], units[own] = values / value, unit
    if car.sensors.units == "metric":
        path = stem.with_suffix(".mat")
        savemat(path, {own.replace(" ", "_"): values for own, values in columns.items()})
        return path
    path = stem.with_suffix(".csv")
    header = ",".join(f"{own} ({units[own]})" for own in columns)
    np.savetxt(path, np.column_stack(list(columns.values())), "%.6g", ",", header=header, comments="")
    return path


def write_map(car: Car, channels: dict[str, Array], path: Path) -> Path:
    """Write the channel map of the files of `write_record`."""
    metric = car.sensors.units == "metric"
    lines = ["[time]", 'source = "Time"', 'unit = "s"' if metric else "", ""]
    for name in channels:
        own, unit, value = column_of(car, name)
        lines += [f'[channels."{name}"]', f'source = "{own.replace(" ", "_") if metric else own}"']
        lines += [f'unit = "{unit}"'] if metric else []
        lines += ["gain = -1.0"] if value < 0.0 else []
        lines.append("")
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


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
    names = tuple(f"{c}.{n}" for n in ("road", "aero") for c in CORNERS)
    return TimeSeries(np.arange(values.shape[1]) / rate, values, names, ("m",) * 4 + ("N",) * 4)


def tests_of(car: Car, seconds: float, seed: int) -> Iterator[tuple[str, Motion]]:
    """Yield the name and the motion of five tests: the baseline, then the alternate shock at each corner."""
    drive = random_drive(car, seconds, seed)
    for number in range(5):
        shocks = [car.bank[car.baseline]] * 4
        if number:
            shocks[number - 1] = car.alternate
        name = "baseline" if not number else f"alternate_{CORNERS[number - 1]}"
        yield name, run(car, shocks, drive)


def write_tests(car: Car, folder: Path, seconds: float, seed: int) -> list[Path]:
    """Write the records of five tests and map.toml into a folder; return the paths of the records."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, (name, motion) in enumerate(tests_of(car, seconds, seed)):
        channels = recorded(car, motion, 10 * seed + number)
        paths.append(write_record(car, channels, folder / name))
        write_map(car, channels, folder / "map.toml")
    return paths
