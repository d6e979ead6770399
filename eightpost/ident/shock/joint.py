"""Joint fit of all files of a shock: a curve for each setting, on the same knots, and one law for all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.curve import CELLS, KnotBasis, basis_on
from eightpost.ident.shock.dynamics import projected
from eightpost.ident.shock.fit import fit_of
from eightpost.ident.shock.force import Dynamics, ForceModel, GasColumns, gas_columns
from eightpost.ident.shock.hysteresis import (
    Found,
    HysteresisFit,
    Projected,
    Projection,
    minimum_from,
    non_negative,
    search_coordinates,
)
from eightpost.ident.shock.law_fit import Choices, FittedLaw, LawFit, Robust, has_own_recipe, nearly_equal, weights_for
from eightpost.ident.shock.problem import (
    CLEAR_SLOPE,
    TOLERANCE,
    Inequalities,
    Solution,
    constrained_least_squares,
    covariances,
    quantile,
    standard_error,
)
from eightpost.ident.shock.runs import Runs
from eightpost.shock import LAWS, Port, ShockLaw, fit_parameters, own_parameters
from eightpost.shock.curve import KNOTS

# ==== Model of all files, and its fit ================================================================================

#: A slope times the highest speed is at its constraint within this share of the force's standard deviation; in the
#: covariance, a violation of the constraint by 1 N then counts like a force error of this many N everywhere.
_AT_CONSTRAINT, _STIFF = 1e-3, 10.0


@dataclass(frozen=True, eq=False)
class JointModel:
    """Force models of all settings, with their shared parameters.

    Parameters x: for each setting its slopes (K,), gas offsets and own elements of theta, then the shared gas stiffness
    if it is fitted, then the rest of the law's theta, which all settings share.
    """

    models: tuple[ForceModel, ...]  #: Force model of each setting; all have the same knots and the same dynamics.
    local: int = 0  #: Number of leading elements of theta that each setting has for itself.

    @property
    def dynamics(self) -> Dynamics:
        """The dynamics of the law."""
        return self.models[0].dynamics

    @property
    def basis(self) -> KnotBasis:
        """The knots of all curves."""
        found = self.models[0].basis.curve
        assert isinstance(found, KnotBasis)
        return found

    @cached_property
    def places(self) -> tuple[Array, ...]:
        """The indices in x of each model's parameters, in the model's own order."""
        start, local, own, has_stiffness = 0, [], [], self.models[0].gas.size is not None
        for model in self.models:
            count = model.curve_count + model.gas.offsets
            local.append(np.arange(start, start + count))
            own.append(np.arange(start + count, start + count + self.local))
            start += count + self.local
        stiffness = [np.array([start])] if has_stiffness else []
        start += has_stiffness
        theta = start + np.arange(len(self.dynamics.names))
        return tuple(
            np.concatenate([curve, *stiffness, mine, theta]).astype(int) for curve, mine in zip(local, own, strict=True)
        )

    @cached_property
    def size(self) -> int:
        """Number of parameters."""
        return int(max(place.max() for place in self.places)) + 1

    @cached_property
    def runs(self) -> Runs:
        """All runs, in the order of the settings."""
        found = Runs.of([p for model in self.models for p in model.runs.prepared])
        return found.weighted(np.concatenate([model.runs.weights for model in self.models]))

    def error(self, x: Array) -> Array:
        """Return the force error (R,) [N] without weights."""
        return np.concatenate([m.rows(x[p]) - m.runs.target for m, p in zip(self.models, self.places, strict=True)])

    def residual(self, x: Array) -> Array:
        """Return the weighted force errors, followed by the penalties of the curves [N]."""
        penalties = [m.penalty @ x[p[: m.curve_count]] for m, p in zip(self.models, self.places, strict=True)]
        return np.concatenate([np.sqrt(self.runs.weights) * self.error(x), *penalties])

    def jacobian(self, x: Array) -> Array:
        """Return the derivative of `residual` by x."""
        rows, penalties = [], []
        for model, place in zip(self.models, self.places, strict=True):
            slopes = np.zeros((model.runs.target.size, self.size))
            slopes[:, place] = np.sqrt(model.runs.weights)[:, None] * model.rows_jacobian(x[place])
            penalty = np.zeros((len(model.penalty), self.size))
            penalty[:, place[: model.curve_count]] = model.penalty
            rows.append(slopes)
            penalties.append(penalty)
        return np.vstack([*rows, *penalties])

    def inequalities(self) -> Inequalities:
        """Return the constraints: no slope is negative, theta within its bounds."""
        slopes = np.concatenate([place[: self.models[0].curve_count] for place in self.places])
        return Inequalities(np.eye(self.size)[slopes], np.full(slopes.size, CLEAR_SLOPE)).and_bounds(*self.bounds())

    def active_rows(self, x: Array) -> Array:
        """Return rows that fix x in the directions of its active constraints, for its covariance."""
        inequalities = self.inequalities()
        size = np.linalg.norm(inequalities.matrix, axis=1)
        touched = inequalities.room(x) < _AT_CONSTRAINT * self.runs.deviation * size
        return np.asarray(_STIFF * np.sqrt(self.runs.target.size) * inequalities.matrix[touched])

    def bounds(self) -> tuple[Array, Array]:
        """Return the lowest and the highest x."""
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for model, place in zip(self.models, self.places, strict=True):
            low[place], high[place] = model.bounds()
        return low, high

    def weighted(self, weights: Array) -> JointModel:
        """Return the model with other weights (R,) of the rows."""
        ends = np.cumsum([m.runs.target.size for m in self.models])[:-1]
        parts = zip(self.models, np.split(weights, ends), strict=True)
        return replace(self, models=tuple(model.weighted(part) for model, part in parts))


@dataclass(frozen=True, slots=True, eq=False)
class JointFit:
    """The curves of all settings and their law."""

    model: JointModel  #: Model of all settings.
    x: Array  #: Parameters.
    covariance: Array  #: Covariances (3, n, n) of x, see `covariances`.
    converged: bool  #: Whether the search ended at a minimum.
    status: str  #: Description of how the search ended.
    notes: tuple[str, ...]  #: Notes on the choices of the fit, one sentence each.

    def solution(self, number: int) -> Solution:
        """Return the part of the solution that belongs to a setting."""
        place = self.model.places[number]
        spread = self.covariance[:, place[:, None], place]
        return Solution(self.model.models[number], self.x[place], spread, self.converged, self.status)

    def slopes(self, number: int) -> Array:
        """Return the slopes (25,) [N.s/m] of a setting's curve at the knots of `StaticCurve`."""
        model, b = self.model.models[number], self._part(number)[0]
        return self.model.basis.subdivided(model.basis.to_curve @ b)[2]

    def lagged_slopes(self, number: int) -> Array | None:
        """Return the slopes (25,) [N.s/m] of the lagged part of a setting's curve; None for a law without one."""
        theta = self._part(number)[2]
        return np.maximum(theta[:KNOTS], 0.0) / self.model.basis.speed if self.model.local else None

    def law(self, number: int) -> ShockLaw:
        """Return the law of a setting, with the gas force of its records."""
        model = self.model.models[number]
        b, g, theta = self._part(number)
        preload, stiffness = model.gas.values(g)
        curve = self.model.basis.static_curve(model.basis.to_curve @ b)
        return self.model.dynamics.law(curve, Port(gas_preload=preload, gas_stiffness=stiffness), theta)

    def half_width(self, number: int) -> Array:
        """Return the half-width (25,) [N] of the 95 % band of a setting's curve at the knots of `StaticCurve`."""
        model, place = self.model.models[number], self.model.places[number]
        here = place[: model.curve_count]
        velocity = self.model.basis.subdivided(np.zeros(self.model.basis.count))[0]
        errors = standard_error(model.basis.at(velocity), self.covariance[:, here[:, None], here])
        return quantile(model.runs) * errors

    def _part(self, number: int) -> tuple[Array, Array, Array]:
        return self.model.models[number].split(self.x[self.model.places[number]])


