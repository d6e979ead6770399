"""Physical damper with two compressible chambers, shim valves, a head valve and a gas chamber."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.optimize import brentq

from eightpost.errors import ParameterError
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.virtual.kernel import LONGEST_STEP, PHYSICAL, ShockRow, along
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
    Valve,
)


@dataclass(frozen=True)
class PhysicalDamper:
    """A monotube race shock similar to a Penske 7300, as in section 3.1 of the dissertation without linearisations.

    The states are the levels of the compression and the rebound chamber and the ratio of the gas volume to its volume
    at rest:

        V_c = A_c (l_c - x), V_r = A_r (l_r + x); U = V psi(p) the fluid in a chamber
        dU_c / dt = -Q_m(p_c - p_r) - Q_h(p_c - p_g),  dU_r / dt = Q_m(p_c - p_r),  dV_g / dt = -Q_h(p_c - p_g)

    Flows are volumes of fluid at atmospheric pressure, so the fluid is conserved exactly: U_c + U_r - V_g is constant.
    The force of the port is (Eq 3.9, relative to the atmosphere)

        F = p_c A_c - p_r A_r - p_atm A_rod + seal drag        positive in compression

    Displacement is measured from mid-travel, the 3 in offset of 3.2.1. Temperature effects on the fluid, dissolved gas,
    inertia of shims, floating piston and fluid, bushings, and end stops are not modelled.
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

    # ---- Valves and steady flow -------------------------------------------------------------------------------------

    @cached_property
    def main_valve(self) -> Valve:
        """Flow from the compression to the rebound chamber."""
        piston = self.piston
        return Valve(
            self._passage(piston.compression, piston.jet_area),
            self._passage(piston.rebound, piston.jet_area + piston.bleed.area),
        )

    @cached_property
    def head_valve(self) -> Valve:
        """Flow from the compression chamber to the reservoir."""
        head = self.head
        back = Passage(self._conductance(head.jet_area + head.return_area), self.orifices.transition)
        return Valve(self._passage(head.compression, head.jet_area), back)

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
        vapour = self.fluid.vapour_pressure
        compression = max(self.gas.charge + self.head_valve.drop(self.cylinder.rod_area * velocity), vapour)
        rebound = compression - self.main_valve.drop(self.cylinder.rebound_area * velocity)
        return compression, max(rebound, vapour)

    def static_force(self, velocity: float) -> float:
        """Return the force of the valves [N] at a constant velocity [m/s], without gas force and seal friction."""
        compression, rebound = self.steady_pressures(velocity)
        excess = compression - self.gas.charge, rebound - self.gas.charge
        return excess[0] * self.cylinder.compression_area - excess[1] * self.cylinder.rebound_area

    def nominal_damping(self) -> float:
        """Fit a line through the origin to the static force from -10 to 10 in/s, and return its slope [N.s/m]."""
        reach = convert(10.0, "in/s", "m/s")
        speeds = np.linspace(-reach, reach, 81)
        forces = np.array([self.static_force(speed) for speed in speeds.tolist()])
        return float(speeds @ forces / (speeds @ speeds))

    # ---- Motion -----------------------------------------------------------------------------------------------------

    @cached_property
    def row(self) -> ShockRow:
        """The damper as numbers for the compiled integration, at rest at mid-travel."""
        fluid, cylinder, gas = self.fluid, self.cylinder, self.gas
        flows = [number for valve in (self.main_valve, self.head_valve) for passage in valve for number in passage]
        numbers = (
            fluid.vapour_pressure, fluid.span, fluid.gas_exponent, fluid.gas_fraction,
            1.0 / fluid.bulk_modulus, 1.0 / fluid.wall_modulus,
            cylinder.compression_area, cylinder.rebound_area, cylinder.compression_length, cylinder.rebound_length,
            gas.charge, gas.exponent, 1.0 / gas.volume,
            *flows, -ATMOSPHERE * cylinder.rod_area, self.seals.drag, self.seals.length,
        )  # fmt: skip
        return ShockRow(PHYSICAL, numbers, self._rest(0.0))

    def respond(self, motion: TimeSeries, *, rate: float, longest: float = LONGEST_STEP) -> TimeSeries:
        """Integrate the damper for a displacement command.

        The command is interpolated by a cubic spline. Before the start, the shock was at rest at the first displacement
        until its pressures were equal.

        Args:
            motion: Evenly sampled series with the channel `displacement` [m] from mid-travel.
            rate: Sample rate of the result [Hz].
            longest: Longest step of the integration [s]; see `kernel.along`.

        Returns:
            Series with displacement [m], velocity [m/s], force [N]; the absolute pressures compression_pressure,
            rebound_pressure and gas_pressure [Pa]; seal_drag [N], which is part of the force; and warming [K], the
            temperature rise since the start.

        Raises:
            ParameterError: The command is not evenly sampled or exceeds the travel.
            StepError: The integration failed.
        """
        path, cylinder = motion["displacement"], self.cylinder
        lowest, highest = cylinder.travel
        if path.min() < lowest or path.max() > highest:
            raise ParameterError(
                f"the displacement ranges from {path.min():g} to {path.max():g} m; the shock's travel is {lowest:g} to "
                f"{highest:g} m from mid-travel"
            )
        time, displacement, velocity, states = along(
            self.row, motion, rate, lambda place, _: self._rest(place), longest=longest
        )
        compression, rebound = (self.fluid.vapour_pressure + self.fluid.span * np.exp(states[:, :2])).T
        gas, drag = self.gas.charge * states[:, 2] ** -self.gas.exponent, states[:, 3]
        force = compression * cylinder.compression_area - rebound * cylinder.rebound_area
        force = force - ATMOSPHERE * cylinder.rod_area + drag
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

    def _rest(self, displacement: float) -> tuple[float, ...]:
        """Return the states at rest at a displacement [m], with equal pressures and the conserved fluid volume."""
        cylinder, fluid, gas = self.cylinder, self.fluid, self.gas

        def fluid_in(place: float, pressure: float, volume: float) -> float:
            chambers = cylinder.compression_area * (cylinder.compression_length - place)
            chambers += cylinder.rebound_area * (cylinder.rebound_length + place)
            return chambers * fluid.content(pressure) - volume

        filled = fluid_in(0.0, gas.charge, gas.volume)

        def surplus(share: float) -> float:
            return fluid_in(displacement, gas.at(share * gas.volume), share * gas.volume) - filled

        share = float(brentq(surplus, 0.05, 4.0, xtol=1e-13))
        level = fluid.level(gas.at(share * gas.volume))
        return level, level, share, 0.0, displacement
