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
from eightpost.ident.shock.solvers.sketch import Sketch, sketched
from eightpost.shock.curve import INNER_ORDER

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.basis import WorkingBasis
    from eightpost.ident.shock.curve.shape import Hold, Shape
    from eightpost.ident.shock.force.force_model import ForceModel
    from eightpost.ident.shock.force.models import Models
    from eightpost.ident.shock.solvers.problem import Minimum
    from eightpost.ident.shock.solvers.solution import Solution

    Array = NDArray[np.float64]

#: How many starts of LPNL2 are followed, roughly, to their minimum.
_FOLLOWED = 2

#: Tolerance of the guides: which start is best is known long before its minimum is.
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
    """All parameters together; LPNL2 is never worse than LPF1, for it can say the same.

    A law is sketched first, on a part of the samples where they are costly; outliers are weighed there too. What is
    found is then followed to its minimum on the whole record.

    Attributes:
        shape: What the curve may do.
        order: Of the inner polynomial; None: by cross-validation.
    """

    shape: Shape = "auto"
    order: int | None = None
    ceiling = float("inf")

    def sketch(self, models: Models) -> Sketch:
        """Return the minimum on the record that the law is sketched on.

        Args:
            models: Gives the model of an order whose cubics join the inner polynomial in a certain way.
        """
        tau = _lag_of(models("slope", self.order or INNER_ORDER))
        return self._search(models, self._order(models, tau), tau)

    def weighed(self, sketch: Sketch, weights: Array) -> Sketch:
        """Return a sketch at other weights (R,) of the rows, from where it is: same order, cubics joined alike."""
        model = sketch.whole.weighted(weights)
        problem = Problem(model) if sketch.is_final else sketched(model)
        return replace(sketch, minimum=self._on(problem, sketch.minimum), models=sketch.models.weighted(weights))

    def reordered(self, sketch: Sketch, weights: Array) -> Sketch:
        """Return a sketch at other weights (R,), for which the curve may be of another order."""
        models = sketch.models.weighted(weights)
        order = self._order(models, sketch.tau)
        return self.weighed(sketch, weights) if order == sketch.order else self._search(models, order, sketch.tau)

    def fit(self, models: Models) -> Solution:
        """Return the least-squares solution of models on the whole record."""
        return self.solution(self.finished(self.sketch(models)))

    def finished(self, sketch: Sketch) -> Sketch:
        """Return the minimum that a sketch leads to on the whole record, its cubics released where worthwhile."""
        if sketch.is_final:
            return sketch
        model = sketch.whole
        minimum = self._on(Problem(model), sketch.minimum)
        if not model.dynamics.needs_rise:
            minimum = self._settled(minimum, sketch.models("free", sketch.order))
        if sketch.lpf1 is not None and isinstance(model.dynamics, FadingLag):
            like = _like(sketch.lpf1, model.dynamics, sketch.weights)
            minimum = min((minimum, like), key=lambda m: m.cost)
        return replace(sketch, minimum=minimum)

    def solution(self, sketch: Sketch) -> Solution:
        """Return a finished sketch as a solution, with a note for each choice that it made."""
        minimum, order = sketch.minimum, sketch.order
        notes = [] if order == INNER_ORDER else [_order_note(order, self.order)]
        notes += [] if sketch.is_free else [_JOINED]
        if minimum.leans:
            notes += [_RISING if minimum.problem.model.dynamics.needs_rise else _HELD[self.shape]]
        return minimum.solution(tuple(notes))

    def _on(self, problem: Problem, minimum: Minimum) -> Minimum:
        """Follow a minimum of the same parameters on in another problem; what it leans on goes on to hold it."""
        basis, hold = problem.model.basis, minimum.problem.hold
        if problem.model.dynamics.needs_rise:
            return problem.held(rising_hold(basis, minimum.curve), minimum.parameters)
        if hold is not None and minimum.leans:
            return problem.held(hold, minimum.parameters)
        return self._shaped(problem.followed(minimum.parameters))

    def _order(self, models: Models, tau: float | None) -> int:
        return self.order or choose_order(models.runs, models.order_rows(tau))

    def _search(self, models: Models, order: int, tau: float | None) -> Sketch:
        tied = models("slope", order)
        dynamics, start = tied.dynamics, projected(tied, tied.curve_rows(tau))[0]
        if tau is None:
            return Sketch(self._settled(Problem(tied).followed(start), models("free", order)), models, order, tau)
        first = tied.with_dynamics(FullLag(dynamics.limits))
        lpf1 = Problem(first).followed(np.append(start, tau))
        if dynamics.needs_rise:  # a step at the transition may be one down
            lpf1 = replace(self, shape="monotone")._shaped(lpf1)
        else:
            lpf1 = self._settled(lpf1, models("free", order))
        sketch = Sketch(lpf1, models, order, tau, lpf1)
        return sketch if isinstance(dynamics, FullLag) else replace(sketch, minimum=self._beyond_lpf1(sketch))

    def _beyond_lpf1(self, lpf1: Sketch) -> Minimum:
        """Follow the best of another law's starts, or LPF1's own solution where the law has none."""
        base, parameters = lpf1.whole, lpf1.minimum.parameters
        dynamics, problem = base.dynamics, sketched(base)
        starts = dynamics.starts(problem.model, parameters, _FOLLOWED)
        best = _best(problem, starts or [np.append(parameters[:-1], dynamics.like_lpf1(base, parameters))])
        if dynamics.needs_rise:
            return problem.held(rising_hold(base.basis, lpf1.minimum.curve), best)
        return self._shaped(problem.followed(best))

    def _settled(self, minimum: Minimum, free: ForceModel) -> Minimum:
        """Return the minimum with the shape that was asked for, its cubics released where that is worthwhile."""
        shaped = self._shaped(minimum)
        return min((shaped, *self._released(shaped, free)), key=lambda m: m.cost)

    def _released(self, minimum: Minimum, free: ForceModel) -> list[Minimum]:
        """Follow on with cubics that join freely, where a Gauss-Newton step says that this is worthwhile."""
        model = minimum.problem.model
        if model.has_curve_of(free):
            return []
        curve, *rest = model.split(minimum.parameters)
        same = linear_solution(free.basis.grid_columns, model.basis.grid_columns @ curve)
        problem, start = Problem(free.with_dynamics(model.dynamics)), np.concatenate([same, *rest])
        jacobian, residual = problem.jacobian(start), problem.residual(start)
        step = linear_solution(jacobian, residual)
        if float(np.sum((residual - jacobian @ step) ** 2)) > (1.0 - _WORTHWHILE) * minimum.cost:
            return []
        hold = self._hold(free.basis, same - step[: same.size])
        return [self._shaped(problem.followed(start)) if hold is None else problem.held(hold, start)]

    def _shaped(self, minimum: Minimum) -> Minimum:
        """Follow on with a curve that is held to its shape, where it needs holding."""
        problem, b = minimum.problem, minimum.curve
        hold = problem.hold or self._hold(problem.model.basis, b)
        if hold is None or hold is problem.hold or not hold.shortfall(b).any():
            return minimum
        return problem.held(hold, minimum.parameters)

    def _hold(self, basis: WorkingBasis, b: Array) -> Hold | None:
        """Return what a curve b is to be held to, if anything."""
        if self.shape == "free" or (self.shape == "auto" and deepest_fall(basis, b) <= NOTABLE_FALL):
            return None
        return hold_for(basis, b, self.shape)


def _best(problem: Problem, starts: Sequence[Array]) -> Array:
    """Return where the best of some starts leads, roughly."""
    if len(starts) == 1:
        return starts[0]
    guides = [replace(problem, tolerance=_GUIDE).followed(start) for start in starts]
    return min(guides, key=lambda guide: guide.cost).parameters


def _like(lpf1: Minimum, dynamics: FadingLag, weights: Array) -> Minimum:
    """Return LPF1's minimum said by a law that fades, at weights (R,) of the rows."""
    model = lpf1.problem.model.with_dynamics(dynamics).weighted(weights)
    same = np.append(lpf1.parameters[:-1], dynamics.like_lpf1(model, lpf1.parameters))
    return Problem(model, lpf1.problem.hold).at(same, "LPF1's solution: no fading of the lag is better")


def _lag_of(model: ForceModel) -> float | None:
    """Return the best single lag [s] behind a curve; None for a law without lag."""
    if isinstance(model.dynamics, NoLag):
        return None
    return float(best_lag(model, model.dynamics.limits.time_constant)[-1])


def _order_note(order: int, asked: int | None) -> str:
    why = "as asked" if asked else "cross-validation finds no more in the record"
    return f"inner polynomial of order {order} instead of {INNER_ORDER}: {why}"
