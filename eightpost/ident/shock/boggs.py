"""The dissertation's recipe (3.3): the curve first, then tau on a grid, then LPNL2's parameters by constrained search.

The curve is fitted without lag to the low-passed record and then held; the model's force is not low-passed again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import Bounds, minimize

from eightpost.ident.shock.dynamics import FadingLag, FullLag
from eightpost.ident.shock.limits import FORCE
from eightpost.ident.shock.solution import Solution, covariance, independent_samples, linear_solution

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from eightpost.ident.shock.basis import Join
    from eightpost.ident.shock.force_model import ForceModel

    Array = NDArray[np.float64]

#: Spacing of the time constants that are tried [s] (3.3.2).
INCREMENT = 1e-4

#: Starts of the transition forces over the peak static force.
_STARTS = ((0.1, 0.5), (0.3, 0.9), (0.6, 1.5))


_NEGATIVE = "gas stiffness held at 0: the record would make it negative"


@dataclass(frozen=True, slots=True)
class Boggs:
    """One after the other, in the order of 3.3, with the printed bounds."""

    name = "boggs"
    ceiling = FORCE[1]

    def fit(self, model_for: Callable[[Join], ForceModel]) -> Solution:
        """Return the dissertation's solution.

        Args:
            model_for: Gives the model whose cubics join the inner polynomial in a certain way: here freely.
        """
        static = _static(model_for("free"))
        dynamics = static.model.dynamics
        if isinstance(dynamics, FullLag):
            return _on_grid(static, dynamics)
        if isinstance(dynamics, FadingLag):
            return _constrained(static, dynamics)
        return static


def _static(model: ForceModel) -> Solution:
    inside, target = model.prepared.inside, model.prepared.measured
    columns = model.linear_columns[inside]
    weights = linear_solution(columns, target)
    if model.gas.count > 1 and weights[-1] < 0.0:
        return replace(_static(replace(model, gas=model.gas.without_stiffness())), notes=(_NEGATIVE,))
    spread = covariance(columns, columns @ weights - target, independent_samples(model))
    return Solution(model, weights, spread, True, "linear least squares")


def _on_grid(static: Solution, dynamics: FullLag) -> Solution:
    """Take the best of tau = 0.1, 0.2, .. 10 ms, as far as the bounds go."""
    lowest, highest = dynamics.limits.time_constant
    first, last = int(np.ceil(lowest / INCREMENT * (1.0 - 1e-9))), int(np.floor(highest / INCREMENT * (1.0 + 1e-9)))
    grid = [number * INCREMENT for number in range(first, last + 1)]
    errors = [_error(static, np.array([tau])) for tau in grid]
    return _with_theta(static, np.array([grid[int(np.argmin(errors))]]), True, f"best of {len(grid)} time constants")


def _constrained(static: Solution, dynamics: FadingLag) -> Solution:
    """Minimise over tau and the transition forces by SLSQP, from LPF1's tau and a few pairs of forces."""
    simple = replace(static, model=replace(static.model, dynamics=FullLag(dynamics.limits)))
    tau = float(_on_grid(simple, FullLag(dynamics.limits)).parameters[-1])
    curve = static.parameters[: static.model.curve_count]
    peak = float(np.abs(static.model.basis.columns @ curve).max())
    unit = np.array([1e-3, peak, peak])
    bounds = np.array(dynamics.value_bounds()) / unit[:, None]

    def error(values: Array) -> float:
        return _error(static, dynamics.theta(*(values * unit).tolist()))

    def apart(values: Array) -> float:
        return float(values[2] - values[1]) - dynamics.limits.gap / peak

    results = [
        minimize(
            error,
            np.clip(np.array([tau, full * peak, zero * peak]) / unit, *bounds.T),
            method="SLSQP",
            bounds=Bounds(*bounds.T),
            constraints={"type": "ineq", "fun": apart},
            options={"ftol": 1e-9, "maxiter": 100},
        )
        for full, zero in _STARTS
    ]
    best = min(results, key=lambda result: float(result.fun))
    theta = dynamics.theta(*(best.x * unit).tolist())
    return _with_theta(static, theta, bool(best.success), f"SLSQP: {best.message}")


def _error(static: Solution, theta: Array) -> float:
    """Return the mean square error over the force's variance [1], the curve held."""
    model = static.model
    force = model.force(np.append(static.parameters, theta))[model.prepared.inside]
    return float(np.mean((force - model.prepared.measured) ** 2)) / model.prepared.deviation**2


def _with_theta(static: Solution, theta: Array, converged: bool, status: str) -> Solution:
    """Add theta to the static solution; its covariance is that of theta alone, for the curve was held."""
    model, m = static.model, static.parameters.size
    parameters = np.append(static.parameters, theta)
    inside = model.prepared.inside
    residual = model.force(parameters)[inside] - model.prepared.measured
    spread = np.zeros((parameters.size, parameters.size))
    spread[:m, :m] = static.covariance
    spread[m:, m:] = covariance(model.jacobian(parameters)[inside][:, m:], residual, independent_samples(model))
    return Solution(model, parameters, spread, converged, status, static.notes)
