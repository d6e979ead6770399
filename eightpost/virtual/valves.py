"""Parts of a physical damper: body, fluid, and valves with restrictions, shims and cavitation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.optimize import brentq

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


# ==== Body and fluid =================================================================================================

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

    def content(self, pressure: float) -> float:
        """Return the fluid volume at atmospheric pressure that is in a unit of rigid chamber volume [1]."""
        liquid = (1.0 - self.gas_fraction) * math.exp((ATMOSPHERE - pressure) / self.bulk_modulus)
        gas = self.gas_fraction * math.exp(-self.level(pressure) / self.gas_exponent)
        return math.exp((pressure - ATMOSPHERE) / self.wall_modulus) / (liquid + gas)


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


# ==== Valves =========================================================================================================

# ---- Flow through an orifice in parallel with a shim stack ----------------------------------------------------------


class Passage(NamedTuple):
    """One flow direction of a valve: an orifice in parallel with a shim stack over its port.

    The flow through the orifice is laminar at small and turbulent at large pressure drops. The edge of the stack opens
    gradually, with opening pressures spread evenly from 0 to 2 s. The gap under it and the port are orifices in series:

        Q = G dp / (dp^2 + dp_t^2)^(1/4) + a L / (1 + (a L / P)^2)^(1/2) dp^(1/2)
        L = dp^2 / (4 s) up to dp = 2 s, then dp - s

    The whole pressure drop lifts the stack, even if part of the drop is in the port.
    """

    orifice: float  #: Conductance G of the orifice [m3/s/Pa^0.5].
    transition: float  #: Pressure drop dp_t of the transition from laminar to turbulent flow [Pa].
    opening: float = 0.0  #: Ratio a of the gap's conductance to L [m3/s/Pa^1.5]; 0 without a stack.
    port: float = 1.0  #: Conductance P of the port [m3/s/Pa^0.5].
    preload: float = 0.0  #: Mean pressure s at which the edge opens [Pa].

    def flow(self, drop: Array) -> Array:
        """Return the flows (N,) [m3/s] at pressure drops (N,) >= 0 [Pa]."""
        lift = drop - self.preload
        if self.preload > 0.0:
            lift = np.where(2.0 * self.preload <= drop, lift, 0.25 * drop * drop / self.preload)
        gap = self.opening * lift
        small = self.orifice * drop / np.sqrt(np.sqrt(drop * drop + self.transition * self.transition))
        return np.asarray(small + gap * np.sqrt(drop / (1.0 + (gap / self.port) ** 2)))


class Valve(NamedTuple):
    """Passages of a valve between two chambers, one for each flow direction."""

    forward: Passage
    backward: Passage

    def drop(self, flow: float) -> float:
        """Return the signed pressure drop [Pa] at a signed flow [m3/s]."""
        passage, reach = self.forward if flow >= 0.0 else self.backward, 1e5
        while passage.flow(np.asarray(reach)) < abs(flow):
            reach *= 2.0
        found = brentq(lambda drop: float(passage.flow(np.asarray(drop))) - abs(flow), 0.0, reach, xtol=1e-6)
        return math.copysign(float(found), flow)


# ---- Shim stacks, by their codes in Table 7.2 -----------------------------------------------------------------------

#: Table 7.2: thicknesses of the four shims of each code [in].
SHIM_SETS = {
    "AA": (0.004, 0.004, 0.004, 0.004),
    "AA+": (0.004, 0.004, 0.006, 0.006),
    "A-": (0.006, 0.006, 0.004, 0.004),
    "A": (0.006, 0.006, 0.006, 0.006),
    "A+": (0.006, 0.006, 0.008, 0.008),
    "B-": (0.008, 0.008, 0.006, 0.006),
    "B": (0.008, 0.008, 0.008, 0.008),
    "B+": (0.008, 0.008, 0.010, 0.010),
    "C-": (0.010, 0.010, 0.008, 0.008),
    "C": (0.010, 0.010, 0.010, 0.010),
    "C+": (0.010, 0.010, 0.012, 0.012),
    "D-": (0.012, 0.012, 0.010, 0.010),
    "D": (0.012, 0.012, 0.012, 0.012),
    "D+": (0.012, 0.012, 0.015, 0.015),
    "E-": (0.015, 0.015, 0.012, 0.012),
    "E": (0.015, 0.015, 0.015, 0.015),
    "E+": (0.015, 0.015, 0.020, 0.020),
    "F-": (0.020, 0.020, 0.015, 0.015),
    "F": (0.020, 0.020, 0.020, 0.020),
}

#: E / (1 - nu^2) of spring steel [Pa].
PLATE_MODULUS = 206e9 / (1.0 - 0.29**2)


@dataclass(frozen=True, slots=True)
class ShimStack:
    """A stack of four shims over a ring of ports.

    The shims slide on each other, so their plate stiffnesses D = E t^3 / (12 (1 - nu^2)) add up (Farjoud, Ahmadian,
    Craft & Burke, Nonlinear modeling and experimental characterization of hydraulic dampers: effects of shim stack
    and orifice parameters on damper performance, Nonlinear Dynamics 67, 2012). The lift of the edge is

        h = K dp r^4 / D_stack

    Raises:
        ParameterError: The code does not exist.
    """

    code: str  #: Code in Table 7.2.
    radius: float = convert(0.65, "in", "m")  #: Radius r of the largest shim [m].
    #: Coefficient K of a plate clamped inside, free outside and uniformly loaded [1]: 0.018, 0.0035, 0.001 for a clamp
    #: of 0.4, 0.6, 0.7 of the radius (thin-plate theory, tabulated in Roark's Formulas for Stress and Strain).
    deflection: float = 0.00254
    #: Thickness of the washer behind every stack, which bends with the stack [m].
    backing: float = convert(0.0045, "in", "m")

    def __post_init__(self) -> None:
        if self.code not in SHIM_SETS:
            raise ParameterError(f"there is no shim stack {self.code!r} in Table 7.2; codes: {', '.join(SHIM_SETS)}")

    @property
    def stiffness(self) -> float:
        """Stiffness D_stack, the sum of E t^3 / (12 (1 - nu^2)) over shims and backing [N.m]."""
        cubes = sum(convert(thickness, "in", "m") ** 3 for thickness in SHIM_SETS[self.code])
        return PLATE_MODULUS * (cubes + self.backing**3) / 12.0

    @property
    def lift(self) -> float:
        """Lift per pressure drop h / dp [m/Pa]."""
        return self.deflection * self.radius**4 / self.stiffness


# ---- Passages of areas and stacks -----------------------------------------------------------------------------------

#: Density of the oil [kg/m3]; 820 to 880 for damper oils (Dixon, The Shock Absorber Handbook, 2007, ch. 5).
DENSITY = 850.0

#: Discharge coefficient C_d of all orifices [1]; 0.6 to 0.8 (Dixon, ch. 5).
DISCHARGE = 0.7

#: Pressure drop of the transition from laminar to turbulent flow [Pa]; Reynolds numbers near 1000 in openings of a
#: millimetre give 10 to 100 kPa.
TRANSITION = 20e3


def open_passage(area: float) -> Passage:
    """Return the passage through an orifice of an area [m2]."""
    return Passage(_conductance(area), TRANSITION)


def shim_passage(stack: ShimStack, orifice: float, *, port_area: float, edge: float, dish: float) -> Passage:
    """Return the passage through an orifice in parallel with a shim stack over ports.

    Args:
        stack: Shim stack.
        orifice: Area of the orifice [m2].
        port_area: Total area of the ports under the stack [m2].
        edge: Length of the edge under which the fluid leaves [m].
        dish: Deflection of the clamped shims by the dished face of the piston [m]: 0 on a linear piston; 1 to 4 degrees
            of dish on a digressive piston are 0.1 to 0.6 mm.
    """
    opening, port = _conductance(edge * stack.lift), _conductance(port_area)
    return Passage(_conductance(orifice), TRANSITION, opening, port, dish / stack.lift)


def _conductance(area: float) -> float:
    return DISCHARGE * area * math.sqrt(2.0 / DENSITY)


# ---- Detection of cavitation during a run ---------------------------------------------------------------------------

#: Absolute pressure below which a chamber cavitates [Pa]: dissolved air comes out of the oil.
CAVITATION_PRESSURE = 30e3

#: Minimum share of the time with cavitation for a cavitating run [1].
CAVITATION_SHARE = 0.01


@dataclass(frozen=True, slots=True)
class _Cavitation:
    """Cavitation in a run."""

    share: float  #: Share of samples with a chamber below 30 kPa absolute [1].
    lowest: float  #: Minimum absolute chamber pressure [Pa].

    @property
    def cavitates(self) -> bool:
        """Whether the share is more than 1 %."""
        return self.share > CAVITATION_SHARE


def cavitation(response: TimeSeries) -> _Cavitation:
    """Return the cavitation in a response of `PhysicalDamper.respond`."""
    lower = np.minimum(response["compression_pressure"], response["rebound_pressure"])
    return _Cavitation(float(np.mean(lower < CAVITATION_PRESSURE)), float(lower.min()))
