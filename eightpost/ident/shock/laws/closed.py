"""Dynamics of the laws whose force has a closed form over a whole record: Polylinear, LPF1, LPNL2."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.ident.shock.force.dynamics import Dynamics
from eightpost.ident.shock.laws.projection import fading_starts
from eightpost.ident.shock.record.lagging import lag, lag_sensitivity
from eightpost.shock import Lpf1, Lpnl2, Polylinear

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.force.force_model import ForceModel
    from eightpost.ident.shock.force.limits import Limits
    from eightpost.shock import Port, ShockLaw, StaticCurve

    Array = NDArray[np.float64]

#: Relative step of tau for its derivative by differences.
_TAU_STEP = 1e-4


class Blend(NamedTuple):
    """The valve force F = alpha F_lag + (1 - alpha) F_s of a record and its derivatives."""

    force: Array
    """F (N,) [N]."""
    weight: Array
    """alpha (N,) [1]."""
    slope: Array
    """(F_lag - F_s) dalpha/dF_s (N,) [1]: effect of a change of F_s through alpha."""
    partials: Array
    """dF/dtheta (k, N)."""


@dataclass(frozen=True, slots=True)
class NoLag(Dynamics):
    """Polylinear: F = F_s."""

    limits: Limits

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = F_s."""
        return model.static(b)

    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = F_s at the rows."""
        return model.curve_rows() @ b

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives; the force is linear in the curve."""
        columns = model.curve_rows()
        return columns, np.empty((columns.shape[0], 0))

    def sketched_on(self, model: ForceModel) -> ForceModel:
        """Return the model itself: it is linear and so needs no thinning."""
        return model

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the Polylinear law."""
        return Polylinear(curve, port=port)


@dataclass(frozen=True, slots=True)
class FullLag(Dynamics):
    """LPF1: F = F_lag (Eq 3.24); theta = (tau,) [s]."""

    limits: Limits
    names = ("time_constant",)
    units = ("s",)

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = F_lag."""
        static = model.static(b)
        pairs = zip(model.runs.prepared, model.runs.parts, strict=True)
        return np.concatenate([lag(static[part], theta[0], p.step) for p, part in pairs])

    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = F_lag at the rows."""
        return model.lagged_rows(b, theta[0])

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives: exact for the curve, by a central difference for tau."""
        step = _TAU_STEP * theta[0]
        by_tau = model.lagged_rows(b, theta[0] + step) - model.lagged_rows(b, theta[0] - step)
        return model.curve_rows(theta[0]), by_tau[:, None] / (2.0 * step)

    def sketched_on(self, model: ForceModel) -> ForceModel:
        """Return the model itself: a lag adds almost no cost in the spectrum."""
        return model

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the LPF1 law."""
        return Lpf1(curve, float(theta[0]), port=port)

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of tau."""
        lowest, highest = self.limits.time_constant
        return np.array([lowest]), np.array([highest])

    def scale(self) -> Array:
        """Return a change of 1 ms."""
        return np.array([1e-3])

    def value_bounds(self) -> tuple[tuple[float, float], ...]:
        """Return the bounds of tau [s]."""
        return (self.limits.time_constant,)

    def changes(self) -> tuple[str, ...]:
        """Return notes on changed bounds of tau."""
        return self.limits.lag_changes


