"""The nonlinear least-squares problem of the joint recipe, and its minimum."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from eightpost.ident.shock.force.linear import solved
from eightpost.ident.shock.solvers.solution import Solution
from eightpost.ident.shock.solvers.uncertainty import covariance
from eightpost.ident.shock.solvers.walled import Inequalities, constrained_least_squares

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.shape import CurveConstraint
    from eightpost.ident.shock.force.force_model import ForceModel

    Array = NDArray[np.float64]

#: Maximum number of evaluations of the residual; a curve at its constraint needs many.
_EVALUATIONS = 200

#: Relative decrease of the sum of squares below which the search stops.
TOLERANCE = 1e-6

#: In the covariance, a violation of an active constraint by 1 N counts like a force error of this many N everywhere.
_STIFF = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Weighted force error of a model at the rows.

    Attributes:
        model: Model of the force.
        constraint: Constraint on the curve, if any.
        tolerance: Relative decrease of the sum of squares below which the search stops.
    """

    model: ForceModel
    constraint: CurveConstraint | None = None
    tolerance: float = TOLERANCE

    def residual(self, parameters: Array) -> Array:
        """Return the weighted force error (R,) [N]."""
        runs = self.model.runs
        return np.asarray(np.sqrt(runs.weights) * (self.model.rows(parameters) - runs.target))

    def jacobian(self, parameters: Array) -> Array:
        """Return the derivative (R, n + g + k) of `residual`."""
        return np.asarray(np.sqrt(self.model.runs.weights)[:, None] * self.model.rows_jacobian(parameters))

    def at(self, parameters: Array, status: str) -> Minimum:
        """Return given parameters as a minimum, without a search."""
        return Minimum(self, parameters, self.residual(parameters), self.jacobian(parameters), True, status)

    def minimum_from(self, start: Array) -> Minimum:
        """Optimise all parameters from a start (n + g + k,), without constraints on the curve.

        A linear problem is solved directly.
        """
        if not self.model.dynamics.names and not self.model.gas.size:
            columns = np.hstack([self.model.curve_rows(), self.model.gas_rows])
            runs = self.model.runs
            return self.at(solved(columns, runs.target, runs.weights), "linear least squares")
        low, high = self.model.bounds()
        result = least_squares(
            self.residual,
            np.clip(start, low, high),
            jac=self.jacobian,
            bounds=(low, high),
            x_scale=self.model.scale(),
            ftol=self.tolerance,
            xtol=10.0 * self.tolerance,
            gtol=1e-8,
            max_nfev=_EVALUATIONS,
        )
        status = f"{result.message} {result.nfev} evaluations."
        return Minimum(self, result.x, result.fun, np.asarray(result.jac), result.status > 0, status)

    def constrained_minimum(self, constraint: CurveConstraint, start: Array) -> Minimum:
        """Optimise all parameters from a start (n + g + k,) with a constraint on the curve."""
        problem, (low, high) = replace(self, constraint=constraint), self.model.bounds()
        matrix = np.zeros((constraint.floor.size, low.size))
        matrix[:, : self.model.curve_count] = constraint.matrix
        ended = constrained_least_squares(
            self.residual,
            self.jacobian,
            np.clip(start, low, high),
            Inequalities(matrix, constraint.floor + constraint.clear).and_bounds(low, high),
            tolerance=self.tolerance,
            evaluations=_EVALUATIONS,
        )
        return replace(problem.at(np.clip(ended.x, low, high), ended.status), converged=ended.converged)


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """The end of a search.

    Attributes:
        problem: Problem that was minimised.
        parameters: Parameters (n + g + k,) at the minimum.
        residual: Residual at the minimum [N].
        jacobian: Jacobian of the residual at the minimum.
        converged: Whether it is a minimum.
        status: Description of how the search ended.
    """

    problem: Problem
    parameters: Array
    residual: Array
    jacobian: Array
    converged: bool
    status: str

    @property
    def cost(self) -> float:
        """Sum of squares of the force error at the rows [N2]."""
        return float(self.residual @ self.residual)

    @property
    def curve(self) -> Array:
        """The curve's coefficients b (n,)."""
        return self.parameters[: self.problem.model.curve_count]

    @property
    def is_constrained(self) -> bool:
        """Whether constraints on the curve are active."""
        return bool(len(self._active_rows()))

    def solution(self, notes: tuple[str, ...]) -> Solution:
        """Return the solution with notes."""
        model = self.problem.model
        spread = covariance(np.vstack([self.jacobian, self._stiff()]), self.residual, model.runs)
        return Solution(model, self.parameters, spread, self.converged, self.status, notes)

    def _active_rows(self) -> Array:
        constraint = self.problem.constraint
        return np.empty((0, self.curve.size)) if constraint is None else constraint.active_rows(self.curve)

    def _stiff(self) -> Array:
        """Return rows (T, n + g + k) that fix the curve in the directions of its active constraints."""
        touched = self._active_rows()
        rows = np.zeros((len(touched), self.parameters.size))
        rows[:, : self.curve.size] = _STIFF * np.sqrt(self.residual.size) * touched
        return rows
