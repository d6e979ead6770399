"""The nonlinear least-squares problem of the joint recipe, and where the optimiser ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from eightpost.ident.shock.solution import Solution, covariance, independent_samples

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.shock.force_model import ForceModel

    Array = NDArray[np.float64]

#: Of the residual; a curve at the edge of falling needs many.
_EVALUATIONS = 200


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Force error of a model through the record's low-pass, and a price on a falling curve.

    Attributes:
        model: Of the force.
        fall_weight: What a fall of the curve by 1 N from one grid point to the next adds to the residual [1].
    """

    model: ForceModel
    fall_weight: float = 0.0

    def residual(self, parameters: Array) -> Array:
        """Return the filtered force error [N], then the weighted falls of the curve [N]."""
        model = self.model
        error = model.prepared.filtered(model.force(parameters))[model.rows] - model.target
        return np.append(error, self.fall_weight * np.minimum(self._rises(parameters), 0.0))

    def jacobian(self, parameters: Array) -> Array:
        """Return the derivative of `residual`."""
        model = self.model
        by_force = model.prepared.filtered(model.jacobian(parameters).T).T[model.rows]
        falling = np.where(self._rises(parameters) < 0.0, self.fall_weight, 0.0)
        by_falls = np.zeros((falling.size, parameters.size))
        by_falls[:, : model.curve_count] = falling[:, None] * model.basis.rises
        return np.vstack([by_force, by_falls])

    def deepest_fall(self, parameters: Array) -> float:
        """Return the most that the curve falls while the velocity rises, over its whole range of force [1]."""
        force = np.append(0.0, np.cumsum(self._rises(parameters)))
        return float((np.maximum.accumulate(force) - force).max() / np.ptp(force))

    def at(self, parameters: Array, status: str) -> Minimum:
        """Return parameters that are taken as they are."""
        return Minimum(self, parameters, self.residual(parameters), self.jacobian(parameters), True, status)

    def followed(self, start: Array) -> Minimum:
        """Follow a start to its minimum, all parameters at once, with the closed-form Jacobian."""
        low, high = self.model.bounds()
        result = least_squares(
            self.residual,
            np.clip(start, low, high),
            jac=self.jacobian,
            bounds=(low, high),
            x_scale=self.model.scale(),
            ftol=1e-6,
            xtol=1e-5,
            gtol=1e-8,
            max_nfev=_EVALUATIONS,
        )
        status = f"{result.message} {result.nfev} evaluations."
        return Minimum(self, result.x, result.fun, np.asarray(result.jac), result.status > 0, status)

    def _rises(self, parameters: Array) -> Array:
        return self.model.basis.rises @ parameters[: self.model.curve_count]


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
        """Sum of squares of the residual [N2]."""
        return float(self.residual @ self.residual)

    def solution(self, notes: tuple[str, ...]) -> Solution:
        """Return what the recipe hands back, with its notes."""
        model = self.problem.model
        spread = covariance(self.jacobian, self.residual, independent_samples(model))
        return Solution(model, self.parameters, spread, self.converged, self.status, notes)
