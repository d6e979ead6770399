"""The nonlinear least-squares problem of the joint recipe, and where the optimiser ended."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from eightpost.ident.shock.force.linear import solved
from eightpost.ident.shock.solvers.solution import Solution
from eightpost.ident.shock.solvers.uncertainty import covariance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.shape import Hold
    from eightpost.ident.shock.force.force_model import ForceModel

    Array = NDArray[np.float64]

#: Of the residual; a curve at the edge of falling needs many.
_EVALUATIONS = 200

#: How often the margin of a held curve is widened until it keeps what it is held to.
_WIDENINGS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Weighted force error of a model at the rows, and a price on a curve that does what it must not.

    Attributes:
        model: Of the force.
        hold: The price, if any.
    """

    model: ForceModel
    hold: Hold | None = None

    def residual(self, parameters: Array) -> Array:
        """Return the weighted force error (R,) [N], then the priced violations of the curve."""
        runs = self.model.runs
        error = np.sqrt(runs.weights) * (self.model.rows(parameters) - runs.target)
        if self.hold is None:
            return np.asarray(error)
        return np.append(error, self.hold.residual(parameters[: self.model.curve_count]))

    def jacobian(self, parameters: Array) -> Array:
        """Return the derivative of `residual`."""
        by_force = np.sqrt(self.model.runs.weights)[:, None] * self.model.rows_jacobian(parameters)
        if self.hold is None:
            return np.asarray(by_force)
        n = self.model.curve_count
        by_hold = np.zeros((self.hold.matrix.shape[0], parameters.size))
        by_hold[:, :n] = self.hold.jacobian(parameters[:n])
        return np.vstack([by_force, by_hold])

    def at(self, parameters: Array, status: str) -> Minimum:
        """Return parameters that are taken as they are."""
        return Minimum(self, parameters, self.residual(parameters), self.jacobian(parameters), True, status)

    def followed(self, start: Array, *, tolerance: float = 1e-6) -> Minimum:
        """Follow a start to its minimum, all parameters at once; a linear problem is solved.

        Args:
            start: (n + g + k,).
            tolerance: Share of the sum of squares that a step must win for another one.
        """
        if not self.model.dynamics.names and self.hold is None and not self.model.gas.size:
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
            ftol=tolerance,
            xtol=10.0 * tolerance,
            gtol=1e-8,
            max_nfev=_EVALUATIONS,
        )
        status = f"{result.message} {result.nfev} evaluations."
        return Minimum(self, result.x, result.fun, np.asarray(result.jac), result.status > 0, status)

    def held(self, hold: Hold, *starts: Array) -> Minimum:
        """Follow starts with a price on the curve; widen its margin until the curve keeps what it is held to."""
        problem = replace(self, hold=hold)
        minimum = min((problem.followed(start) for start in starts), key=lambda m: m.cost)
        for _ in range(_WIDENINGS):
            short = hold.shortfall(minimum.parameters[: self.model.curve_count])
            if not short.any():
                break
            hold = replace(hold, margin=hold.margin + 1.5 * short)
            minimum = replace(self, hold=hold).followed(minimum.parameters)
        return minimum


@dataclass(frozen=True, slots=True, eq=False)
class Minimum:
    """Where the optimiser ended.

    Attributes:
        problem: What was minimised.
        parameters: (n + g + k,).
        residual: There [N].
        jacobian: Of the residual, there.
        converged: Whether it is a minimum.
        status: In words.
    """

    problem: Problem
    parameters: Array
    residual: Array
    jacobian: Array
    converged: bool
    status: str

    @property
    def cost(self) -> float:
        """Sum of squares of the force error at the rows, what holds the curve left out [N2]."""
        error = self.residual[: self.problem.model.runs.weights.size]
        return float(error @ error)

    def solution(self, notes: tuple[str, ...]) -> Solution:
        """Return what the recipe hands back, with its notes."""
        model = self.problem.model
        spread = covariance(self.jacobian, self.residual, model.runs)
        return Solution(model, self.parameters, spread, self.converged, self.status, notes)
