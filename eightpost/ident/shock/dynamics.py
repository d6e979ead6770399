"""What a law adds to its static curve, as the fit needs it: the force and its derivatives."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.ident.shock.lagging import lag, lag_sensitivity
from eightpost.shock import Lpf1, Lpnl2, Polylinear

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.limits import Limits
    from eightpost.shock import Port, ShockLaw, StaticCurve

    Array = NDArray[np.float64]


class Blend(NamedTuple):
    """The valve force F = alpha F_lag + (1 - alpha) F_s of a record and how it changes."""

    force: Array
    """F (N,) [N]."""
    weight: Array
    """alpha (N,) [1]."""
    slope: Array
    """(N,) (F_lag - F_s) dalpha/dF_s [1]: what a change of F_s does through alpha."""
    partials: Array
    """(N, k) dF/dtheta."""


class Dynamics(ABC):
    """A law without its curve: its parameters theta (k,) inside box bounds, and what they do.

    theta is what the optimiser moves; `values` are the law's own parameters, in the order of `names`.
    """

    names: tuple[str, ...] = ()

    @abstractmethod
    def blend(self, static: Array, theta: Array, step: float) -> Blend:
        """Return the valve force of a static force (N,) [N] sampled every `step` [s]."""

    @abstractmethod
    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the law with its curve and port."""

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest theta (k,)."""
        return np.empty(0), np.empty(0)

    def scale(self) -> Array:
        """Return the size of a change of theta (k,) that matters."""
        return np.empty(0)

    def values(self, theta: Array) -> Array:
        """Return the law's own parameters (k,), SI."""
        return theta

    def values_jacobian(self, theta: Array) -> Array:
        """Return dvalues/dtheta (k, k)."""
        return np.eye(theta.size)

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of the law's own parameters."""
        return ()


class NoLag(Dynamics):
    """Polylinear: F = F_s."""

    def blend(self, static: Array, theta: Array, step: float) -> Blend:
        """F = F_s."""
        zero = np.zeros_like(static)
        return Blend(static, zero, zero, np.empty((static.size, 0)))

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the Polylinear law."""
        return Polylinear(curve, port=port)


@dataclass(frozen=True, slots=True)
class FullLag(Dynamics):
    """LPF1: F = F_lag (Eq 3.24); theta = (tau,) [s]."""

    limits: Limits
    names = ("time_constant",)

    def blend(self, static: Array, theta: Array, step: float) -> Blend:
        """F = F_lag."""
        lagged = lag(static, theta[0], step)
        slower = lag_sensitivity(static, lagged, theta[0], step)
        return Blend(lagged, np.ones_like(static), np.zeros_like(static), slower[:, None])

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the LPF1 law."""
        return Lpf1(curve, float(theta[0]), port=port)

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of tau."""
        lowest, highest = self.limits.time_constant
        return np.array([lowest]), np.array([highest])

    def scale(self) -> Array:
        """Return 1 ms."""
        return np.array([1e-3])

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of tau [s]."""
        return (self.limits.time_constant,)


@dataclass(frozen=True, slots=True)
class FadingLag(Dynamics):
    """LPNL2: alpha falls from 1 to 0 between two static forces (Eq 3.25).

    theta = (tau [s], F_1 [N], u [1]) with F_2 = F_1 + g + u (F_max - g - F_1), 0 <= u <= 1, so that
    F_2 - F_1 >= g and F_2 <= F_max are plain bounds.
    """

    limits: Limits
    names = ("time_constant", "lag_full_force", "lag_zero_force")

    def blend(self, static: Array, theta: Array, step: float) -> Blend:
        """F = alpha F_lag + (1 - alpha) F_s."""
        tau, full, zero = self.values(theta)
        lagged = lag(static, tau, step)
        behind = lagged - static
        share = (zero - np.abs(static)) / (zero - full)
        weight = np.clip(share, 0.0, 1.0)
        ramp = np.where((share > 0.0) & (share < 1.0), behind / (zero - full), 0.0)
        by_values = np.column_stack(
            [weight * lag_sensitivity(static, lagged, tau, step), ramp * share, ramp * (1.0 - share)]
        )
        partials = by_values @ self.values_jacobian(theta)
        return Blend(static + weight * behind, weight, -np.sign(static) * ramp, partials)

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the LPNL2 law."""
        return Lpnl2(curve, *self.values(theta).tolist(), port=port)

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of tau, F_1 and u."""
        (shortest, longest), (lowest, highest) = self.limits.time_constant, self.limits.force
        return np.array([shortest, lowest, 0.0]), np.array([longest, highest - self.limits.gap, 1.0])

    def scale(self) -> Array:
        """Return 1 ms and a tenth of the forces."""
        return np.array([1e-3, 0.1 * self.limits.force[1], 0.1])

    def values(self, theta: Array) -> Array:
        """Return tau [s], F_1 and F_2 [N]."""
        return np.array([theta[0], theta[1], theta[1] + self.limits.gap + theta[2] * self._room(theta)])

    def values_jacobian(self, theta: Array) -> Array:
        """Return d(tau, F_1, F_2)/dtheta (3, 3)."""
        jacobian = np.eye(3)
        jacobian[2] = (0.0, 1.0 - theta[2], self._room(theta))
        return jacobian

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of tau [s], F_1 and F_2 [N]."""
        lowest, highest = self.limits.force
        return self.limits.time_constant, (lowest, highest - self.limits.gap), (lowest + self.limits.gap, highest)

    def theta(self, time_constant: float, full: float, zero: float) -> Array:
        """Return theta of tau [s], F_1 and F_2 [N]; forces that the bounds forbid are moved inside."""
        low, high = self.bounds()
        full = float(np.clip(full, low[1], high[1]))
        room = max(self.limits.force[1] - self.limits.gap - full, 1e-9 * self.limits.force[1])
        return np.clip([time_constant, full, (zero - full - self.limits.gap) / room], low, high)

    def _room(self, theta: Array) -> float:
        return float(self.limits.force[1] - self.limits.gap - theta[1])


def dynamics_for(law: str, limits: Limits) -> Dynamics:
    """Return the dynamics of a law by its name."""
    return {"polylinear": NoLag(), "lpf1": FullLag(limits), "lpnl2": FadingLag(limits)}[law]
