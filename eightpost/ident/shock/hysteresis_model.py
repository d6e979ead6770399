"""Force model of the law `hysteresis` in the fit: its own parameters, their bounds and coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.force import Dynamics, ForceModel
from eightpost.ident.shock.knots import KnotBasis
from eightpost.ident.shock.lagged_states import States
from eightpost.ident.shock.limits import Limits
from eightpost.shock import Hysteresis, Port, ShockLaw, StaticCurve
from eightpost.shock.curve import KNOTS

#: Bounds of tau [s], and of the stop's yield travel [m] and time constant [s].
TIME_CONSTANT, STOP_YIELD, STOP_TIME = (3e-4, 0.2), (1e-5, 8e-3), (3e-4, 1.0)

#: Lower bound of tau as a share of the sampling interval.
_SHORTEST_SHARE = 0.1

#: Least slope beyond the fitted speeds, as a share of the mean slope of the side: a slow run that ends flat does not
#: show that the force stays there at higher speeds (docs/explanation/shock_law.md).
LEAST_END = 0.2

#: Number of nodes of ln tau over the lagged velocity.
NODES = 3


@dataclass(frozen=True, slots=True)
class LaggedVelocity(Dynamics):
    """F = f0(v) + f1(u) + ks e beside the static curve f = f0 + f1; theta = (slopes of f1, ln tau[, stop]).

    The slopes (25,) of f1 at the knots of the curve are multiplied by the highest speed of the knots [N]. The stop is
    given by its force at its yield travel [N] and the logarithms of yield travel and time constant.
    """

    limits: Limits  #: Bounds for the record; only the sampling interval matters.
    kind: type[ShockLaw]  #: The law's class.
    shortest: float = TIME_CONSTANT[0]  #: Lower bound of tau [s].
    has_stop: bool = False  #: Whether the stop is fitted.

    @classmethod
    def of(cls, kind: type[ShockLaw], limits: Limits, rate: float) -> LaggedVelocity:
        """Return the dynamics without stop for records of a sampling rate [Hz]."""
        return cls(limits, kind, max(TIME_CONSTANT[0], _SHORTEST_SHARE / rate))

    def with_stop(self) -> LaggedVelocity:
        """Return the same dynamics with a stop."""
        return replace(self, has_stop=True)

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the scalar parameters; the slopes of f1 belong to the curve."""
        taus = tuple(f"time_constant[{node}]" for node in range(1, NODES + 1))
        return (*taus, "stop_stiffness", "stop_yield", "stop_time") if self.has_stop else taus

    @property
    def units(self) -> tuple[str, ...]:  # type: ignore[override]
        """SI units of the scalar parameters."""
        return ("s", "s", "s", "N/m", "m", "s") if self.has_stop else ("s", "s", "s")

    def values(self, theta: Array) -> Array:
        """Return the scalar parameters: tau (3,) [s], stop stiffness [N/m], yield travel [m] and time constant [s]."""
        tau = np.exp(theta[KNOTS : KNOTS + NODES])
        if not self.has_stop:
            return np.asarray(tau)
        force, travel, time = theta[-3], np.exp(theta[-2]), np.exp(theta[-1])
        return np.array([*tau, force / travel, travel, time])

    def values_jacobian(self, theta: Array) -> Array:
        """Return dvalues/dtheta."""
        values = self.values(theta)
        found = np.zeros((values.size, theta.size))
        found[:NODES, KNOTS : KNOTS + NODES] = np.diag(values[:NODES])
        if self.has_stop:
            found[-3, -3:-1] = 1.0 / values[-2], -values[-3]
            found[-2, -2], found[-1, -1] = values[-2], values[-1]
        return found

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of the scalar parameters."""
        taus = ((self.shortest, TIME_CONSTANT[1]),) * NODES
        return (*taus, (0.0, np.inf), STOP_YIELD, STOP_TIME) if self.has_stop else taus

    def state_bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters of the states: ln tau (3,), then those of the stop (2,)."""
        pairs = [(self.shortest, TIME_CONSTANT[1])] * NODES + [STOP_YIELD, STOP_TIME] * self.has_stop
        low, high = np.log(np.array(pairs)).T
        return low, high

    def states(self, theta: Array) -> Array:
        """Return the parameters of the states in theta: ln tau (3,), then ln of yield travel and time constant."""
        return np.concatenate([theta[KNOTS : KNOTS + NODES], theta[-2:] if self.has_stop else []])

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = f0(v) + f1(u) + ks e."""
        slopes, stop = self.forces(theta)
        states = States(model.runs, knots_of(model), self.states(theta))
        return model.static(b - slopes) + states.columns() @ np.append(slopes, stop)

    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F at the rows."""
        return model.runs.rows(self.force(model, b, theta))

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives of F at the rows by the curve (R, 25) and by theta (R, k)."""
        states, static = States(model.runs, knots_of(model), self.states(theta)), model.curve_rows()
        columns = model.runs.rows(states.columns().T).T
        by_states = model.runs.rows(states.derivatives(*self.forces(theta)).T).T
        own = (columns[:, :KNOTS] - static, by_states[:, :NODES], columns[:, KNOTS:], by_states[:, NODES:])
        return static, np.hstack(own)

    def forces(self, theta: Array) -> tuple[Array, Array]:
        """Return the parameters in theta that the force is linear in: slopes of f1 (25,) and stop (0,) or (1,) [N]."""
        return theta[:KNOTS], theta[-3:-2] if self.has_stop else np.empty(0)

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the law with its curve and port."""
        speed = max(-curve.knot_velocity[0], curve.knot_velocity[-1])
        values = self.values(theta).tolist()
        # Where f0 has no slope, rounding must not make that of f1 the larger one.
        slopes = np.minimum(np.maximum(theta[:KNOTS], 0.0) / speed, curve.knot_slope)
        stop = values[NODES:] if self.has_stop else []
        low, middle, high = values[:NODES]
        return Hysteresis(_rising_beyond(curve), tuple(slopes.tolist()), (low, middle, high), *stop, port=port)


def _rising_beyond(curve: StaticCurve) -> StaticCurve:
    """Return a curve that rises beyond each end by a share of the mean slope of the side or more."""
    compression, rebound = (
        max(slope, LEAST_END * force / velocity)
        for slope, force, velocity in (
            (curve.compression_slope, curve.knot_force[-1], curve.knot_velocity[-1]),
            (curve.rebound_slope, curve.knot_force[0], curve.knot_velocity[0]),
        )
    )
    return replace(curve, compression_slope=compression, rebound_slope=rebound)


def knots_of(model: ForceModel) -> KnotBasis:
    """Return the basis of a model's curve through knots."""
    assert isinstance(model.basis.curve, KnotBasis), "the law hysteresis needs a curve through knots"
    return model.basis.curve
