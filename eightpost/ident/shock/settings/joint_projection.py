"""Force error over all settings of a shock with the law `hysteresis`, minimised over the curves of each setting."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.hysteresis_search import Projected, Projection, non_negative
from eightpost.ident.shock.settings.joint import JointModel
from eightpost.shock.curve import KNOTS

#: Share of the diagonal that is added to normal equations, for directions that no row determines.
_REGULAR = 1e-12


@dataclass(frozen=True, eq=False)
class JointProjection:
    """Force error over all settings, minimised over the curves and offsets of each setting.

    The parameters of the search are those of the states (3,) or (5,), then the force of the stop at its yield travel if
    the settings share one, and the weight of the gas stiffness if it is fitted, both as shares of the force's standard
    deviation.

    Attributes:
        parts: Force error of each setting.
        deviation: Standard deviation of the force [N].
        has_own_stop: Whether each setting has a stop of its own stiffness.
    """

    parts: tuple[Projection, ...]
    deviation: float
    has_own_stop: bool = False

    @classmethod
    def of(cls, model: JointModel, *, is_thin: bool, has_own_stop: bool = False) -> JointProjection:
        """Return the problem of a joint model."""
        parts = tuple(Projection(one, is_thin=is_thin) for one in model.models)
        return cls(parts, model.runs.deviation, has_own_stop)

    @cached_property
    def shared(self) -> NDArray[np.intp]:
        """The places of the linear parameters that all settings share."""
        first = self.parts[0]
        has_stop = first.dynamics.has_stop and not self.has_own_stop
        stop, stiffness = [2 * KNOTS] * has_stop, [-1] * bool(first.model.gas.size)
        return np.array([*stop, *stiffness], dtype=np.intp)

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest parameters."""
        low, high = self.parts[0].dynamics.state_bounds()
        return np.append(low, np.zeros(self.shared.size)), np.append(high, np.full(self.shared.size, np.inf))

    def at(self, parameters: Array) -> JointPoint:
        """Return the minimum over the curves and offsets of all settings."""
        count = parameters.size - self.shared.size
        forces = self.deviation * parameters[count:]
        return JointPoint(
            self, parameters, tuple(self.at_states(part, parameters[:count], forces) for part in self.parts)
        )

    def at_states(self, part: Projection, parameters: Array, forces: Array) -> Projected:
        """Return the minimum over the curves and offsets of a setting.

        Args:
            part: Force error of the setting.
            parameters: Parameters of the states (3,) or (5,).
            forces: Linear parameters that all settings share [N].
        """
        states = part.states_at(parameters)
        columns, shared, own = part.columns_of(states), self.shared, self.own(part)
        weights, target = part.model.runs.weights, part.model.runs.target
        gram = (weights[:, None] * columns).T @ columns + part.penalty.T @ part.penalty
        towards = columns[:, own].T @ (weights * (target - columns[:, shared] @ forces))
        linear = np.zeros(columns.shape[1])
        linear[own] = non_negative(gram[np.ix_(own, own)], towards, part.is_free[own])
        linear[shared] = forces
        return Projected(part, states, linear, columns, gram)

    def own(self, part: Projection) -> NDArray[np.bool_]:
        """Return whether each linear parameter of a setting belongs to it alone."""
        own = np.ones(part.is_free.size, dtype=bool)
        own[self.shared] = False
        return own


@dataclass(frozen=True, eq=False)
class JointPoint:
    """The minimum over the curves of all settings for given shared parameters.

    Attributes:
        problem: Problem that was minimised.
        parameters: Shared parameters.
        parts: Minimum of each setting.
    """

    problem: JointProjection
    parameters: Array
    parts: tuple[Projected, ...]

    @cached_property
    def cost(self) -> float:
        """Sum of squares of the weighted force errors and of the penalties [N2]."""
        return sum(part.cost for part in self.parts)

    @cached_property
    def normal_equations(self) -> tuple[Array, Array]:
        """Matrix (n, n) and right side (n,) for a step of the shared parameters, which the free curves follow."""
        pairs = [self._equations(part) for part in self.parts]
        return np.sum([matrix for matrix, _ in pairs], axis=0), np.sum([right for _, right in pairs], axis=0)

    def _equations(self, part: Projected) -> tuple[Array, Array]:
        problem, shared, size = part.problem, self.problem.shared, self.problem.deviation
        changes = np.hstack([part.by_states, size * part.columns[:, shared]])
        weighted = problem.model.runs.weights[:, None] * changes
        used = ~part.is_fixed & self.problem.own(problem)
        across, gram = weighted.T @ part.columns[:, used], part.gram[np.ix_(used, used)]
        gram = gram + _REGULAR * float(np.diag(gram).max()) * np.eye(len(gram))
        count = part.parameters.size
        penalty = np.zeros((len(problem.unevenness) + len(problem.penalty), changes.shape[1]))
        penalty[: len(problem.unevenness), :count] = problem.unevenness
        penalty[len(problem.unevenness) :, count:] = size * problem.penalty[:, shared]
        matrix = weighted.T @ changes - across @ np.linalg.solve(gram, across.T) + penalty.T @ penalty
        return matrix, -weighted.T @ part.error - penalty.T @ (penalty @ self.parameters)
