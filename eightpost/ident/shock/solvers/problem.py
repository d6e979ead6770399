"""The nonlinear least-squares problem of the joint recipe, and where the optimiser ended."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from eightpost.ident.shock.force.linear import solved
from eightpost.ident.shock.solvers.solution import Solution
from eightpost.ident.shock.solvers.uncertainty import covariance
from eightpost.ident.shock.solvers.walled import Walls, least_squares_between

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.curve.shape import Hold
    from eightpost.ident.shock.force.force_model import ForceModel

    Array = NDArray[np.float64]

#: Of the residual; a curve at the edge of falling needs many.
_EVALUATIONS = 200

#: Share of the sum of squares that a step must win for another one.
TOLERANCE = 1e-6

#: A curve that leans on its hold by 1 N counts, in the uncertainty, as a force error of so many N all along.
_STIFF = 10.0


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Weighted force error of a model at the rows.

    Attributes:
        model: Of the force.
        hold: What its curve is held to, if anything.
        tolerance: Share of the sum of squares that a step must win for another one.
    """

    model: ForceModel
    hold: Hold | None = None
    tolerance: float = TOLERANCE

    def residual(self, parameters: Array) -> Array:
        """Return the weighted force error (R,) [N]."""
        runs = self.model.runs
        return np.asarray(np.sqrt(runs.weights) * (self.model.rows(parameters) - runs.target))

    def jacobian(self, parameters: Array) -> Array:
        """Return the derivative (R, n + g + k) of `residual`."""
        return np.asarray(np.sqrt(self.model.runs.weights)[:, None] * self.model.rows_jacobian(parameters))

    def at(self, parameters: Array, status: str) -> Minimum:
        """Return parameters that are taken as they are."""
        return Minimum(self, parameters, self.residual(parameters), self.jacobian(parameters), True, status)

    def followed(self, start: Array) -> Minimum:
        """Follow a start (n + g + k,) to its minimum, all parameters at once; a linear problem is solved.

        Nothing is held.
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

    def held(self, hold: Hold, start: Array) -> Minimum:
        """Follow a start (n + g + k,) to the minimum whose curve keeps what it is held to."""
        problem, (low, high) = replace(self, hold=hold), self.model.bounds()
        matrix = np.zeros((hold.floor.size, low.size))
        matrix[:, : self.model.curve_count] = hold.matrix
        ended = least_squares_between(
            self.residual,
            self.jacobian,
            np.clip(start, low, high),
            Walls(matrix, hold.floor + hold.clear).and_bounds(low, high),
            tolerance=self.tolerance,
            evaluations=_EVALUATIONS,
        )
        return replace(problem.at(np.clip(ended.x, low, high), ended.status), converged=ended.converged)


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
        """Sum of squares of the force error at the rows [N2]."""
        return float(self.residual @ self.residual)

    @property
    def curve(self) -> Array:
        """Its curve b (n,)."""
        return self.parameters[: self.problem.model.curve_count]

    @property
    def leans(self) -> bool:
        """Whether the curve leans on what it is held to."""
        return bool(len(self._touched()))

    def solution(self, notes: tuple[str, ...]) -> Solution:
        """Return what the recipe hands back, with its notes."""
        model = self.problem.model
        spread = covariance(np.vstack([self.jacobian, self._stiff()]), self.residual, model.runs)
        return Solution(model, self.parameters, spread, self.converged, self.status, notes)

    def _touched(self) -> Array:
        hold = self.problem.hold
        return np.empty((0, self.curve.size)) if hold is None else hold.touched(self.curve)

    def _stiff(self) -> Array:
        """Return rows (T, n + g + k) that keep the curve from moving where it leans on what it is held to."""
        touched = self._touched()
        rows = np.zeros((len(touched), self.parameters.size))
        rows[:, : self.curve.size] = _STIFF * np.sqrt(self.residual.size) * touched
        return rows
