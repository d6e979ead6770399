"""The joint recipe: curve, gas force and lag together, the model's force through the same low-pass as the data.

Fitting the curve first and the lag after, as the dissertation does, biases both: the curve takes up what the lag
should explain. Here LPF1 comes by variable projection (curve and gas linear inside, tau outside); a law whose force
is not linear in the curve starts from there and moves every parameter at once.

The cubics join the inner polynomial in value and slope: left free, the blend steps up or down at the transition by
whatever the record does not see. Where a record does demand the freedom, it is given. A curve that falls while the
velocity rises is a defect (it pushes where it should damp); where it would, it is held from falling.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.shock.curve.fitted_curve import NOTABLE_FALL
from eightpost.ident.shock.curve.shape import deepest_fall, hold_for, rising_hold
from eightpost.ident.shock.force.linear import linear_solution
from eightpost.ident.shock.laws.closed import FadingLag, FullLag, NoLag
from eightpost.ident.shock.laws.projection import best_lag, projected
from eightpost.ident.shock.solvers.order import choose_order
from eightpost.ident.shock.solvers.problem import Problem
from eightpost.shock.curve import INNER_ORDER

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.shape import Shape
    from eightpost.ident.shock.force.dynamics import Dynamics
    from eightpost.ident.shock.force.force_model import ForceModel
    from eightpost.ident.shock.force.models import Models
    from eightpost.ident.shock.solvers.problem import Minimum
    from eightpost.ident.shock.solvers.solution import Solution

    Array = NDArray[np.float64]

#: How many starts of LPNL2 are followed to their minimum, beside LPF1's own solution.
_FOLLOWED = 2

#: Tolerance of the guides on the thinned record: which start is best is known long before its minimum is.
_GUIDE = 1e-3

#: Freedom at the transition must lower the sum of squares by this share; four parameters win 0.4 % by chance.
_WORTHWHILE = 0.02

_JOINED = "the outer cubics join the inner polynomial in value and slope, not freely"
_RISING = "the curve is held to rise all over: the law needs that"
_HELD = {
    "auto": "the curve is held from falling while the velocity rises: this record alone would let it",
    "monotone": "the curve is held monotone as asked",
    "passive": "the curve is held passive as asked: its force never pushes the way the velocity goes",
}


@dataclass(frozen=True, slots=True)
class Joint:
    """All parameters together; LPNL2 is never worse than LPF1, for it starts from there.

    Attributes:
        shape: What the curve may do.
        order: Of the inner polynomial; None: by cross-validation.
    """

    shape: Shape = "auto"
    order: int | None = None
    ceiling = float("inf")

    def fit(self, models: Models) -> Solution:
        """Return the least-squares solution.

        Args:
            models: Gives the model of an order whose cubics join the inner polynomial in a certain way.
        """
        highest = models("slope", self.order or INNER_ORDER)
        tau = _lag_of(highest)
        order = self.order or choose_order(models.runs, models.rows_by_order(tau))
        tied = highest if order == INNER_ORDER else models("slope", order)
        free = models("free", order)
        minimum = self._minimum(tied, free, tau)
        notes = [] if order == INNER_ORDER else [_order_note(order, self.order)]
        notes += [] if minimum.problem.model.basis is free.basis else [_JOINED]
        return minimum.solution((*notes, *self._shape_notes(minimum)))

    def refit(self, solution: Solution, weights: Array) -> Solution:
        """Return the solution at other weights (R,) of the rows, from where it is: same order, cubics joined alike."""
        model = replace(solution.model, runs=solution.model.runs.weighted(weights))
        if model.dynamics.needs_rise:
            hold = rising_hold(model.basis, solution.parameters[: model.curve_count])
            minimum = Problem(model).held(hold, solution.parameters)
        else:
            minimum = self._shaped(Problem(model).followed(solution.parameters))
        kept = [note for note in solution.notes if note not in (_RISING, *_HELD.values())]
        return minimum.solution((*kept, *self._shape_notes(minimum)))

    def _shape_notes(self, minimum: Minimum) -> list[str]:
        if not minimum.leans:
            return []
        return [_RISING if minimum.problem.model.dynamics.needs_rise else _HELD[self.shape]]

    def _minimum(self, tied: ForceModel, free: ForceModel, tau: float | None) -> Minimum:
        dynamics, start = tied.dynamics, projected(tied, tied.curve_rows(tau))[0]
        if tau is None:
            return self._settled(Problem(tied).followed(start), free)
        simple = FullLag(dynamics.limits)
        first, first_free = tied.with_dynamics(simple), free.with_dynamics(simple)
        lpf1 = Problem(first).followed(np.append(start, tau))
        if dynamics.needs_rise:  # a step at the transition may be one down
            lpf1 = replace(self, shape="monotone")._shaped(lpf1)
            return self._beyond_lpf1(lpf1, tied, free, dynamics)
        lpf1 = self._settled(lpf1, first_free)
        if isinstance(dynamics, FullLag):
            return lpf1
        base = free if lpf1.problem.model.basis is first_free.basis else tied
        return self._beyond_lpf1(lpf1, base.with_dynamics(dynamics), free, dynamics)

    def _beyond_lpf1(self, lpf1: Minimum, base: ForceModel, free: ForceModel, dynamics: Dynamics) -> Minimum:
        """Follow LPF1's own solution in another law, and the best of that law's starts."""
        coarse = base.coarse
        same = np.append(lpf1.parameters[:-1], dynamics.like_lpf1(base, lpf1.parameters))
        starts = [same, *dynamics.starts(coarse, lpf1.parameters, _FOLLOWED)]
        guides = [Problem(coarse).followed(start, tolerance=_GUIDE) for start in starts]
        best = min(guides, key=lambda guide: guide.cost)
        if dynamics.needs_rise:
            return Problem(base).held(rising_hold(base.basis, lpf1.curve), best.parameters)
        minimum = self._settled(Problem(base).followed(best.parameters), free, same)
        if not isinstance(dynamics, FadingLag) or minimum.cost <= lpf1.cost:
            return minimum
        return Problem(base, lpf1.problem.hold).at(same, "LPF1's solution: no fading of the lag is better")

    def _settled(self, minimum: Minimum, free: ForceModel, *others: Array) -> Minimum:
        """Return the minimum with the shape that was asked for, its cubics released where that is worthwhile."""
        shaped = self._shaped(minimum, *others)
        released = _released(shaped, free)
        return shaped if released is shaped else min((shaped, self._shaped(released)), key=lambda m: m.cost)

    def _shaped(self, minimum: Minimum, *others: Array) -> Minimum:
        """Follow on with a curve that is held to its shape, where it needs holding; also from `others`, if any."""
        problem, b = minimum.problem, minimum.curve
        model, hold = problem.model, problem.hold
        if self.shape == "free":
            return minimum
        if self.shape != "auto" or (hold is None and deepest_fall(model.basis, b) > NOTABLE_FALL):
            hold = hold_for(model.basis, b, self.shape)
        if hold is None or hold is problem.hold or not hold.shortfall(b).any():
            return minimum
        return problem.held(hold, minimum.parameters, *others)


def _lag_of(model: ForceModel) -> float | None:
    """Return the best single lag [s] behind a curve; None for a law without lag."""
    if isinstance(model.dynamics, NoLag):
        return None
    return float(best_lag(model, model.dynamics.limits.time_constant)[-1])


def _order_note(order: int, asked: int | None) -> str:
    why = "as asked" if asked else "cross-validation finds no more in the record"
    return f"inner polynomial of order {order} instead of {INNER_ORDER}: {why}"


def _released(minimum: Minimum, free: ForceModel) -> Minimum:
    """Follow on with cubics that join freely, where a Gauss-Newton step says that this is worthwhile."""
    model = minimum.problem.model
    if model.basis is free.basis:
        return minimum
    curve, rest = minimum.parameters[: model.curve_count], minimum.parameters[model.curve_count :]
    same = free.basis.columns.T @ model.static(curve) / model.runs.velocity.size
    problem, start = Problem(free.with_dynamics(model.dynamics)), np.append(same, rest)
    jacobian, residual = problem.jacobian(start), problem.residual(start)
    left = float(np.sum((residual - jacobian @ linear_solution(jacobian, residual)) ** 2))
    return minimum if left > (1.0 - _WORTHWHILE) * minimum.cost else problem.followed(start)
