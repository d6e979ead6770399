"""Shocks of the virtual dynamometer and rig: linear, demonstration and physical dampers and fitted laws, by name."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from eightpost import units
from eightpost.errors import InputError, ParameterError
from eightpost.shock.file import read_shock
from eightpost.shock.law import ShockLaw
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert
from eightpost.virtual.damper import PhysicalDamper, configuration, shim_build
from eightpost.virtual.kernel import FLUID, LINEAR, ShockRow, along


@dataclass(frozen=True, slots=True)
class LinearDamper:
    """Linear damper F = c v."""

    damping: float  #: Damping c [N.s/m].

    @property
    def row(self) -> ShockRow:
        """The damper as numbers for the compiled integration."""
        return ShockRow(LINEAR, (self.damping,))


# ---- Demonstration dampers ------------------------------------------------------------------------------------------
# The valve gives velocity as a function of force (the laws give force as a function of velocity). It is digressive and
# different on its two sides. The fluid stiffens with pressure, so that the lag changes with the force. No law of
# `eightpost.shock` contains this model.

_DAMPING = convert(1.0, "lbf.s/in", "N.s/m")
_POUND = convert(1.0, "lbf", "N")


@dataclass(frozen=True, slots=True)
class _ValveSide:
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

    compression: _ValveSide  #: Valve side for positive force.
    rebound: _ValveSide  #: Valve side for negative force.
    fluid_stiffness: float  #: Fluid stiffness k0 at zero force [N/m].
    stiffening_force: float  #: Force F1 at which the fluid is twice as stiff [N].
    gas_stiffness: float = convert(4.0, "lbf/in", "N/m")  #: Gas stiffness K [N/m]; about 4 lbf/in at 150 psi (Eq 3.14).
    gas_preload: float = 46.0 * _POUND  #: Gas force F0 at zero displacement [N] (Eq 3.18); that of 150 psi.
    seal_drag: float = 4.0 * _POUND  #: Seal friction F_seal [N]; 3 to 5 lbf (3.4.3).
    seal_velocity: float = convert(0.2, "in/s", "m/s")  #: Transition velocity v_seal of the seal friction [m/s].

    def valve_velocity(self, force: float) -> float:
        """Return the flow velocity g [m/s] at a valve force [N], both signed."""
        side = self.compression if force >= 0.0 else self.rebound
        return math.copysign(side.flow(abs(force)), force)

    def static_force(self, velocity: float) -> float:
        """Return the valve force [N] at a constant velocity [m/s], which is the inverse of g."""
        reach = 1000.0
        while (self.valve_velocity(math.copysign(reach, velocity)) - velocity) * velocity < 0.0:
            reach *= 2.0
        return float(brentq(lambda force: self.valve_velocity(force) - velocity, -reach, reach))

    @property
    def row(self) -> ShockRow:
        """The damper as numbers for the compiled integration."""
        port = (self.gas_stiffness, self.gas_preload, self.seal_drag, self.seal_velocity)
        sides = (*astuple(self.compression), *astuple(self.rebound))
        return ShockRow(FLUID, (self.fluid_stiffness, self.stiffening_force, *port, *sides))

    def respond(self, motion: TimeSeries, *, rate: float) -> TimeSeries:
        """Integrate the damper for a displacement command.

        The command is interpolated by a cubic spline; the valve starts with its static force.

        Args:
            motion: Evenly sampled series with the channel `displacement` [m].
            rate: Sample rate of the result [Hz].

        Returns:
            Series with displacement [m], velocity [m/s] and the force of the port [N].

        Raises:
            ParameterError: The command is not evenly sampled.
        """
        time, displacement, velocity, states = along(
            self.row, motion, rate, lambda _, speed: (self.static_force(speed),)
        )
        gas = self.gas_stiffness * displacement + self.gas_preload
        seal = self.seal_drag * np.tanh(velocity / self.seal_velocity)
        force = states[:, 0] + gas + seal
        channels = {"displacement": ("m", displacement), "velocity": ("m/s", velocity), "force": ("N", force)}
        return TimeSeries.from_channels(time, channels)


#: Compression and rebound (bleed lbf/(in/s) and lbf/(in/s)^2, opening lbf, open lbf/(in/s)), fluid stiffness
#: [lbf/in], stiffening force [lbf].
_BUILDS = {
    "A": ((26.0, 3.0, 110.0, 13.0), (33.0, 4.0, 160.0, 16.0), 22000.0, 1500.0),
    "B": ((32.0, 5.0, 130.0, 15.0), (44.0, 7.0, 260.0, 24.0), 30000.0, 2000.0),
    "C": ((14.0, 1.0, 90.0, 9.0), (9.0, 0.3, 70.0, 6.5), 11000.0, 1200.0),
}


def demo_damper(build: str) -> TruthDamper:
    """Return the damper of a demonstration build.

    Args:
        build: Name of the build: `A` (baseline, about 20 lbf/(in/s) on average), `B` (stiffer, about 28, more damping
            in rebound) or `C` (softer, about 10, more damping in compression and nearly linear).

    Raises:
        ParameterError: The build does not exist.
    """
    if build not in _BUILDS:
        raise ParameterError(f"no demonstration build {build!r}; there are {', '.join(_BUILDS)}")
    *sides, stiffness, stiffening = _BUILDS[build]
    compression, rebound = (
        _ValveSide(bleed * _DAMPING, square * _DAMPING / 0.0254, opening * _POUND, 0.15 * opening * _POUND,
                  damping * _DAMPING)
        for bleed, square, opening, damping in sides
    )  # fmt: skip
    return TruthDamper(compression, rebound, convert(stiffness, "lbf/in", "N/m"), stiffening * _POUND)


# ---- Shocks by name -------------------------------------------------------------------------------------------------

Shock = LinearDamper | ShockLaw | TruthDamper | PhysicalDamper


def shocks_named(names: Iterable[str]) -> dict[str, Shock]:
    """Return each different shock by its name: 'demo:A', 'configuration:1', 'build:C/B', a damping, or a shock.json.

    Raises:
        InputError: A name does not exist.
    """
    return {name: _shock(name) for name in dict.fromkeys(names)}


def _shock(name: str) -> Shock:
    kind, _, own_name = name.partition(":")
    try:
        if kind == "demo" and own_name:
            return demo_damper(own_name)
        if kind == "configuration" and own_name:
            return configuration(int(own_name))
        if kind == "build" and own_name:
            return shim_build(own_name)
    except ValueError as error:
        raise InputError(f"--shock {name}: {error}") from error
    if Path(name).suffix == ".json":
        return read_shock(name).law
    return LinearDamper(_damping(name))


def _damping(text: str) -> float:
    try:
        damping = float(units.convert(*units.quantity(text), "N.s/m"))
    except InputError as error:
        forms = "demo:A, configuration:1, build:C/B, a damping such as '20 lbf.s/in', or a shock.json"
        raise InputError(f"--shock {text!r}: {error}; a shock is one of {forms}") from error
    if not damping > 0.0:
        raise ParameterError(f"--shock must be above 0, not {text!r}")
    return damping
