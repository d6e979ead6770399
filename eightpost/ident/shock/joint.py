"""The joint recipe: curve, gas force and lag together, the model's force through the same low-pass as the data.

Fitting the curve first and the lag after, as the dissertation does, biases both: the curve takes up what the lag
should explain. Here every parameter moves at once, from starts that a scan of tau finds.

The cubics join the inner polynomial in value and slope: left free, the blend steps up or down at the transition by
whatever the record does not see. Where a record does demand the freedom, it is given. A curve that falls while the
velocity rises is a defect (it pushes where it should damp); where it would, it is held from falling.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar

from eightpost.ident.shock.dynamics import FadingLag, FullLag
from eightpost.ident.shock.fitted_curve import NOTABLE_FALL
from eightpost.ident.shock.lagging import lag
from eightpost.ident.shock.problem import Problem
from eightpost.ident.shock.solution import Solution, linear_solution

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

    from eightpost.ident.shock.basis import Join
    from eightpost.ident.shock.force_model import ForceModel
    from eightpost.ident.shock.problem import Minimum

    Array = NDArray[np.float64]

#: Values of tau that the scan starts with, evenly spaced in its logarithm between the bounds.
_SCAN = 10

#: Starts of LPNL2: tau over LPF1's, and the transition forces over the peak static force.
_TAU_SHARES = (1.0, 1.6, 2.5)
_FULL_SHARES, _ZERO_SHARES = (0.03, 0.15, 0.4, 0.7), (0.3, 0.6, 1.0, 1.8)

#: How many of those starts are followed to their minimum, beside LPF1's own solution.
_FOLLOWED = 2

#: Freedom at the transition must lower the sum of squares by this share; four parameters win 0.4 % by chance.
_WORTHWHILE = 0.02

#: A fall of the curve by 1 N costs as much as a force error of this many N all along.
_FALL_PRICE = 10.0

_JOINED = "the outer cubics join the inner polynomial in value and slope, not freely"
_HELD = "the curve is held from falling while the velocity rises: this record alone would let it"


@dataclass(frozen=True, slots=True)
class Joint:
    """All parameters together; LPNL2 is never worse than LPF1, for it starts from there."""

    name = "joint"
    ceiling = float("inf")

    def fit(self, model_for: Callable[[Join], ForceModel]) -> Solution:
        """Return the least-squares solution.

        Args:
            model_for: Gives the model whose cubics join the inner polynomial in a certain way.
        """
        tied, free = model_for("slope"), model_for("free")
        if isinstance(tied.dynamics, FadingLag):
            minimum = _fading(tied, free, tied.dynamics)
        else:
            minimum = _settled(Problem(tied).followed(_start(tied)), free)
        joined = () if minimum.problem.model.basis is free.basis else (_JOINED,)
        held = (_HELD,) if minimum.problem.fall_weight else ()
        return minimum.solution((*joined, *held))


def _start(model: ForceModel) -> Array:
    """Return parameters to start from: for a given tau the rest is linear, and the lag commutes with the low-pass."""
    rows, n = model.rows, model.curve_count
    columns, target = model.prepared.filtered(model.linear_columns.T).T, model.target
    if not isinstance(model.dynamics, FullLag):
        return linear_solution(columns[rows], target)

    def solved(tau: float) -> tuple[float, Array]:
        lagged = np.hstack([lag(columns[:, :n], tau, model.prepared.step), columns[:, n:]])[rows]
        weights = linear_solution(lagged, target)
        return float(np.sum((lagged @ weights - target) ** 2)), weights

    def cost(tau: float) -> float:
        return solved(float(tau))[0]

    (low,), (high,) = model.dynamics.bounds()
    grid = np.geomspace(low, high, _SCAN)
    best = int(np.argmin([cost(tau) for tau in grid]))
    bracket = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _SCAN - 1)])
    tau = float(minimize_scalar(cost, bounds=bracket, method="bounded", options={"xatol": 1e-5}).x)
    return np.append(solved(tau)[1], tau)


def _settled(minimum: Minimum, free: ForceModel, *others: Array) -> Minimum:
    """Return the minimum with a curve that does not fall, its cubics released where that is worthwhile."""
    rising = _rising(minimum, *others)
    loose = _rising(_released(rising, free))
    return min((rising, loose), key=lambda minimum: minimum.cost)


def _rising(minimum: Minimum, *others: Array) -> Minimum:
    """Follow on with a curve that is held from falling, where it falls notably; also from `others`, if any."""
    problem = minimum.problem
    if problem.fall_weight or problem.deepest_fall(minimum.parameters) <= NOTABLE_FALL:
        return minimum
    held = replace(problem, fall_weight=_FALL_PRICE * float(np.sqrt(problem.model.rows.size)))
    minima = [held.followed(start) for start in (minimum.parameters, *others)]
    return min(minima, key=lambda minimum: minimum.cost)


def _released(minimum: Minimum, free: ForceModel) -> Minimum:
    """Follow on with cubics that join freely, where a Gauss-Newton step says that this is worthwhile."""
    model = minimum.problem.model
    if model.basis is free.basis:
        return minimum
    curve, rest = minimum.parameters[: model.curve_count], minimum.parameters[model.curve_count :]
    same = free.basis.columns.T @ (model.basis.columns @ curve) / len(model.prepared.record)
    problem, start = replace(minimum.problem, model=free), np.append(same, rest)
    jacobian = problem.jacobian(start)
    step = linear_solution(jacobian, minimum.residual)
    left = float(np.sum((minimum.residual - jacobian @ step) ** 2))
    return minimum if left > (1.0 - _WORTHWHILE) * minimum.cost else problem.followed(start)


def _fading(tied: ForceModel, free: ForceModel, dynamics: FadingLag) -> Minimum:
    """Fit LPNL2 from LPF1's solution (alpha = 1 everywhere) and from the best of a grid of transition forces."""
    first, first_free = (replace(model, dynamics=FullLag(dynamics.limits)) for model in (tied, free))
    lpf1 = _settled(Problem(first).followed(_start(first)), first_free)
    base = free if lpf1.problem.model.basis is free.basis else tied
    problem, linear, tau = Problem(base), lpf1.parameters[:-1], float(lpf1.parameters[-1])
    peak = float(np.abs(base.basis.columns @ linear[: base.curve_count]).max())
    same = np.append(linear, dynamics.theta(tau, 1.05 * peak, 1.5 * peak))
    others = [np.append(linear, theta) for theta in _fading_starts(dynamics, tau, peak)]
    others.sort(key=lambda parameters: float(np.sum(problem.residual(parameters) ** 2)))
    minima = [problem.followed(start) for start in (same, *others[:_FOLLOWED])]
    best = _settled(min(minima, key=lambda minimum: minimum.cost), free, same)
    return best if best.cost <= lpf1.cost else problem.at(same, "LPF1's solution: no fading of the lag is better")


def _fading_starts(dynamics: FadingLag, tau: float, peak: float) -> Iterable[Array]:
    for share in _TAU_SHARES:
        for full in _FULL_SHARES:
            for zero in _ZERO_SHARES:
                if zero > full:
                    yield dynamics.theta(share * tau, full * peak, zero * peak)
