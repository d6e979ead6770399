"""Random drift of a rig and a car from run to run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.rig.post.car import Car


@dataclass(frozen=True, slots=True)
class Drift:
    """Standard deviations of the random changes from run to run.

    Attributes:
        friction: Relative change of all friction forces together [1].
        tire: Relative change of the tires' stiffness, warm or cold [1].
        load_zero: Zero offset of the load cells [N].
        travel_zero: Zero offset of the potentiometers [m].
    """

    friction: float = 0.05
    tire: float = 0.004
    load_zero: float = convert(2.0, "lbf", "N")
    travel_zero: float = convert(0.002, "in", "m")

    def of(self, car: Car, generator: np.random.Generator) -> Car:
        """Return the car with the random changes of one run."""
        friction, tire = 1.0 + np.array([self.friction, self.tire]) * generator.standard_normal(2)
        tires = replace(car.tires, stiffness=car.tires.stiffness * float(tire))
        return replace(car, friction=car.friction.scaled(max(float(friction), 0.0)), tires=tires)

    def zero(self, name: str, generator: np.random.Generator) -> float:
        """Return the zero offset of a measured channel in one run, in its SI unit."""
        spread = {
            "displacement": self.travel_zero,
            "force": self.load_zero,
            "tire_force": self.load_zero,
            "aero": self.load_zero,
        }.get(name.rpartition(".")[2], 0.0)
        return spread * float(generator.standard_normal())


NO_DRIFT = Drift(0.0, 0.0, 0.0, 0.0)