# ==== The fit ========================================================================================================

#: Laws that can be fitted: their parameters are numbers with bounds of their own, or the law has a recipe of its own.
_OVER_SETTINGS = tuple(
    name
    for name, law in LAWS.items()
    if own_parameters(law) == tuple(p.name for p in fit_parameters(law)) or has_own_recipe(name)
)

#: Maximum number of evaluations of the residual, and of reweightings.
_EVALUATIONS, _WEIGHINGS = 100, 2


def fit_jointly(groups: Sequence[Runs], law: str, choices: Choices) -> JointFit:
    """Fit one law with a curve for each setting.

    The search for the parameters of the law starts on the setting with the largest force.

    Args:
        groups: Runs of each setting.
        law: Name of the law.
        choices: Options.

    Raises:
        ParameterError: The law cannot be fitted over settings.
    """
    hardest = max(groups, key=lambda runs: runs.deviation)
    if law not in _OVER_SETTINGS:
        known = ", ".join(_OVER_SETTINGS)
        raise ParameterError(
            f"law {law!r} cannot be fitted over settings, because its file does not declare how its own parameters are "
            f"fitted; use one of {known}"
        )
    first = fit_of(hardest, law, choices).fit
    if not isinstance(first, LawFit):
        return _fit_lagged(groups, first, choices)
    minimum = first.minimum
    theta = minimum.problem.model.split(minimum.parameters)[2]
    gas, notes = gas_columns(Runs.of([p for runs in groups for p in runs.prepared]), choices.gas)
    model = _joint_model(groups, gas, minimum.problem.model.dynamics)
    model, x, converged, status = _searched(model, _start(model, theta), choices)
    spread = covariances(np.vstack([model.jacobian(x), model.active_rows(x)]), model.error(x), model.runs)
    return JointFit(model, x, spread, converged, status, (*first.notes, *notes))


