"""The physical damper: two compressible chambers, shim valves, a head valve and a gas chamber."""

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

from eightpost.errors import ParameterError, StepError
from eightpost.rig.damper.body import Cylinder, GasChamber, Seals
from eightpost.rig.damper.fluid import Fluid
from eightpost.rig.damper.kernel import Plant, Valve
from eightpost.rig.damper.restriction import Passage
from eightpost.rig.damper.valves import HeadValve, MainPiston, Orifices, ShimValve
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Local error of the integration in levels and gas volume [1]: a millionth of a chamber's pressure.
TOLERANCE = 1e-6

#: Longest step of the integration [s]: nothing of a 30 Hz drive is stepped over.
LONGEST_STEP = 5e-3


@dataclass(frozen=True)
class PhysicalDamper:
    """A monotube race shock in the manner of a Penske 7300, from the dissertation's 3.1 without its linearisations.

    The equations are those of `Plant`; the port's force is

        F = p_c A_c - p_r A_r - p_atm A_rod + seal drag        positive in compression

    Displacement is counted from mid-travel, the 3 in offset of 3.2.1. It has no temperature effects on the fluid, no
    gas going into solution, no inertia of shims and fluid, no bushings, and no end stops.

    Attributes:
        piston: The main piston's valves.
        head: The head valve.
        gas: The gas chamber.
        cylinder: Bore, rod, chambers.
        fluid: Oil, free gas and wall.
        orifices: What all openings share.
        seals: Dry friction.
        heat_capacity: Of shock and oil [J/K], for the body temperature that the dynamometer reads: 1.5 kg at about
            900 J/kg/K. All work warms it, nothing cools it.
    """

    piston: MainPiston
    head: HeadValve
    gas: GasChamber
    cylinder: Cylinder = field(default_factory=Cylinder)
    fluid: Fluid = field(default_factory=Fluid)
    orifices: Orifices = field(default_factory=Orifices)
    seals: Seals = field(default_factory=Seals)
    heat_capacity: float = 1350.0

    @cached_property
    def plant(self) -> Plant:
        """The equations with this damper's numbers."""
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

        The gas is at its charge and the fluid incompressible, as in 3.1.2; no pressure falls under the vapour's.
        """
        vapour, rod = self.fluid.vapour_pressure, self.cylinder.rod_area
        compression = max(self.gas.charge + _drop(self.plant.head, rod * velocity), vapour)
        rebound = compression - _drop(self.plant.main, self.cylinder.rebound_area * velocity)
        return compression, max(rebound, vapour)

    def static_force(self, velocity: float) -> float:
        """Return the valves' force [N] at a constant velocity [m/s]: without gas force and seal drag."""
        gas = self.plant.force(self.gas.charge, self.gas.charge)
        return self.plant.force(*self.steady_pressures(velocity)) - gas

    def nominal_damping(self, *, reach: float = convert(10.0, "in/s", "m/s")) -> float:
        """Return the least-squares slope through the origin of the static force over -reach to reach [N.s/m].

        Args:
            reach: [m/s]; 10 in/s by default.
        """
        speeds = np.linspace(-reach, reach, 81)
        forces = np.array([self.static_force(speed) for speed in speeds.tolist()])
        return float(speeds @ forces / (speeds @ speeds))

    def respond(self, motion: TimeSeries, *, rate: float, tolerance: float = TOLERANCE) -> TimeSeries:
        """Integrate the damper along a displacement command.

        The command is read as a cubic spline through its samples. The shock rested long enough at the first
        displacement for its pressures to be equal.

        Args:
            motion: An evenly sampled series with the channel `displacement` [m] from mid-travel.
            rate: Samples of the result per second [Hz].
            tolerance: Local error of the chamber levels and of the gas volume [1].

        Returns:
            displacement [m], velocity [m/s], force [N]; compression_pressure, rebound_pressure, gas_pressure, absolute
            [Pa]; seal_drag [N], part of the force; warming [K] since the start.

        Raises:
            ParameterError: The command is not evenly sampled or leaves the travel.
            StepError: The integration failed.
        """
        spline = self._checked(motion)
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

    def _checked(self, motion: TimeSeries) -> CubicSpline:
        steps = np.diff(motion.time)
        if steps.size < 3 or np.ptp(steps) > 1e-6 * steps[0]:
            raise ParameterError("the displacement must have 4 even samples or more; resample it first")
        displacement = motion["displacement"]
        least, most = self.cylinder.travel
        if displacement.min() < least or displacement.max() > most:
            raise ParameterError(
                f"the displacement goes from {displacement.min():g} to {displacement.max():g} m; the shock's travel is "
                f"{least:g} to {most:g} m from its middle"
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
                raise StepError(f"the physical damper was not integrated: {warning}") from warning
        return np.asarray(states, dtype=np.float64)

    def _rest(self, displacement: float) -> list[float]:
        """Return the states at rest at a displacement [m]: one pressure everywhere, the fluid of displacement 0."""
        plant, gas = self.plant, self.gas
        filled = plant.fluid_in(0.0, gas.charge, gas.charge, gas.volume)

        def surplus(share: float) -> float:
            pressure = gas.at(share * gas.volume)
            return plant.fluid_in(displacement, pressure, pressure, share * gas.volume) - filled

        share = float(brentq(surplus, 0.05, 4.0, xtol=1e-13))
        level = self.fluid.level(gas.at(share * gas.volume))
        return [level, level, share]


def _drop(valve: Valve, flow: float) -> float:
    """Return the drop [Pa] at which a valve has a flow [m3/s]."""
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
