"""Body and fluid of a physical damper."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.units import convert

# ---- Compressibility of damper oil with a small amount of free gas --------------------------------------------------

#: Standard atmosphere [Pa], the zero of gauge pressures and the reference pressure of fluid volumes.
ATMOSPHERE = 101_325.0


@dataclass(frozen=True, slots=True)
class Fluid:
    """Oil with entrained gas in a chamber with elastic walls.

    A unit of volume at atmospheric pressure p_0 has at the absolute pressure p the volume

        phi(p) = (1 - a) exp(-(p - p_0) / B) + a ((p_0 - p_v) / (p - p_v))^(1 / n)

    and the chamber expands by exp((p - p_0) / B_w), so that the effective bulk modulus is

        1 / B_e = 1 / B_w + [liquid / B + gas / (n (p - p_v))] / phi

    with the two terms of phi as liquid and gas. Gholizadeh, Burton & Schoenau, Fluid bulk modulus: a literature survey,
    Int. J. Fluid Power 12(3), 2011, review this family of models; here the bubbles contain vapour in addition to gas.

    At low pressure the gas makes the fluid soft; at high pressure the oil and the wall limit the stiffness. The
    pressure of a bubble is the sum of the pressures of its gas and of the oil's vapour, so p stays above p_v even if a
    chamber cavitates. Gas neither dissolves nor comes out of solution.
    """

    #: Density [kg/m3]; 820 to 880 for damper oils (Dixon, The Shock Absorber Handbook, 2007, ch. 5).
    density: float = 850.0
    bulk_modulus: float = 1.4e9  #: Bulk modulus B of the oil without gas [Pa]; 1.2 to 1.8 GPa (Gholizadeh et al. 2011).
    #: Volume share a of free gas at atmospheric pressure [1]; up to several % in open systems (Gholizadeh et al. 2011),
    #: 0.1 to 1 % in a bled damper with a floating piston.
    gas_fraction: float = 0.0033
    gas_exponent: float = 1.3  #: Polytropic exponent n of the bubbles [1]; 1 for slow and 1.4 for fast motion.
    #: Absolute vapour pressure p_v [Pa]; under 0.1 kPa for the oil itself, up to 30 kPa if dissolved air comes out
    #: first.
    vapour_pressure: float = 3e3
    wall_modulus: float = 0.85e9  #: Modulus B_w of the chamber walls: tube, seals and piston ring [Pa]; 0.3 to 5 GPa.

    @property
    def span(self) -> float:
        """Difference between atmospheric and vapour pressure [Pa]."""
        return ATMOSPHERE - self.vapour_pressure

    def level(self, pressure: float) -> float:
        """Return the level ln((p - p_v) / (p_0 - p_v)) [1] of an absolute pressure [Pa]; it is the integrated state."""
        return math.log((pressure - self.vapour_pressure) / self.span)

    def pressure(self, level: float) -> float:
        """Return the absolute pressure [Pa] of a level [1]."""
        return self.vapour_pressure + self.span * math.exp(level)

    def expansion(self, pressure: float) -> float:
        """Return the relative volume phi [1] at an absolute pressure [Pa]."""
        liquid = (1.0 - self.gas_fraction) * math.exp((ATMOSPHERE - pressure) / self.bulk_modulus)
        return liquid + self.free_gas(pressure)

    def free_gas(self, pressure: float) -> float:
        """Return the free gas and vapour at an absolute pressure [Pa] per unit of fluid at atmospheric pressure [1]."""
        return self.gas_fraction * math.exp(-self.level(pressure) / self.gas_exponent)

    def content(self, pressure: float) -> float:
        """Return the fluid volume at atmospheric pressure that is in a unit of rigid chamber volume [1]."""
        return math.exp((pressure - ATMOSPHERE) / self.wall_modulus) / self.expansion(pressure)


# ---- Cylinder, rod, gas chamber and seals ---------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Bore, rod, and the two chambers at mid-travel."""

    bore: float = convert(1.75, "in", "m")  #: Bore [m]; 36 to 46 mm for race monotubes.
    #: Rod diameter [m]; 1/2 to 5/8 in. 5/8 in and 150 psi give a static gas force of 46 lbf, a typical value.
    rod: float = convert(0.625, "in", "m")
    #: Length of the compression chamber (main piston to head valve) at displacement 0 [m].
    compression_length: float = convert(5.5, "in", "m")
    rebound_length: float = convert(3.7, "in", "m")  #: Length of the rebound chamber at displacement 0 [m].

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
    """Nitrogen behind a massless floating piston: p V^n = const."""

    pressure: float  #: Gauge pressure at displacement 0 [Pa].
    volume: float = convert(4.8, "in^3", "m^3")  #: Volume at displacement 0 [m3].
    exponent: float = 1.25  #: Polytropic exponent n [1]; 1 for very slow and 1.4 for very fast motion.

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
    """

    drag: float = convert(4.5, "lbf", "N")  #: Sliding friction F_c [N]; 3 to 5 lbf (3.4.3).
    length: float = 5e-5  #: Displacement F_c / s over which the friction reverses [m].

    def force(self, displacement: Array) -> Array:
        """Return the friction (N,) [N] for a displacement (N,) [m], starting from zero; exact if turns are sampled."""
        drag, force = self.drag, 0.0
        found = [0.0]
        for step in np.diff(displacement).tolist():
            end = math.copysign(drag, step)
            force = end + (force - end) * math.exp(-abs(step) / self.length)
            found.append(force)
        return np.array(found)