def _fit_lagged(groups: Sequence[Runs], first: FittedLaw, choices: Choices) -> JointFit:
    assert isinstance(first, HysteresisFit)
    gas, notes = gas_columns(Runs.of([p for runs in groups for p in runs.prepared]), choices.gas)
    model = replace(_joint_model(groups, gas, first.model.dynamics, cells=KNOTS // 2), local=KNOTS)
    fit = fit_lagged(model, first, choices.robust)
    return replace(fit, notes=(*fit.notes, *notes))


def _joint_model(groups: Sequence[Runs], gas: GasColumns, dynamics: Dynamics, cells: int = CELLS) -> JointModel:
    fastest = np.concatenate([runs.velocity[runs.inside] for runs in groups])
    knots = KnotBasis.of(fastest, cells=cells)
    models, start, offset = [], 0, 0
    for runs in groups:
        stop, last = start + runs.velocity.size, offset + (len(runs.prepared) if gas.offsets else 0)
        kept = [*range(offset, last), *([gas.columns.shape[1] - 1] if gas.size else [])]
        part = GasColumns(gas.columns[start:stop, kept], last - offset, gas.size, gas.reference)
        models.append(ForceModel(runs, basis_on(knots, runs.velocity), part, dynamics))
        start, offset = stop, last
    return JointModel(tuple(models))


def _start(model: JointModel, theta: Array) -> Array:
    """Return a start: each curve by linear least squares without a lag, and a given theta."""
    x = np.zeros(model.size)
    for one, place in zip(model.models, model.places, strict=True):
        found = projected(one, one.curve_rows())[0]
        least = 0.05 * max(float(found[: one.curve_count].mean()), 0.0)
        found[: one.curve_count] = np.maximum(found[: one.curve_count], least)
        x[place] = np.concatenate([found, theta])
    return x


def _searched(model: JointModel, x: Array, choices: Choices) -> tuple[JointModel, Array, bool, str]:
    """Return the minimum with weights that follow its residuals."""
    weigh: Callable[[Array, float], Array] | None = weights_for(choices.robust)
    for _ in range(_WEIGHINGS + 1):
        low, high = model.bounds()
        ended = constrained_least_squares(
            model.residual,
            model.jacobian,
            np.clip(x, low, high),
            model.inequalities(),
            tolerance=TOLERANCE,
            evaluations=_EVALUATIONS,
        )
        x = np.clip(ended.x, low, high)
        if weigh is None:
            break
        weights = np.concatenate(
            [
                weigh(one.rows(x[place]) - one.runs.target, one.runs.deviation)
                for one, place in zip(model.models, model.places, strict=True)
            ]
        )
        if np.abs(weights - model.runs.weights).max() < 0.05:
            break
        model = model.weighted(weights)
    return model, x, ended.converged, ended.status


# ==== The law `hysteresis`: two curves of each setting, and a lag and a stop of all ==================================
# For given lag and stop the force is linear in the slopes of both curves, and every setting has curves of its own. So
# the search is over the parameters that all settings share, and the curves of each setting follow from non-negative
# least squares: no curve falls, and the law is passive at every setting.

#: Tolerance and maximum number of evaluations of a search, and maximum number of reweightings.
_TOLERANCE, _LAGGED_EVALUATIONS, _LAGGED_WEIGHINGS = 1e-5, 40, 3

#: In the covariance, a parameter at its bound is fixed: a change by 1 N counts like a force error of this many N.
_STIFF_AT_BOUND = 10.0

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
    found, model = _lagged_search(model, first, weights_for(robust))
    end, notes = found.end, [first.stop_note] * bool(first.stop_note) + ["both curves depend on the setting"]
    x = np.zeros(model.size)
    for part, place in zip(end.parts, model.places, strict=True):
        x[place] = np.linalg.solve(
            np.vstack(search_coordinates(part.problem.model)), np.append(part.linear, part.parameters)
        )
    spread = _covariances(model, x, end)
    return JointFit(model, x, spread, found.converged, found.status, (*first.notes, *notes))


def _lagged_search(
    model: JointModel, first: HysteresisFit, weigh: Callable[[Array, float], Array] | None
) -> tuple[Found[JointPoint], JointModel]:
    """Return the minimum on the whole records with weights that follow its residuals, and the model with them."""
    problem = JointProjection.of(model, is_thin=True)
    start = np.append(first.found.end.parameters, _start_forces(problem, first))
    found = minimum_from(problem, start, tolerance=_TOLERANCE, evaluations=_LAGGED_EVALUATIONS)
    for _ in range(_LAGGED_WEIGHINGS if weigh else 0):
        assert weigh is not None
        pairs = zip(found.end.parts, model.models, strict=True)
        weights = np.concatenate([weigh(part.error, one.runs.deviation) for part, one in pairs])
        if nearly_equal(weights, model.runs.weights):
            break
        model = model.weighted(weights)
        problem = JointProjection.of(model, is_thin=True)
        found = minimum_from(problem, found.end.parameters, tolerance=_TOLERANCE, evaluations=_LAGGED_EVALUATIONS)
    problem = JointProjection.of(model, is_thin=False)
    return minimum_from(problem, found.end.parameters, tolerance=_TOLERANCE, evaluations=_LAGGED_EVALUATIONS), model


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
    size = _STIFF_AT_BOUND * np.sqrt(model.runs.target.size)
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
