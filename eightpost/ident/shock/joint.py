"""Joint fit of all parameters, and the order of the inner polynomial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.closed import FadingLag, FullLag, NoLag, best_lag, projected
from eightpost.ident.shock.curve import (
    NOTABLE_FALL,
    CurveConstraint,
    Shape,
    WorkingBasis,
    deepest_fall,
    shape_constraint,
)
from eightpost.ident.shock.force import ForceModel, Models, linear_solution
from eightpost.ident.shock.problem import TOLERANCE, Minimum, Problem, Solution
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.uncertainty import blocks_of
from eightpost.shock.curve import INNER_ORDER

# ---- The order of the inner polynomial by cross-validation on blocks of the record that are left out ----------------

#: Orders to compare, up to the dissertation's.
ORDERS = (3, 5, 7, 9, 11, 13, INNER_ORDER)

#: An order counts as equal to the best if its error is within this share of the best.
_AS_GOOD = 5e-4


#: Upper bound of a block's leverage is 1 minus this, because a block that alone determines a direction has leverage 1.
_CLEAR = 1e-8


def _choose_order(runs: Runs, columns: Array) -> int:
    """Return the next order above the lowest one that predicts left-out blocks of the record as well as the best.

    Args:
        runs: Runs with target and weights.
        columns: Columns (R, n) at the rows; the force, lag included, is linear in them. The last columns are the powers
            of the inner polynomial.
    """
    errors = _left_out_errors(runs, columns, [columns.shape[1] - INNER_ORDER + order for order in ORDERS])
    good = np.flatnonzero(errors <= (1.0 + _AS_GOOD) * errors.min())
    return ORDERS[min(int(good[0]) + 1, len(ORDERS) - 1)]


def _left_out_errors(runs: Runs, columns: Array, counts: Sequence[int]) -> Array:
    """Return the RMS errors [N] of predictions of each block by a fit to all other blocks, in closed form.

    Without block b the error there is r_b + Q_b (I - Q_b' Q_b)^-1 Q_b' r_b, with Q'Q = I and r the residual.

    Args:
        runs: Runs with target and weights.
        columns: Columns (R, n).
        counts: Number of leading columns to fit, for each error.
    """
    root = np.sqrt(runs.weights)
    size = np.linalg.norm(columns, axis=0)
    used = size > 0.0
    orthogonal = np.linalg.qr(root[:, None] * columns[:, used] / size[used])[0]
    parts = [orthogonal[block] for block in blocks_of(runs)]
    inside = (1.0 + _CLEAR) * np.eye(orthogonal.shape[1]) - np.array([q.T @ q for q in parts])
    target = root * runs.target
    errors = []
    for count in np.cumsum(used)[np.array(counts) - 1].tolist():
        q = orthogonal[:, :count]
        residual = target - q @ (q.T @ target)
        scores = np.array([q[block].T @ residual[block] for block in blocks_of(runs)])
        moves = np.linalg.solve(inside[:, :count, :count], scores[..., None])[..., 0]
        moved = np.concatenate([part[:, :count] @ move for part, move in zip(parts, moves, strict=True)])
        errors.append(float(np.sqrt(np.mean((residual + moved) ** 2))))
    return np.array(errors)


# ---- A first solution on a part of the samples, which determines the shape of the curve and the outliers ------------

#: Tolerance on a thinned record.
_ROUGH = 1e-5


def _sketched(model: ForceModel) -> Problem:
    """Return the problem with which a model of the whole record is sketched."""
    rough = model.coarse if model.dynamics.is_costly else model
    return Problem(model) if rough is model else Problem(rough, tolerance=_refit_tolerance(model))


def _refit_tolerance(model: ForceModel) -> float:
    return _CONSTRAINED_REFIT if model.basis.has_knots else _REFIT


@dataclass(frozen=True, slots=True, eq=False)
class Sketch:
    """A minimum on the samples used for sketching a law: a thinned record, if the law is costly.

    Attributes:
        minimum: Minimum on these samples.
        models: Models of the whole record, with the weights used for the minimum.
        order: Order of the inner polynomial.
        tau: Time constant of the best single lag behind the curve [s]; None for a law without lag.
        full_lag: Minimum of LPF1 from which the search started, for a law that has one.
    """

    minimum: Minimum
    models: Models
    order: int
    tau: float | None
    full_lag: Minimum | None = None

    @property
    def is_final(self) -> bool:
        """Whether it is a minimum on the whole record."""
        return self.minimum.problem.tolerance == TOLERANCE

    @property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        model = self.minimum.problem.model
        return np.asarray(model.rows(self.minimum.parameters) - model.runs.target)

    @property
    def weights(self) -> Array:
        """The weights of the rows (R,)."""
        return self.models.runs.weights

    @property
    def is_free(self) -> bool:
        """Whether the cubics join the inner polynomial freely."""
        return not self.minimum.problem.model.has_curve_of(self.models("slope", self.order))

    @property
    def whole(self) -> ForceModel:
        """The model on the whole record."""
        return self.models("free" if self.is_free else "slope", self.order)


# ---- The joint recipe -----------------------------------------------------------------------------------------------

#: Number of starting points of LPNL2 that are optimised, roughly, to their minimum.
_FOLLOWED = 2

#: Tolerance of these rough searches: the best start is known long before its minimum is.
_GUIDE = 1e-3

#: Tolerance of fits to parts of a record. They start from the fit to everything and must not stop near it; steps of the
#: curve are small beside LPNL2's transition forces, so the tolerance is below that of a fit.
_REFIT = 1e-7

#: The same where the curve is constrained: that search ends by the decrease of the sum of squares alone. The held-out
#: errors change by less than 0.003 % of the force's standard deviation.
_CONSTRAINED_REFIT = 1e-5

#: A free join must lower the sum of squares by this share; four parameters lower it by 0.4 % by chance.
_WORTHWHILE = 0.02

_JOINED = "the outer cubics join the inner polynomial in value and slope, not freely"
_CONSTRAINED = {
    "auto": "the curve was constrained to be monotonic; the unconstrained fit to this record would fall",
    "monotone": "the curve was constrained to be monotonic as requested",
    "passive": "the curve was constrained to be passive as requested: its force never acts in the direction of motion",
}


@dataclass(frozen=True, slots=True)
class Joint:
    """Joint fit of all parameters; LPNL2 is never worse than LPF1 (the full lag), which it includes as a special case.

    A law is first fitted to a sketch, a part of the samples if they are costly; outliers are weighted there too. The
    result is then optimised on the whole record.

    Attributes:
        shape: Constraint on the curve.
        order: Order of the inner polynomial; None: by cross-validation.
    """

    shape: Shape = "auto"
    order: int | None = None
    ceiling = float("inf")

    def sketch(self, models: Models) -> Sketch:
        """Return the minimum on the part of the record used for the sketch.

        Args:
            models: Function that returns the model of an order and a join of the cubics.
        """
        tau = _lag_of(models("slope", self.order or INNER_ORDER))
        return self._search(models, self._order(models, tau), tau)

    def reweighted(self, sketch: Sketch, weights: Array) -> Sketch:
        """Return a sketch with other weights (R,) of the rows, optimised from its minimum: same order, same join."""
        model = sketch.whole.weighted(weights)
        problem = Problem(model) if sketch.is_final else _sketched(model)
        return replace(sketch, minimum=self._on(problem, sketch.minimum), models=sketch.models.weighted(weights))

    def reordered(self, sketch: Sketch, weights: Array) -> Sketch:
        """Return a sketch with other weights (R,), with which the order of the curve may differ."""
        models = sketch.models.weighted(weights)
        order = self._order(models, sketch.tau)
        return self.reweighted(sketch, weights) if order == sketch.order else self._search(models, order, sketch.tau)

    def fit(self, models: Models) -> Solution:
        """Return the solution of models on the whole record, by least squares."""
        return self.solution(self.finished(self.sketch(models)))

    def finished(self, sketch: Sketch) -> Sketch:
        """Return a sketch optimised on the whole record, its cubics joined freely where worthwhile."""
        if sketch.is_final:
            return sketch
        model = sketch.whole
        minimum = self._settled(self._on(Problem(model), sketch.minimum), sketch.models("free", sketch.order))
        if sketch.full_lag is not None and isinstance(model.dynamics, FadingLag):
            like = _like(sketch.full_lag, model.dynamics, sketch.weights)
            minimum = min((minimum, like), key=lambda m: m.cost)
        return replace(sketch, minimum=minimum)

    def refitted_rows(self, sketch: Sketch, weights: Array) -> Array:
        """Return the force at the rows (R,) [N] after an optimisation with other weights (R,), such as zeros.

        A costly law is optimised on a thinned record, but to the end: if the search stopped near its start, the fit to
        everything, the rows without weight would have been seen.
        """
        model = sketch.minimum.problem.model
        rough = (model.coarse if model.dynamics.is_costly else model).weighted(weights)
        minimum = self._on(Problem(rough, tolerance=_refit_tolerance(model)), sketch.minimum)
        return model.rows(minimum.parameters)

    def solution(self, sketch: Sketch) -> Solution:
        """Return a finished sketch as a solution, with a note for each choice that it made."""
        minimum, order = sketch.minimum, sketch.order
        if sketch.models.kind == "knots":
            return minimum.solution((_through_knots(minimum.problem.model.basis),))
        notes = [] if order == INNER_ORDER else [_order_note(order, self.order)]
        notes += [] if sketch.is_free else [_JOINED]
        if minimum.is_constrained:
            notes += [_CONSTRAINED[self.shape]]
        return minimum.solution(tuple(notes))

    def _on(self, problem: Problem, minimum: Minimum) -> Minimum:
        """Optimise a minimum of the same parameters in another problem; active constraints are kept."""
        constraint = minimum.problem.constraint
        if constraint is not None and minimum.is_constrained:
            return problem.constrained_minimum(constraint, minimum.parameters)
        return self._shaped(problem.minimum_from(minimum.parameters))

    def _order(self, models: Models, tau: float | None) -> int:
        if models.kind == "knots":  # which have no polynomial
            return INNER_ORDER
        return self.order or _choose_order(models.runs, models.order_rows(tau))

    def _search(self, models: Models, order: int, tau: float | None) -> Sketch:
        tied = models("slope", order)
        dynamics, start = tied.dynamics, projected(tied, tied.curve_rows(tau))[0]
        if tau is None:
            return Sketch(self._settled(Problem(tied).minimum_from(start), models("free", order)), models, order, tau)
        first = tied.with_dynamics(FullLag(dynamics.limits, dynamics.kind))
        full_lag = self._settled(Problem(first).minimum_from(np.append(start, tau)), models("free", order))
        sketch = Sketch(full_lag, models, order, tau, full_lag)
        return sketch if isinstance(dynamics, FullLag) else replace(sketch, minimum=self._beyond_full_lag(sketch))

    def _beyond_full_lag(self, full_lag: Sketch) -> Minimum:
        """Optimise the best of another law's starts, or LPF1's own solution if the law has none."""
        base, parameters = full_lag.whole, full_lag.minimum.parameters
        dynamics, problem = base.dynamics, _sketched(base)
        starts = dynamics.starts(problem.model, parameters, _FOLLOWED)
        best = _best(problem, starts or [np.append(parameters[:-1], dynamics.like_full_lag(base, parameters))])
        return self._shaped(problem.minimum_from(best))

    def _settled(self, minimum: Minimum, free: ForceModel) -> Minimum:
        """Return the minimum with the requested shape, its cubics joined freely where that is worthwhile."""
        shaped = self._shaped(minimum)
        return min((shaped, *self._released(shaped, free)), key=lambda m: m.cost)

    def _released(self, minimum: Minimum, free: ForceModel) -> list[Minimum]:
        """Optimise with cubics that join freely, if a Gauss-Newton step shows that this is worthwhile."""
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
        constraint = self._constraint(free.basis, same - step[: same.size])
        return [
            self._shaped(problem.minimum_from(start))
            if constraint is None
            else problem.constrained_minimum(constraint, start)
        ]

    def _shaped(self, minimum: Minimum) -> Minimum:
        """Optimise with a constraint on the shape of the curve, if the curve violates it."""
        problem, b = minimum.problem, minimum.curve
        constraint = problem.constraint or self._constraint(problem.model.basis, b)
        if constraint is None or constraint is problem.constraint or not constraint.shortfall(b).any():
            return minimum
        return problem.constrained_minimum(constraint, minimum.parameters)

    def _constraint(self, basis: WorkingBasis, b: Array) -> CurveConstraint | None:
        """Return the constraint for a curve b, if any."""
        if self.shape == "free" or (self.shape == "auto" and deepest_fall(basis, b) <= NOTABLE_FALL):
            return None
        return shape_constraint(basis, b, self.shape)


def _best(problem: Problem, starts: Sequence[Array]) -> Array:
    """Return the end of a rough search from the best of some starting points."""
    if len(starts) == 1:
        return starts[0]
    guides = [replace(problem, tolerance=_GUIDE).minimum_from(start) for start in starts]
    return min(guides, key=lambda guide: guide.cost).parameters


def _like(full_lag: Minimum, dynamics: FadingLag, weights: Array) -> Minimum:
    """Return LPF1's minimum as parameters of a law that fades, with weights (R,) of the rows."""
    model = full_lag.problem.model.with_dynamics(dynamics).weighted(weights)
    same = np.append(full_lag.parameters[:-1], dynamics.like_full_lag(model, full_lag.parameters))
    return Problem(model, full_lag.problem.constraint).at(same, "LPF1's solution: no fading of the lag is better")


def _lag_of(model: ForceModel) -> float | None:
    """Return the best single lag [s] behind a curve; None for a law without lag."""
    if isinstance(model.dynamics, NoLag):
        return None
    return float(best_lag(model, model.dynamics.limits.time_constant)[-1])


def _through_knots(basis: WorkingBasis) -> str:
    count = basis.to_curve.shape[0]
    return (
        f"the curve rises through {count} knots, dense at low speed, instead of following polynomials (--curve knots)"
    )


def _order_note(order: int, requested: int | None) -> str:
    why = "as requested" if requested else "cross-validation finds no benefit of a higher order"
    return f"inner polynomial of order {order} instead of {INNER_ORDER}: {why}"
