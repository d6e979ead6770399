"""Damper oil with a little free gas in it: how much it gives way to pressure."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: Standard atmosphere [Pa]: what gauge pressures count from, and what the fluid's volume is told at.
ATMOSPHERE = 101_325.0


@dataclass(frozen=True, slots=True)
class Fluid:
    """Oil, entrained gas and the wall around them.

    A unit of volume at atmospheric pressure p_0 takes at the absolute pressure p

        phi(p) = (1 - a) exp(-(p - p_0) / B) + a ((p_0 - p_v) / (p - p_v))^(1 / n)

    and the wall widens by exp((p - p_0) / B_w), so that the effective bulk modulus is

        1 / B_e = 1 / B_w + [liquid / B + gas / (n (p - p_v))] / phi

    with the two terms of phi as liquid and gas (Gholizadeh, Burton & Schoenau, Fluid bulk modulus: a literature survey,
    Int. J. Fluid Power 12(3), 2011, review this family; here the bubbles hold vapour beside their gas).

    At low pressure the gas makes it soft, at high pressure the oil and the wall bound it. The pressure of a bubble
    is that of its gas and of the oil's vapour: however much a chamber is pulled apart, p stays above p_v. Gas
    neither dissolves nor comes out of solution.

    Attributes:
        density: [kg/m3]; 820 to 880 for damper oils (Dixon, The Shock Absorber Handbook, 2007, ch. 5).
        bulk_modulus: B of the oil without gas [Pa]; 1.2 to 1.8 GPa (Gholizadeh et al. 2011).
        gas_fraction: a, the volume share of free gas at atmospheric pressure [1]; to several % in open systems
            (same), 0.1 to 1 % in a damper that is bled and has a floating piston.
        gas_exponent: n of the bubbles [1]; 1 slow, 1.4 fast.
        vapour_pressure: p_v, absolute [Pa]; under 0.1 kPa for the oil itself, to 30 kPa where dissolved air comes
            out first.
        wall_modulus: B_w, the chambers' own stiffness, of tube, seals and piston ring [Pa]; 0.3 to 5 GPa.
    """

    density: float = 850.0
    bulk_modulus: float = 1.4e9
    gas_fraction: float = 0.0033
    gas_exponent: float = 1.3
    vapour_pressure: float = 3e3
    wall_modulus: float = 0.85e9

    @property
    def span(self) -> float:
        """From vapour pressure to the atmosphere [Pa]."""
        return ATMOSPHERE - self.vapour_pressure

    def level(self, pressure: float) -> float:
        """Return ln((p - p_v) / (p_0 - p_v)) [1] of an absolute pressure [Pa]: what is integrated."""
        return math.log((pressure - self.vapour_pressure) / self.span)

    def pressure(self, level: float) -> float:
        """Return the absolute pressure [Pa] of a level [1]."""
        return self.vapour_pressure + self.span * math.exp(level)

    def expansion(self, pressure: float) -> float:
        """Return phi [1] at an absolute pressure [Pa]."""
        liquid = (1.0 - self.gas_fraction) * math.exp((ATMOSPHERE - pressure) / self.bulk_modulus)
        return liquid + self.free_gas(pressure)

    def free_gas(self, pressure: float) -> float:
        """Return the free gas and vapour at an absolute pressure [Pa] per unit of fluid at atmospheric pressure [1]."""
        return self.gas_fraction * math.exp(-self.level(pressure) / self.gas_exponent)

    def content(self, pressure: float) -> float:
        """Return the fluid (its volume at atmospheric pressure) in a unit of rigid chamber volume [1]."""
        return math.exp((pressure - ATMOSPHERE) / self.wall_modulus) / self.expansion(pressure)

    def effective_modulus(self, pressure: float) -> float:
        """Return B_e [Pa] of fluid and wall at an absolute pressure [Pa]."""
        gas = self.free_gas(pressure)
        phi = self.expansion(pressure)
        oil = (phi - gas) / self.bulk_modulus
        bubbles = gas / (self.gas_exponent * (pressure - self.vapour_pressure))
        return 1.0 / (1.0 / self.wall_modulus + (oil + bubbles) / phi)
