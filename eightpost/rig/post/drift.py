"""What changes from run to run on a rig although nobody changed it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.rig.post.car import Car


@dataclass(frozen=True, slots=True)
class Drift:
    """Standard deviations of what each run draws anew.

    Attributes:
        friction: Of all friction forces together [1].
        tire: Of the tires' stiffness, warm or cold [1].
        load_zero: Of the load cells' zeros [N].
        travel_zero: Of the potentiometers' zeros [m].
    """

    friction: float = 0.05
    tire: float = 0.004
    load_zero: float = convert(2.0, "lbf", "N")
    travel_zero: float = convert(0.002, "in", "m")

    def of(self, car: Car, generator: np.random.Generator) -> Car:
        """Return the car as it is in one run."""
        friction, tire = 1.0 + np.array([self.friction, self.tire]) * generator.standard_normal(2)
        tires = replace(car.tires, stiffness=car.tires.stiffness * float(tire))
        return replace(car, friction=car.friction.scaled(max(float(friction), 0.0)), tires=tires)

    def zero(self, name: str, generator: np.random.Generator) -> float:
        """Return the offset of a measured channel's sensor in one run, in its SI unit."""
        spread = {
            "displacement": self.travel_zero,
            "force": self.load_zero,
            "tire_force": self.load_zero,
            "aero": self.load_zero,
        }.get(name.rpartition(".")[2], 0.0)
        return spread * float(generator.standard_normal())


NO_DRIFT = Drift(0.0, 0.0, 0.0, 0.0)
