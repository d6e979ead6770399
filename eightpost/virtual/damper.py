"""Physical damper with two compressible chambers, shim valves, a head valve and a gas chamber."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.integrate import ODEintWarning, cumulative_trapezoid, odeint
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from eightpost.array_types import Array
from eightpost.errors import ParameterError, StepError
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.virtual.valves import (
    ATMOSPHERE,
    Cylinder,
    Fluid,
    GasChamber,
    HeadValve,
    MainPiston,
    Orifices,
    Passage,
    Seals,
    ShimValve,
    passage_flow,
    passage_slope,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    Motion = Callable[[float], tuple[float, float]]


# ---- Differential equations and their Jacobian, as functions of floats that scipy's LSODA calls ---------------------


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


# ---- The damper -----------------------------------------------------------------------------------------------------

#: Local error tolerance of the integration in levels and gas volume [1]: a millionth of a chamber's pressure.
TOLERANCE = 1e-6

#: Maximum step of the integration [s], short enough for a 30 Hz drive.
LONGEST_STEP = 5e-3


@dataclass(frozen=True)
class PhysicalDamper:
    """A monotube race shock similar to a Penske 7300, as in section 3.1 of the dissertation without linearisations.

    The equations are those of `Plant`; the force of the port is

        F = p_c A_c - p_r A_r - p_atm A_rod + seal drag        positive in compression

    Displacement is measured from mid-travel, the 3 in offset of 3.2.1. Temperature effects on the fluid, dissolved gas,
    inertia of shims and fluid, bushings, and end stops are not modelled.
    """

    piston: MainPiston  #: Valves of the main piston.
    head: HeadValve  #: Head valve.
    gas: GasChamber  #: Gas chamber.
    cylinder: Cylinder = field(default_factory=Cylinder)  #: Bore, rod and chambers.
    fluid: Fluid = field(default_factory=Fluid)  #: Oil, free gas and wall.
    orifices: Orifices = field(default_factory=Orifices)  #: Common properties of all orifices.
    seals: Seals = field(default_factory=Seals)  #: Dry friction of the seals.
    #: Heat capacity of shock and oil [J/K], for the body temperature that the dynamometer reads: 1.5 kg at about 900
    #: J/kg/K. All work heats the body, and there is no cooling.
    heat_capacity: float = 1350.0

    @cached_property
    def plant(self) -> Plant:
        """Equations with the parameters of this damper."""
        piston, head = self.piston, self.head
        main = Valve(
            self._passage(piston.compression, piston.jet_area),
            self._passage(piston.rebound, piston.jet_area + piston.bleed.area),
        )
        back = Passage(self._conductance(head.jet_area + head.return_area), self.orifices.transition)
        return Plant(
            self.cylinder, self.fluid, self.gas, main, Valve(self._passage(head.compression, head.jet_area), back)
        )

    def _conductance(self, area: float) -> float:
        return float(self.orifices.discharge * area * math.sqrt(2.0 / self.fluid.density))

    def _passage(self, valve: ShimValve, orifice_area: float) -> Passage:
        return Passage(
            orifice=self._conductance(orifice_area),
            transition=self.orifices.transition,
            opening=self._conductance(valve.edge * valve.stack.lift),
            port=self._conductance(valve.port_area),
            preload=valve.preload,
        )

    def steady_pressures(self, velocity: float) -> tuple[float, float]:
        """Return the absolute chamber pressures (compression, rebound) [Pa] at a constant velocity [m/s].

        The gas has its charge pressure and the fluid is incompressible, as in 3.1.2; pressures are limited to the
        vapour pressure.
        """
        vapour, rod = self.fluid.vapour_pressure, self.cylinder.rod_area
        compression = max(self.gas.charge + _drop(self.plant.head, rod * velocity), vapour)
        rebound = compression - _drop(self.plant.main, self.cylinder.rebound_area * velocity)
        return compression, max(rebound, vapour)

    def static_force(self, velocity: float) -> float:
        """Return the force of the valves [N] at a constant velocity [m/s], without gas force and seal friction."""
        gas = self.plant.force(self.gas.charge, self.gas.charge)
        return self.plant.force(*self.steady_pressures(velocity)) - gas

    def nominal_damping(self) -> float:
        """Fit a line through the origin to the static force from -10 to 10 in/s, and return its slope [N.s/m]."""
        reach = convert(10.0, "in/s", "m/s")
        speeds = np.linspace(-reach, reach, 81)
        forces = np.array([self.static_force(speed) for speed in speeds.tolist()])
        return float(speeds @ forces / (speeds @ speeds))

    def respond(self, motion: TimeSeries, *, rate: float, tolerance: float = TOLERANCE) -> TimeSeries:
        """Integrate the damper for a displacement command.

        The command is interpolated by a cubic spline. Before the start, the shock was at rest at the first displacement
        until its pressures were equal.

        Args:
            motion: Evenly sampled series with the channel `displacement` [m] from mid-travel.
            rate: Sample rate of the result [Hz].
            tolerance: Local error tolerance of the chamber levels and of the gas volume [1].

        Returns:
            Series with displacement [m], velocity [m/s], force [N]; the absolute pressures compression_pressure,
            rebound_pressure and gas_pressure [Pa]; seal_drag [N], which is part of the force; and warming [K], the
            temperature rise since the start.

        Raises:
            ParameterError: The command is not evenly sampled or exceeds the travel.
            StepError: The integration failed.
        """
        spline = self._spline(motion)
        start = float(motion.time[0])
        time = start + np.arange(int(motion.duration * rate * (1.0 + 1e-12)) + 1) / rate
        path = _motion(spline.c, start, float(np.diff(motion.time).mean()))
        states = self._integrate(path, time, tolerance)
        displacement, velocity = spline(time), spline(time, 1)
        compression, rebound = (self.fluid.vapour_pressure + self.fluid.span * np.exp(states[:, :2])).T
        gas = self.gas.charge * states[:, 2] ** -self.gas.exponent
        drag = self.seals.force(displacement)
        cylinder = self.cylinder
        force = self.plant.force(0.0, 0.0) + compression * cylinder.compression_area - rebound * cylinder.rebound_area
        force = force + drag
        work = cumulative_trapezoid(force * velocity, time, initial=0)
        return TimeSeries.from_channels(
            time,
            {
                "displacement": ("m", displacement),
                "velocity": ("m/s", velocity),
                "force": ("N", force),
                "compression_pressure": ("Pa", compression),
                "rebound_pressure": ("Pa", rebound),
                "gas_pressure": ("Pa", gas),
                "seal_drag": ("N", drag),
                "warming": ("K", work / self.heat_capacity),
            },
        )

    def _spline(self, motion: TimeSeries) -> CubicSpline:
        """Return the spline of a command; raise ParameterError if it is uneven or exceeds the travel."""
        steps = np.diff(motion.time)
        if steps.size < 3 or np.ptp(steps) > 1e-6 * steps[0]:
            raise ParameterError("the displacement must have at least 4 evenly spaced samples; resample it first")
        displacement = motion["displacement"]
        lowest, highest = self.cylinder.travel
        if displacement.min() < lowest or displacement.max() > highest:
            raise ParameterError(
                f"the displacement ranges from {displacement.min():g} to {displacement.max():g} m; the shock's travel "
                f"is {lowest:g} to {highest:g} m from mid-travel"
            )
        return CubicSpline(motion.time, displacement)

    def _integrate(self, path: Callable[[float], tuple[float, float]], time: Array, tolerance: float) -> Array:
        """Return the states (N, 3) at `time` (N,) [s]."""
        with warnings.catch_warnings():
            warnings.simplefilter("error", ODEintWarning)
            try:
                states = odeint(
                    self.plant.rates(path),
                    self._rest(path(float(time[0]))[0]),
                    time,
                    Dfun=self.plant.jacobian(path),
                    rtol=tolerance,
                    atol=tolerance,
                    hmax=LONGEST_STEP,
                    mxstep=20_000,
                )
            except ODEintWarning as warning:
                raise StepError(f"the integration of the physical damper failed: {warning}") from warning
        return np.asarray(states, dtype=np.float64)

    def _rest(self, displacement: float) -> list[float]:
        """Return the states at rest at a displacement [m], with equal pressures and the conserved fluid volume."""
        plant, gas = self.plant, self.gas
        filled = plant.fluid_in(0.0, gas.charge, gas.charge, gas.volume)

        def surplus(share: float) -> float:
            pressure = gas.at(share * gas.volume)
            return plant.fluid_in(displacement, pressure, pressure, share * gas.volume) - filled

        share = float(brentq(surplus, 0.05, 4.0, xtol=1e-13))
        level = self.fluid.level(gas.at(share * gas.volume))
        return [level, level, share]


def _drop(valve: Valve, flow: float) -> float:
    """Return the pressure drop [Pa] of a valve at a flow [m3/s]."""
    reach = 1e5
    while abs(valve.flow(math.copysign(reach, flow))) < abs(flow):
        reach *= 2.0
    return float(brentq(lambda drop: valve.flow(drop) - flow, -reach, reach, xtol=1e-6))


def _motion(coefficients: Array, start: float, step: float) -> Callable[[float], tuple[float, float]]:
    """Return displacement and velocity of a cubic spline (4, K) on an even grid as a function of time."""
    pieces = [tuple(piece) for piece in coefficients.T.tolist()]
    last = len(pieces) - 1

    def at(t: float) -> tuple[float, float]:
        place = min(max(int((t - start) / step), 0), last)
        a, b, c, d = pieces[place]
        s = t - start - place * step
        return ((a * s + b) * s + c) * s + d, (3.0 * a * s + 2.0 * b) * s + c

    return at
