"""Five rig tests of a true car, by good and bad procedures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.cars.car import CORNERS, Car
from benchmarks.cars.rig import Motion, random_drive, recorded, run, write_map, write_record

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Procedure:
    """How the five tests differ from good ones."""

    roads: float = 1.0  #: Factor on the roads.
    #: Factor on the friction at the start and the end of each test.
    friction: tuple[tuple[float, float], ...] = ((1.0, 1.0),) * 5
    fuel: tuple[float, ...] = (0.0,) * 5  #: Additional mass in each test [kg].
    bars: tuple[float, ...] = (1.0,) * 5  #: Factor on the front anti-roll bar in each test.
    most_seconds: float = float("inf")  #: Longest test.


_DROP, _LOW, _SAME = (1.0, 0.6), (0.6, 0.6), (1.0, 1.0)

PROCEDURES = {
    "control": Procedure(),
    "short": Procedure(most_seconds=15.0),
    "tall_roads": Procedure(roads=2.2),
    "flat_roads": Procedure(roads=0.12),
    "friction_drift_within": Procedure(friction=(_DROP,) * 5),
    "friction_low_in_two": Procedure(friction=(_SAME, _LOW, _SAME, _LOW, _SAME)),
    "broken_bar": Procedure(bars=(1.0, 1.0, 1.0, 0.0, 1.0)),
    "fuel": Procedure(fuel=(0.0, 15.0, 30.0, 45.0, 60.0)),
}


def tests_of(car: Car, seconds: float, seed: int, procedure: str = "control") -> Iterator[tuple[str, Motion]]:
    """Yield the name and the motion of five tests: the baseline, then the alternate shock at each corner."""
    how = PROCEDURES[procedure]
    drive = random_drive(car, min(seconds, how.most_seconds), seed).scaled(how.roads)
    for number in range(5):
        shocks = [car.bank[car.baseline]] * 4
        if number:
            shocks[number - 1] = car.alternate
        tested = replace(car, bars=(how.bars[number] * car.bars[0], car.bars[1])).with_fuel(how.fuel[number])
        name = "baseline" if not number else f"alternate_{CORNERS[number - 1]}"
        yield name, run(tested, shocks, drive, friction=how.friction[number])


def write_tests(car: Car, folder: Path, seconds: float, seed: int, procedure: str = "control") -> list[Path]:
    """Write the records of five tests and map.toml into a folder; return the paths of the records."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number, (name, motion) in enumerate(tests_of(car, seconds, seed, procedure)):
        channels = recorded(car, motion, 10 * seed + number)
        paths.append(write_record(car, channels, folder / name))
        write_map(car, channels, folder / "map.toml")
    return paths
