"""Valves of a physical damper: restrictions, shims, cavitation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.errors import ParameterError
from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


# ---- Flow through an orifice in parallel with a shim stack, as pure functions of floats in [Pa] and -----------------


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


def passage_flow(drop: float, passage: Passage) -> float:
    """Return the flow [m3/s] at a pressure drop >= 0 [Pa]."""
    orifice, transition, opening, port, preload = passage
    lift = drop - preload if drop >= 2.0 * preload else 0.25 * drop * drop / preload
    gap = opening * lift
    ratio = gap / port
    small = orifice * drop / math.sqrt(math.sqrt(drop * drop + transition * transition))
    return small + gap * math.sqrt(drop / (1.0 + ratio * ratio))


def passage_slope(drop: float, passage: Passage) -> float:
    """Return the slope dQ / d(dp) [m3/s/Pa] at a pressure drop >= 0 [Pa]."""
    orifice, transition, opening, port, preload = passage
    size = drop * drop + transition * transition
    slope = orifice * (1.0 - 0.5 * drop * drop / size) / math.sqrt(math.sqrt(size))
    if opening == 0.0 or drop == 0.0:
        return slope
    whole = drop >= 2.0 * preload
    lift, growth = (drop - preload, 1.0) if whole else (0.25 * drop * drop / preload, 0.5 * drop / preload)
    series = 1.0 + (opening * lift / port) ** 2
    return slope + opening / math.sqrt(series) * (growth * math.sqrt(drop) / series + 0.5 * lift / math.sqrt(drop))


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


# ---- Parts of the main piston and of the head valve -----------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class ShimValve:
    """A shim stack over ports, for one flow direction."""

    stack: ShimStack  #: Shim stack.
    port_area: float  #: Total area of the ports under the stack [m2].
    edge: float  #: Length of the edge under which the fluid leaves [m].
    #: Deflection of the clamped shims by the dished face of the piston [m]: 0 on a linear piston; 1 to 4 degrees of
    #: dish on a digressive piston are 0.1 to 0.6 mm.
    dish: float = 0.0

    @property
    def preload(self) -> float:
        """Mean pressure at which the edge opens [Pa]."""
        return self.dish / self.stack.lift


@dataclass(frozen=True, slots=True)
class Bleed:
    """Rebound bleed through the rod with an adjuster, open in rebound and closed in compression (3.4.3).

    Clicks are counted from fully open. The dissertation must use the same convention: section 3.4.1 reports that the
    error of builds 1 and 2 increased with a more restrictive bleed setting, and in Table 3.5 it increases from 1 to 14
    clicks.
    """

    clicks: int  #: Clicks of the adjuster from fully open.
    area_per_click: float  #: Area that a click closes [m2].
    most: int = 28  #: Number of clicks from fully open to closed.

    def __post_init__(self) -> None:
        if not 0 <= self.clicks <= self.most:
            raise ParameterError(f"the clicks of the bleed adjuster must be 0 to {self.most}, not {self.clicks}")

    @property
    def area(self) -> float:
        """Open area [m2]."""
        return (self.most - self.clicks) * self.area_per_click


@dataclass(frozen=True, slots=True)
class MainPiston:
    """Valves between the compression and the rebound chamber."""

    compression: ShimValve  #: Valve for flow from the compression chamber to the rebound chamber.
    rebound: ShimValve  #: Valve for flow from the rebound chamber to the compression chamber.
    bleed: Bleed  #: Bleed in parallel with the rebound stack.
    jet_area: float  #: Area of the bleed jet and the leakage past the piston, in both directions [m2].


@dataclass(frozen=True, slots=True)
class HeadValve:
    """Valve between compression chamber and reservoir."""

    compression: ShimValve  #: Valve for flow into the reservoir.
    jet_area: float  #: Area of the jet, which is open in both directions [m2].
    return_area: float  #: Area of the check valve for flow out of the reservoir [m2].


@dataclass(frozen=True, slots=True)
class Orifices:
    """Common properties of all orifices."""

    #: Discharge coefficient C_d [1]; 0.6 to 0.8 (Dixon, The Shock Absorber Handbook, 2007, ch. 5).
    discharge: float = 0.7
    #: Pressure drop of the transition from laminar to turbulent flow [Pa]; Reynolds numbers near 1000 in openings of a
    #: millimetre give 10 to 100 kPa.
    transition: float = 20e3


# ---- Detection of cavitation during a run ---------------------------------------------------------------------------

#: Absolute pressure below which a chamber cavitates [Pa]: dissolved air comes out of the oil.
CAVITATION_PRESSURE = 30e3

#: Minimum share of the time with cavitation for a cavitating run [1].
CAVITATION_SHARE = 0.01


@dataclass(frozen=True, slots=True)
class Cavitation:
    """Cavitation in a run."""

    share: float  #: Share of samples with a chamber below 30 kPa absolute [1].
    lowest: float  #: Minimum absolute chamber pressure [Pa].

    @property
    def cavitates(self) -> bool:
        """Whether the share is more than 1 %."""
        return self.share > CAVITATION_SHARE


def cavitation(response: TimeSeries) -> Cavitation:
    """Return the cavitation in a response of `PhysicalDamper.respond`."""
    lower = np.minimum(response["compression_pressure"], response["rebound_pressure"])
    return Cavitation(float(np.mean(lower < CAVITATION_PRESSURE)), float(lower.min()))
