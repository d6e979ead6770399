"""True measures of setups of a car: RMS values of a lap about their means."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.cars.car import CORNERS, Car
from benchmarks.cars.rig import Drive, Motion, run

#: Time at the start of a lap that is not evaluated [s].
SETTLING = 2.0

QUANTITIES = ("tire_force", "hub_acceleration", "velocity", "displacement", "chassis_acceleration")
TOTAL = "total_tire_force"
NAMES = (
    TOTAL,
    "front.ride_height",
    "rear.ride_height",
    *(f"{corner}.{quantity}" for quantity in QUANTITIES for corner in CORNERS),
)

#: Measures that are judged: those of a study's family ride.
RIDE = tuple(n for n in NAMES if not n.endswith(("displacement", "chassis_acceleration")))


def measures(motion: Motion) -> dict[str, float]:
    """Return the RMS value of each measure."""
    total = np.sum([motion.settled(f"{corner}.tire_force", SETTLING) for corner in CORNERS], axis=0)
    return {n: float((total if n == TOTAL else motion.settled(n, SETTLING)).std()) for n in NAMES}


def truth(car: Car, setups: Sequence[Sequence[int]], lap: Drive) -> list[dict[str, float]]:
    """Return the true measures of setups, by the index of each corner's shock in the bank."""
    return [measures(run(car, [car.bank[k] for k in setup], lap)) for setup in setups]
