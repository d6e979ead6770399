"""Cylinder, rod, gas chamber and seals."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eightpost.rig.damper.fluid import ATMOSPHERE
from eightpost.units import convert

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Bore, rod, and the two chambers at mid-travel.

    Attributes:
        bore: Bore [m]; 36 to 46 mm for race monotubes.
        rod: Rod diameter [m]; 1/2 to 5/8 in. 5/8 in and 150 psi give a static gas force of 46 lbf, a typical value.
        compression_length: Length of the compression chamber (main piston to head valve) at displacement 0 [m].
        rebound_length: Length of the rebound chamber at displacement 0 [m].
    """

    bore: float = convert(1.75, "in", "m")
    rod: float = convert(0.625, "in", "m")
    compression_length: float = convert(5.5, "in", "m")
    rebound_length: float = convert(3.7, "in", "m")

    @property
    def compression_area(self) -> float:
        """Area A_c of the piston on the compression side [m2]."""
        return 0.25 * math.pi * self.bore**2

    @property
    def rod_area(self) -> float:
        """Area A_rod of the rod [m2]."""
        return 0.25 * math.pi * self.rod**2

    @property
    def rebound_area(self) -> float:
        """Area A_r of the piston on the rod side [m2]."""
        return self.compression_area - self.rod_area

    @property
    def travel(self) -> tuple[float, float]:
        """Minimum and maximum displacement [m], at which a tenth of a chamber is left."""
        return -0.9 * self.rebound_length, 0.9 * self.compression_length


@dataclass(frozen=True, slots=True)
class GasChamber:
    """Nitrogen behind a massless floating piston: p V^n = const.

    Attributes:
        pressure: Gauge pressure at displacement 0 [Pa].
        volume: Volume at displacement 0 [m3].
        exponent: Polytropic exponent n [1]; 1 for very slow and 1.4 for very fast motion.
    """

    pressure: float
    volume: float = convert(4.8, "in^3", "m^3")
    exponent: float = 1.25

    @property
    def charge(self) -> float:
        """Absolute pressure at displacement 0 [Pa]."""
        return self.pressure + ATMOSPHERE

    def at(self, volume: float) -> float:
        """Return the absolute pressure [Pa] at a volume [m3]."""
        return float(self.charge * (self.volume / volume) ** self.exponent)


@dataclass(frozen=True, slots=True)
class Seals:
    """Dry friction of rod seal, bearing, piston ring and floating piston (Dahl's model).

        dF / dx = s (1 - sign(v) F / F_c)

    The force remains while the rod is at rest, as observed in the static test (3.4.3).

    Attributes:
        drag: Sliding friction F_c [N]; 3 to 5 lbf (3.4.3).
        length: Displacement F_c / s over which the friction reverses [m].
    """

    drag: float = convert(4.5, "lbf", "N")
    length: float = 5e-5

    def force(self, displacement: Array) -> Array:
        """Return the friction (N,) [N] for a displacement (N,) [m], starting from zero; exact if turns are sampled."""
        drag, force = self.drag, 0.0
        found = [0.0]
        for step in np.diff(displacement).tolist():
            end = math.copysign(drag, step)
            force = end + (force - end) * math.exp(-abs(step) / self.length)
            found.append(force)
        return np.array(found)
