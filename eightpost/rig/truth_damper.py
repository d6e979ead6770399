"""Damper that generates the demonstration data; its model differs from the laws that are fitted.

The valve gives velocity as a function of force (the laws give force as a function of velocity). It is digressive and
different on its two sides. The fluid stiffens with pressure, so that the lag changes with the force. No law of
`eightpost.shock` contains this model. It is integrated with scipy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from eightpost.array_types import Array
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from collections.abc import Callable


_POUND_PER_INCH_PER_SECOND = convert(1.0, "lbf.s/in", "N.s/m")
_POUND = convert(1.0, "lbf", "N")


@dataclass(frozen=True, slots=True)
class ValveSide:
    """One side of the piston: a bleed orifice in parallel with a blow-off stack.

        bleed:     |F| = R u + Q u^2
        blow-off:  u = (w / c) [ln(1 + exp((|F| - F_open) / w)) - ln(1 + exp(-F_open / w))]

    The two flows are added; u is the flow velocity at the piston.
    """

    bleed_linear: float  #: Laminar resistance R of the bleed [N.s/m].
    bleed_square: float  #: Turbulent resistance Q of the bleed [N.s2/m2].
    opening_force: float  #: Force F_open at which the stack opens [N].
    opening_width: float  #: Force range w over which the stack opens [N].
    open_damping: float  #: Slope c of the open stack [N.s/m].

    def flow(self, force: float) -> float:
        """Return the flow velocity [m/s] at a valve force of magnitude `force` [N]."""
        root = math.sqrt(self.bleed_linear**2 + 4.0 * self.bleed_square * force)
        bleed = 2.0 * force / (root + self.bleed_linear)
        rise = _softplus((force - self.opening_force) / self.opening_width)
        rest = _softplus(-self.opening_force / self.opening_width)
        return bleed + self.opening_width / self.open_damping * (rise - rest)


def _softplus(x: float) -> float:
    """Return ln(1 + exp(x)) without overflow."""
    return max(x, 0.0) + math.log1p(math.exp(-abs(x)))


@dataclass(frozen=True, slots=True)
class TruthDamper:
    """A gas-charged damper with a digressive valve behind a stiffening fluid spring (3.1.5).

        dF/dt = k0 (1 + |F| / F1) (v - g(F)),  port force = F + K x + F0 + F_seal tanh(v / v_seal)

    Here v is the velocity, x the displacement and g the flow velocity of the valve, which differs between the sides.
    """

    compression: ValveSide  #: Valve side for positive force.
    rebound: ValveSide  #: Valve side for negative force.
    fluid_stiffness: float  #: Fluid stiffness k0 at zero force [N/m].
    stiffening_force: float  #: Force F1 at which the fluid is twice as stiff [N].
    gas_stiffness: float = convert(4.0, "lbf/in", "N/m")  #: Gas stiffness K [N/m]; about 4 lbf/in at 150 psi (Eq 3.14).
    gas_preload: float = 46.0 * _POUND  #: Gas force F0 at zero displacement [N] (Eq 3.18); that of 150 psi.
    seal_drag: float = 4.0 * _POUND  #: Seal friction F_seal [N]; 3 to 5 lbf (3.4.3).
    seal_velocity: float = convert(0.2, "in/s", "m/s")  #: Transition velocity v_seal of the seal friction [m/s].

    def valve_velocity(self, force: float) -> float:
        """Return the flow velocity g [m/s] at a valve force [N], both signed."""
        if force >= 0.0:
            return self.compression.flow(force)
        return -self.rebound.flow(-force)

    def static_force(self, velocity: float) -> float:
        """Return the valve force [N] at a constant velocity [m/s], which is the inverse of g."""
        reach = 1000.0
        while (self.valve_velocity(math.copysign(reach, velocity)) - velocity) * velocity < 0.0:
            reach *= 2.0
        return float(brentq(lambda force: self.valve_velocity(force) - velocity, -reach, reach))

    def respond(self, motion: TimeSeries, *, rate: float) -> TimeSeries:
        """Integrate the damper for a displacement command.

        The command is interpolated by a cubic spline; the valve starts with its static force.

        Args:
            motion: Evenly sampled series with the channel `displacement` [m].
            rate: Sample rate of the result [Hz].

        Returns:
            Series with displacement [m], velocity [m/s] and the force of the port [N].

        Raises:
            ValueError: The command is not evenly sampled.
        """
        steps = np.diff(motion.time)
        if np.ptp(steps) > 1e-6 * steps[0]:
            raise ValueError("the displacement must be evenly sampled; resample it first")
        spline = CubicSpline(motion.time, motion["displacement"])
        speed = spline.derivative()
        start = float(motion.time[0])
        time = start + np.arange(int(motion.duration * rate * (1.0 + 1e-12)) + 1) / rate
        valve = self._integrate(_fast_quadratic(speed.c, start, float(steps.mean())), time)
        displacement, velocity = spline(time), speed(time)
        gas = self.gas_stiffness * displacement + self.gas_preload
        seal = self.seal_drag * np.tanh(velocity / self.seal_velocity)
        return TimeSeries.from_channels(
            time,
            {
                "displacement": ("m", displacement),
                "velocity": ("m/s", velocity),
                "force": ("N", valve + gas + seal),
            },
        )

    def _integrate(self, velocity: Callable[[float], float], time: Array) -> Array:
        """Return the valve force (N,) [N] at `time` (N,) [s] for a velocity [m/s] as a function of time."""

        def rate_of_force(t: float, state: Array) -> list[float]:
            force = float(state[0])
            stiffness = self.fluid_stiffness * (1.0 + abs(force) / self.stiffening_force)
            return [stiffness * (velocity(t) - self.valve_velocity(force))]

        solution = solve_ivp(
            rate_of_force,
            (float(time[0]), float(time[-1])),
            [self.static_force(velocity(float(time[0])))],
            method="LSODA",
            t_eval=time,
            rtol=1e-6,
            atol=1e-2,
            max_step=5e-3,
        )
        if not solution.success:
            raise RuntimeError(f"the integration of the demonstration damper failed: {solution.message}")
        return np.asarray(solution.y[0], dtype=np.float64)


def _fast_quadratic(coefficients: Array, start: float, step: float) -> Callable[[float], float]:
    """Return a piecewise quadratic (3, K) on an even grid as a function of one time, faster than scipy's."""
    pieces = [tuple(piece) for piece in coefficients.T.tolist()]
    last = len(pieces) - 1

    def value(t: float) -> float:
        place = min(max(int((t - start) / step), 0), last)
        a, b, c = pieces[place]
        s = t - start - place * step
        return float((a * s + b) * s + c)

    return value