@dataclass(frozen=True, slots=True)
class FadingLag(Dynamics):
    """LPNL2: alpha falls from 1 to 0 between two static forces (Eq 3.25).

    theta = (tau [s], F_1 [N], u [1]) with F_2 = F_1 + g + u (F_max - g - F_1), 0 <= u <= 1, so that
    F_2 - F_1 >= g and F_2 <= F_max are plain bounds.
    """

    limits: Limits
    names = ("time_constant", "lag_full_force", "lag_zero_force")
    units = ("s", "N", "N")

    def blend(self, static: Array, theta: Array, step: float) -> Blend:
        """Return F = alpha F_lag + (1 - alpha) F_s of a static force (N,) [N] sampled every `step` [s]."""
        tau, full, zero = self.values(theta)
        lagged = lag(static, tau, step)
        behind = lagged - static
        share = (zero - np.abs(static)) / (zero - full)
        weight = np.clip(share, 0.0, 1.0)
        ramp = np.where((share > 0.0) & (share < 1.0), behind / (zero - full), 0.0)
        by_tau = weight * lag_sensitivity(static, lagged, tau, step)
        partials = self.values_jacobian(theta).T @ np.vstack([by_tau, ramp * share, ramp * (1.0 - share)])
        return Blend(static + weight * behind, weight, -np.sign(static) * ramp, partials)

    def force(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = alpha F_lag + (1 - alpha) F_s."""
        tau, full, zero = self.values(theta)
        static = model.static(b)
        pairs = zip(model.runs.prepared, model.runs.parts, strict=True)
        behind = np.concatenate([lag(static[part], tau, p.step) for p, part in pairs]) - static
        weight = np.clip((zero - np.abs(static)) / (zero - full), 0.0, 1.0)
        return np.asarray(static + weight * behind)

    def rows(self, model: ForceModel, b: Array, theta: Array) -> Array:
        """Return F = alpha F_lag + (1 - alpha) F_s at the rows."""
        return model.runs.rows(self.force(model, b, theta))

    def rows_jacobian(self, model: ForceModel, b: Array, theta: Array) -> tuple[Array, Array]:
        """Return the derivatives in closed form, through F_s, F_lag and alpha."""
        static, columns = model.static(b), model.basis.columns.T
        changes = np.empty((columns.shape[0] + theta.size, static.size))
        by_curve, by_theta = np.split(changes, [columns.shape[0]])
        for p, part in zip(model.runs.prepared, model.runs.parts, strict=True):
            blend, here = self.blend(static[part], theta, p.step), columns[:, part]
            lagged = lag(here.T, theta[0], p.step).T
            lagged *= blend.weight
            np.multiply(here, 1.0 - blend.weight + blend.slope, out=by_curve[:, part])
            by_curve[:, part] += lagged
            by_theta[:, part] = blend.partials
        by_curve, by_theta = np.split(model.runs.rows(changes), [columns.shape[0]])
        return by_curve.T, by_theta.T

    def behind(self, model: ForceModel, time_constant: float) -> Array:
        """Return the difference (n, N) between the curve's lagged columns and the columns, for a lag [s]."""
        columns, pairs = model.basis.columns.T, zip(model.runs.prepared, model.runs.parts, strict=True)
        return np.hstack([lag(columns[:, part].T, time_constant, p.step).T for p, part in pairs]) - columns

    def faded_rows(self, model: ForceModel, static: Array, theta: Array, behind: Array) -> Array:
        """Return the curve's columns at the rows (R, n) with alpha fixed for a given static force: linear, for starts.

        Args:
            model: Model of the force.
            static: Static force F_s (N,) [N].
            theta: Parameters (3,).
            behind: Difference (n, N) that theta's lag makes; see the method of this name.
        """
        _, full, zero = self.values(theta)
        weight = np.clip((zero - np.abs(static)) / (zero - full), 0.0, 1.0)
        return model.runs.rows(model.basis.columns.T + weight * behind).T

    def like_lpf1(self, model: ForceModel, lpf1: Array) -> Array:
        """Return theta with alpha = 1 up to the peak of the static force."""
        peak = float(np.abs(model.static(lpf1[: model.curve_count])).max())
        return self.theta(float(lpf1[-1]), 1.05 * peak, 1.5 * peak)

    def starts(self, model: ForceModel, lpf1: Array, count: int) -> list[Array]:
        """Return the best starting points of a grid of transition forces."""
        return fading_starts(model, self, lpf1, count)

    def law(self, curve: StaticCurve, port: Port, theta: Array) -> ShockLaw:
        """Return the LPNL2 law."""
        return Lpnl2(curve, *self.values(theta).tolist(), port=port)

    def bounds(self) -> tuple[Array, Array]:
        """Return the bounds of tau, F_1 and u."""
        (shortest, longest), (lowest, highest) = self.limits.time_constant, self.limits.force
        return np.array([shortest, lowest, 0.0]), np.array([longest, highest - self.limits.gap, 1.0])

    def scale(self) -> Array:
        """Return a change of 1 ms and of a tenth of the forces."""
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

    def changes(self) -> tuple[str, ...]:
        """Return notes on changed bounds of tau and of the forces."""
        return (*self.limits.lag_changes, *self.limits.force_changes)

    def theta(self, time_constant: float, full: float, zero: float) -> Array:
        """Return theta of tau [s], F_1 and F_2 [N]; forces outside the bounds are moved inside."""
        low, high = self.bounds()
        full = float(np.clip(full, low[1], high[1]))
        room = max(self.limits.force[1] - self.limits.gap - full, 1e-9 * self.limits.force[1])
        return np.clip([time_constant, full, (zero - full - self.limits.gap) / room], low, high)

    def _room(self, theta: Array) -> float:
        return float(self.limits.force[1] - self.limits.gap - theta[1])
