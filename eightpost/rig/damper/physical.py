"""Physical damper with two compressible chambers, shim valves, a head valve and a gas chamber."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import ODEintWarning, cumulative_trapezoid, odeint
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from eightpost.array_types import Array
from eightpost.errors import ParameterError, StepError
from eightpost.rig.damper.kernel import Plant, Valve
from eightpost.rig.damper.valves import (
    Cylinder,
    Fluid,
    GasChamber,
    HeadValve,
    MainPiston,
    Orifices,
    Passage,
    Seals,
    ShimValve,
)
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Callable


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
