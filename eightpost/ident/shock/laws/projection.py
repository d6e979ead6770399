"""Variable projection: for a given lag the force is linear in curve and gas, so only the lag is searched."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from eightpost.ident.shock.force.linear import linear_solution

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from eightpost.ident.shock.force.force_model import ForceModel
    from eightpost.ident.shock.laws.closed import FadingLag

    Array = NDArray[np.float64]

#: Number of values of tau in the first scan, evenly spaced in its logarithm between the bounds.
_SCAN = 12

#: Starting points of LPNL2: tau relative to LPF1's, and the transition forces relative to the peak static force.
_TAU_SHARES = (1.0, 1.7)
_FULL_SHARES, _ZERO_SHARES = (0.03, 0.15, 0.5), (0.4, 0.8, 1.6)


def projected(model: ForceModel, curve_rows: Array) -> tuple[Array, float]:
    """Return curve and gas (n + g,) for columns of the curve at the rows (R, n), and the sum of squares [N2]."""
    runs = model.runs
    root = np.sqrt(runs.weights)
    columns, target = root[:, None] * np.hstack([curve_rows, model.gas_rows]), root * runs.target
    gram = columns.T @ columns
    # The basis is orthogonal and a lag changes that little, so the normal equations are accurate, and fast.
    if np.linalg.cond(gram) < 1e10:
        weights = np.linalg.solve(gram, columns.T @ target)
    else:
        weights = linear_solution(columns, target)
    return weights, float(np.sum((columns @ weights - target) ** 2))


def best_lag(model: ForceModel, bounds: tuple[float, float]) -> Array:
    """Return curve, gas and tau (n + g + 1,) of the best single lag: a scan of tau, then a search."""

    def cost(logarithm: float) -> float:
        return projected(model, model.curve_rows(float(np.exp(logarithm))))[1]

    grid = np.log(np.geomspace(*bounds, _SCAN))
    best = int(np.argmin([cost(value) for value in grid]))
    bracket = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _SCAN - 1)])
    found = minimize_scalar(cost, bounds=bracket, method="bounded", options={"xatol": 1e-4})
    tau = float(np.exp(found.x))
    return np.append(projected(model, model.curve_rows(tau))[0], tau)


def fading_starts(model: ForceModel, dynamics: FadingLag, lpf1: Array, count: int) -> list[Array]:
    """Return the best starting points (count, n + g + 3) of a fading lag, with alpha from LPF1's static force."""
    static = model.static(lpf1[: model.curve_count])
    taus = np.minimum(float(lpf1[-1]) * np.array(_TAU_SHARES), dynamics.limits.time_constant[1])
    starts = []
    for tau in taus.tolist():
        behind = dynamics.behind(model, tau)
        for theta in _fading_thetas(dynamics, tau, float(np.abs(static).max())):
            linear, cost = projected(model, dynamics.faded_rows(model, static, theta, behind))
            starts.append((cost, np.append(linear, theta)))
    starts.sort(key=lambda start: start[0])
    return [parameters for _, parameters in starts[:count]]


def _fading_thetas(dynamics: FadingLag, tau: float, peak: float) -> Iterable[Array]:
    for full in _FULL_SHARES:
        for zero in _ZERO_SHARES:
            if zero > full:
                yield dynamics.theta(tau, full * peak, zero * peak)