def _side(bleed: float, square: float, opening: float, damping: float) -> ValveSide:
    """Return a valve side for values in lbf/(in/s), lbf/(in/s)^2, lbf and lbf/(in/s)."""
    c = _POUND_PER_INCH_PER_SECOND
    width = 0.15 * opening * _POUND
    return ValveSide(bleed * c, square * c / 0.0254, opening * _POUND, width, damping * c)


def demo_damper(build: str) -> TruthDamper:
    """Return the damper of a demonstration build.

    Args:
        build: Name of the build: `A` (baseline, about 20 lbf/(in/s) on average), `B` (stiffer, about 28, more damping
            in rebound) or `C` (softer, about 10, more damping in compression and nearly linear).

    Raises:
        ValueError: The build does not exist.
    """
    if build not in _BUILDS:
        raise ValueError(f"no demonstration build {build!r}; there are {', '.join(_BUILDS)}")
    compression, rebound, stiffness, stiffening = _BUILDS[build]
    return TruthDamper(
        compression=_side(*compression),
        rebound=_side(*rebound),
        fluid_stiffness=convert(stiffness, "lbf/in", "N/m"),
        stiffening_force=stiffening * _POUND,
    )


#: Compression and rebound (bleed lbf/(in/s) and lbf/(in/s)^2, opening lbf, open lbf/(in/s)), fluid stiffness
#: [lbf/in], stiffening force [lbf].
_BUILDS = {
    "A": ((26.0, 3.0, 110.0, 13.0), (33.0, 4.0, 160.0, 16.0), 22000.0, 1500.0),
    "B": ((32.0, 5.0, 130.0, 15.0), (44.0, 7.0, 260.0, 24.0), 30000.0, 2000.0),
    "C": ((14.0, 1.0, 90.0, 9.0), (9.0, 0.3, 70.0, 6.5), 11000.0, 1200.0),
}
