"""Joint fit of the law `hysteresis` over settings: two curves of each setting, and a lag and a stop of all.

For given lag and stop the force is linear in the slopes of both curves, and every setting has curves of its own. So the
search is over the parameters that all settings share, and the curves of each setting follow from non-negative least
squares: no curve falls, and the law is passive at every setting.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.hysteresis import Found, Projected, Projection, minimum_from, non_negative
from eightpost.ident.shock.hysteresis_fit import HysteresisFit, search_coordinates
from eightpost.ident.shock.problem import covariances
from eightpost.ident.shock.robust import Robust, nearly_equal, weights_for
from eightpost.ident.shock.settings.joint import JointFit, JointModel
from eightpost.shock.curve import KNOTS

#: Tolerance and maximum number of evaluations of a search, and maximum number of reweightings.
_TOLERANCE, _EVALUATIONS, _WEIGHINGS = 1e-5, 40, 3

#: In the covariance, a parameter at its bound is fixed: a change by 1 N counts like a force error of this many N.
_STIFF = 10.0

#: Share of the diagonal that is added to normal equations, for directions that no row determines.
_REGULAR = 1e-12


@dataclass(frozen=True, eq=False)
class JointProjection:
    """Force error over all settings, minimised over the curves and offsets of each setting.

    The parameters of the search are those of the states (3,) or (5,), then the force of the stop at its yield travel if
    there is one, and the weight of the gas stiffness if it is fitted, both as shares of the force's standard deviation.
    """

    parts: tuple[Projection, ...]  #: Force error of each setting.
    deviation: float  #: Standard deviation of the force [N].

    @classmethod
    def of(cls, model: JointModel, *, is_thin: bool) -> JointProjection:
        """Return the problem of a joint model."""
        return cls(tuple(Projection(one, is_thin=is_thin) for one in model.models), model.runs.deviation)

    @cached_property
    def shared(self) -> NDArray[np.intp]:
        """The places of the linear parameters that all settings share."""
        first = self.parts[0]
        stop, stiffness = [2 * KNOTS] * first.dynamics.has_stop, [-1] * bool(first.model.gas.size)
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
    """The minimum over the curves of all settings for given shared parameters."""

    problem: JointProjection  #: Problem that was minimised.
    parameters: Array  #: Shared parameters.
    parts: tuple[Projected, ...]  #: Minimum of each setting.

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


def fit_lagged(model: JointModel, first: HysteresisFit, robust: Robust) -> JointFit:
    """Fit the curves of all settings together, with a lag and a stop that they share.

    Args:
        model: Model of all settings with the dynamics of the first fit.
        first: Fit to the setting with the largest force, from which the search starts.
        robust: Treatment of outliers.
    """
    found, model = _searched(model, first, weights_for(robust))
    end, notes = found.end, [first.stop_note] * bool(first.stop_note) + ["both curves depend on the setting"]
    x = np.zeros(model.size)
    for part, place in zip(end.parts, model.places, strict=True):
        x[place] = np.linalg.solve(
            np.vstack(search_coordinates(part.problem.model)), np.append(part.linear, part.parameters)
        )
    spread = _covariances(model, x, end)
    return JointFit(model, x, spread, found.converged, found.status, (*first.notes, *notes))


def _searched(
    model: JointModel, first: HysteresisFit, weigh: Callable[[Array, float], Array] | None
) -> tuple[Found[JointPoint], JointModel]:
    """Return the minimum on the whole records with weights that follow its residuals, and the model with them."""
    problem = JointProjection.of(model, is_thin=True)
    start = np.append(first.found.end.parameters, _start_forces(problem, first))
    found = minimum_from(problem, start, tolerance=_TOLERANCE, evaluations=_EVALUATIONS)
    for _ in range(_WEIGHINGS if weigh else 0):
        assert weigh is not None
        pairs = zip(found.end.parts, model.models, strict=True)
        weights = np.concatenate([weigh(part.error, one.runs.deviation) for part, one in pairs])
        if nearly_equal(weights, model.runs.weights):
            break
        model = model.weighted(weights)
        problem = JointProjection.of(model, is_thin=True)
        found = minimum_from(problem, found.end.parameters, tolerance=_TOLERANCE, evaluations=_EVALUATIONS)
    problem = JointProjection.of(model, is_thin=False)
    return minimum_from(problem, found.end.parameters, tolerance=_TOLERANCE, evaluations=_EVALUATIONS), model


def _start_forces(problem: JointProjection, first: HysteresisFit) -> Array:
    """Return the shared forces of the first fit, as shares of the force's standard deviation of all settings."""
    gas = first.model.gas
    stiffness = float(first.found.end.linear[-1]) / gas.size if gas.size else 0.0  # [N/m]
    common = problem.parts[0].model.gas.size
    forces = [float(first.found.end.linear[2 * KNOTS])] if problem.parts[0].dynamics.has_stop else []
    return np.array([*forces, *([stiffness * common] if common else [])]) / problem.deviation


def _covariances(model: JointModel, x: Array, end: JointPoint) -> Array:
    """Return the covariances (3, n, n) of x; what is at a bound is fixed."""
    rows: list[Array] = []
    stiff: list[Array] = []
    slopes: list[tuple[Array, Array]] = []
    uneven: list[tuple[Array, Array]] = []
    low, high = end.problem.parts[0].bounds()
    size = _STIFF * np.sqrt(model.runs.target.size)
    for part, place in zip(end.parts, model.places, strict=True):
        one, problem = part.problem.model, part.problem
        to_linear, to_states = search_coordinates(one)
        at_bound = (part.parameters <= low) | (part.parameters >= high)
        root = np.sqrt(one.runs.weights)[:, None]
        rows.append(_scattered(root * one.rows_jacobian(x[place]), place, model.size))
        slopes.append((_scattered(problem.penalty @ to_linear, place, model.size), problem.penalty @ part.linear))
        unevenness = _scattered(problem.unevenness @ to_states, place, model.size)
        uneven.append((unevenness, problem.unevenness @ part.parameters))
        stiff.append(_scattered(size * to_linear[part.is_fixed], place, model.size))
        stiff.append(_scattered(size * one.runs.deviation * to_states[at_bound], place, model.size))
    groups = (slopes, uneven)
    jacobian = np.vstack([*rows, *(matrix for group in groups for matrix, _ in group), *stiff])
    penalties = tuple(np.concatenate([values for _, values in group]) for group in groups)
    error = np.concatenate([np.sqrt(part.problem.model.runs.weights) * part.error for part in end.parts])
    return covariances(jacobian, error, model.runs, penalties)


def _scattered(rows: Array, place: NDArray[np.intp] | Array, size: int) -> Array:
    found = np.zeros((len(rows), size))
    found[:, place] = rows
    return found
