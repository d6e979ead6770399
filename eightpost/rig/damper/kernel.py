"""The damper's differential equations and their Jacobian, as functions of floats that scipy's LSODA calls."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from eightpost.array_types import Array
from eightpost.rig.damper.valves import ATMOSPHERE, Passage, passage_flow, passage_slope

if TYPE_CHECKING:
    from collections.abc import Callable

    from eightpost.rig.damper.valves import Cylinder, Fluid, GasChamber

    Motion = Callable[[float], tuple[float, float]]


class Valve(NamedTuple):
    """Passages of a valve between two chambers, one for each flow direction."""

    forward: Passage
    backward: Passage

    def flow(self, drop: float) -> float:
        """Return the signed flow [m3/s] at a signed pressure drop [Pa]."""
        return passage_flow(drop, self.forward) if drop >= 0.0 else -passage_flow(-drop, self.backward)

    def slope(self, drop: float) -> float:
        """Return the slope dQ / d(dp) [m3/s/Pa] at a signed pressure drop [Pa]."""
        return passage_slope(drop, self.forward) if drop >= 0.0 else passage_slope(-drop, self.backward)


def _filling(fluid: Fluid) -> Callable[[float], tuple[float, float, float]]:
    """Return a fast function for the fluid in a chamber at a level ln((p - p_v) / (p_0 - p_v)).

    The function returns the absolute pressure p [Pa], the content psi [1], and the softness (p - p_v) / B_e, which is
    d ln(U / V) / d level [1].
    """
    span, vapour, n = fluid.span, fluid.vapour_pressure, fluid.gas_exponent
    share, oil, wall = fluid.gas_fraction, 1.0 / fluid.bulk_modulus, 1.0 / fluid.wall_modulus
    rest, exp = 1.0 - share, math.exp

    def at(level: float) -> tuple[float, float, float]:
        excess = span * exp(level)
        over = excess - span
        liquid = rest * exp(-over * oil)
        gas = share * exp(-level / n)
        phi = liquid + gas
        return vapour + excess, exp(over * wall) / phi, excess * (wall + liquid * oil / phi) + gas / (n * phi)

    return at


def _softening(fluid: Fluid, level: float) -> float:
    """Return the derivative d ln(softness) / d level [1] of the softness in `_filling`."""
    excess = fluid.span * math.exp(level)
    n, oil = fluid.gas_exponent, 1.0 / fluid.bulk_modulus
    liquid = (1.0 - fluid.gas_fraction) * math.exp((fluid.span - excess) * oil)
    gas = fluid.gas_fraction * math.exp(-level / n)
    share, lost = gas / (liquid + gas), excess * oil
    # The share of the gas decreases with the level, and increases because the oil is compressed too.
    fall = share * (1.0 - share) * (lost - 1.0 / n)
    softness = excess / fluid.wall_modulus + (1.0 - share) * lost + share / n
    return (excess / fluid.wall_modulus + (1.0 - share) * lost + fall * (1.0 / n - lost)) / softness


@dataclass(frozen=True, slots=True)
class Plant:
    """Equations of the damper and their parameters.

    The states are the levels of the compression and the rebound chamber and the ratio of the gas volume to its volume
    at rest:

        V_c = A_c (l_c - x), V_r = A_r (l_r + x); U = V psi(p) the fluid in a chamber
        dU_c / dt = -Q_m(p_c - p_r) - Q_h(p_c - p_g),  dU_r / dt = Q_m(p_c - p_r),  dV_g / dt = -Q_h(p_c - p_g)

    Flows are volumes of fluid at atmospheric pressure, so the fluid is conserved exactly: U_c + U_r - V_g is constant.
    The inertia of shims, floating piston and fluid is neglected.
    """

    cylinder: Cylinder
    fluid: Fluid
    gas: GasChamber
    main: Valve
    head: Valve

    def rates(self, motion: Motion) -> Callable[[Array, float], tuple[float, float, float]]:
        """Return the state derivatives as a function of (states (3,), time); `motion` returns position and velocity."""
        forth, back, into, out_of = *self.main, *self.head
        at, flow, gas = _filling(self.fluid), passage_flow, self.gas
        charge, exponent, per_volume = gas.charge, -gas.exponent, 1.0 / gas.volume
        area_c, area_r = self.cylinder.compression_area, self.cylinder.rebound_area
        length_c, length_r = self.cylinder.compression_length, self.cylinder.rebound_length

        def rates(states: Array, t: float) -> tuple[float, float, float]:
            x, v = motion(t)
            level_c, level_r, volume = states.tolist()
            pressure_c, content_c, softness_c = at(level_c)
            pressure_r, content_r, softness_r = at(level_r)
            drop = pressure_c - pressure_r
            through = flow(drop, forth) if drop >= 0.0 else -flow(-drop, back)
            drop = pressure_c - charge * volume**exponent
            out = flow(drop, into) if drop >= 0.0 else -flow(-drop, out_of)
            return (
                (area_c * v - (through + out) / content_c) / (area_c * (length_c - x) * softness_c),
                (through / content_r - area_r * v) / (area_r * (length_r + x) * softness_r),
                -out * per_volume,
            )

        return rates

    def jacobian(self, motion: Motion) -> Callable[[Array, float], tuple[tuple[float, ...], ...]]:
        """Return the Jacobian of the state derivatives, one row each, as a function of (states (3,), time)."""
        at, gas, rates = _filling(self.fluid), self.gas, self.rates(motion)
        vapour = self.fluid.vapour_pressure
        area_c, area_r = self.cylinder.compression_area, self.cylinder.rebound_area
        length_c, length_r = self.cylinder.compression_length, self.cylinder.rebound_length

        def jacobian(states: Array, t: float) -> tuple[tuple[float, ...], ...]:
            x, v = motion(t)
            level_c, level_r, volume = states.tolist()
            rate_c, rate_r, _ = rates(states, t)
            pressure_c, content_c, softness_c = at(level_c)
            pressure_r, content_r, softness_r = at(level_r)
            stiff_c = content_c * area_c * (length_c - x) * softness_c
            stiff_r = content_r * area_r * (length_r + x) * softness_r
            pressure_g = gas.charge * volume**-gas.exponent
            ease, ease_out = self.main.slope(pressure_c - pressure_r), self.head.slope(pressure_c - pressure_g)
            gas_slope = -gas.exponent * pressure_g / volume
            excess_c, excess_r = pressure_c - vapour, pressure_r - vapour
            # The content increases with the level by d ln(content) = softness, so a flow corresponds to less volume.
            flow_c, flow_r = area_c * v - rate_c * stiff_c / content_c, rate_r * stiff_r / content_r + area_r * v
            own_c = flow_c * content_c * softness_c - (ease + ease_out) * excess_c
            own_r = -flow_r * content_r * softness_r - ease * excess_r
            return (
                (
                    own_c / stiff_c - rate_c * _softening(self.fluid, level_c),
                    ease * excess_r / stiff_c,
                    ease_out * gas_slope / stiff_c,
                ),
                (ease * excess_c / stiff_r, own_r / stiff_r - rate_r * _softening(self.fluid, level_r), 0.0),
                (-ease_out * excess_c / gas.volume, 0.0, ease_out * gas_slope / gas.volume),
            )

        return jacobian

    def fluid_in(self, displacement: float, pressure_c: float, pressure_r: float, gas_volume: float) -> float:
        """Return U_c + U_r - V_g [m3], which is conserved."""
        cylinder, fluid = self.cylinder, self.fluid
        chamber_c = cylinder.compression_area * (cylinder.compression_length - displacement)
        chamber_r = cylinder.rebound_area * (cylinder.rebound_length + displacement)
        return chamber_c * fluid.content(pressure_c) + chamber_r * fluid.content(pressure_r) - gas_volume

    def force(self, pressure_c: float, pressure_r: float) -> float:
        """Return the pressure force on the rod [N], positive in compression (Eq 3.9, relative to the atmosphere)."""
        cylinder = self.cylinder
        fluid_force = pressure_c * cylinder.compression_area - pressure_r * cylinder.rebound_area
        return fluid_force - ATMOSPHERE * cylinder.rod_area
