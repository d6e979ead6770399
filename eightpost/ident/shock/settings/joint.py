"""Joint fit of all files of a shock: a curve for each setting, on the same knots, and one law for all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.closed import projected
from eightpost.ident.shock.curve import WorkingBasis, rising_constraint, slope_constraint
from eightpost.ident.shock.curve_choice import CurveChooser
from eightpost.ident.shock.fitted_law import FittedLaw
from eightpost.ident.shock.force import Dynamics, ForceModel
from eightpost.ident.shock.gas import GasColumns, gas_columns
from eightpost.ident.shock.knots import CELLS, KnotBasis
from eightpost.ident.shock.law_choice import LawChoice, best_law
from eightpost.ident.shock.law_fit import fit_law
from eightpost.ident.shock.options import AUTO, LAGGED_VELOCITY, Choices
from eightpost.ident.shock.problem import TOLERANCE, Inequalities, Solution, constrained_least_squares
from eightpost.ident.shock.robust import weights_for
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.uncertainty import covariances, quantile, standard_error
from eightpost.shock import LAWS, FitParameter, Port, ShockLaw, fit_form, fit_parameters, own_parameters
from eightpost.shock.curve import KNOTS

#: Laws that can be fitted: their parameters are numbers with bounds of their own, or the law has a recipe of its own.
_OVER_SETTINGS = tuple(
    name
    for name, law in LAWS.items()
    if own_parameters(law) == tuple(p.name for p in fit_parameters(law)) or fit_form(law) == LAGGED_VELOCITY
)

#: Maximum number of evaluations of the residual, and of reweightings.
_EVALUATIONS, _WEIGHINGS = 100, 2

#: A slope times the highest speed is at its constraint within this share of the force's standard deviation; in the
#: covariance, a violation of the constraint by 1 N then counts like a force error of this many N everywhere.
_AT_CONSTRAINT, _STIFF = 1e-3, 10.0

#: A law's own parameters differ from setting to setting only if this lowers the sum of squares by this share.
_WORTHWHILE = 0.05


@dataclass(frozen=True, eq=False)
class JointModel:
    """Force models of all settings, with their shared parameters.

    Parameters x: for each setting its slopes (K,), gas offsets and own elements of theta, then the shared gas stiffness
    if it is fitted, then the rest of the law's theta: shared, or for each setting.

    Attributes:
        models: Force model of each setting; all have the same knots and the same dynamics.
        is_shared: Whether theta is shared.
        local: Number of leading elements of a shared theta that each setting has for itself.
        factors: Parameters of the law `hysteresis` that differ from setting to setting by a factor.
    """

    models: tuple[ForceModel, ...]
    is_shared: bool = True
    local: int = 0
    factors: tuple[str, ...] = ()

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
        k = len(self.dynamics.names)
        thetas = [start + (0 if self.is_shared else number * k) + np.arange(k) for number in range(len(self.models))]
        return tuple(
            np.concatenate([curve, *stiffness, mine, theta]).astype(int)
            for curve, mine, theta in zip(local, own, thetas, strict=True)
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

    def inequalities(self, x: Array) -> Inequalities:
        """Return the constraints: no slope is negative (for some laws: every curve rises), theta within its bounds."""
        matrices, floors = [], []
        for model, place in zip(self.models, self.places, strict=True):
            b = x[place[: model.curve_count]]
            constraint = (
                rising_constraint(model.basis, b) if self.dynamics.needs_rise else slope_constraint(model.basis)
            )
            matrix = np.zeros((constraint.floor.size, self.size))
            matrix[:, place[: model.curve_count]] = constraint.matrix
            matrices.append(matrix)
            floors.append(constraint.floor + constraint.clear)
        return Inequalities(np.vstack(matrices), np.concatenate(floors)).and_bounds(*self.bounds())

    def active_rows(self, x: Array) -> Array:
        """Return rows that fix x in the directions of its active constraints, for its covariance."""
        inequalities = self.inequalities(x)
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
    """The curves of all settings and their law.

    Attributes:
        model: Model of all settings.
        x: Parameters.
        covariance: Covariances (3, n, n) of x, see `covariances`.
        converged: Whether the search ended at a minimum.
        status: Description of how the search ended.
        choice: Comparison of the laws if the law was chosen automatically.
        notes: Notes on the choices of the fit, one sentence each.
    """

    model: JointModel
    x: Array
    covariance: Array
    converged: bool
    status: str
    choice: LawChoice | None
    notes: tuple[str, ...]

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

    @property
    def separate(self) -> tuple[str, ...]:
        """Names of the law's own parameters that differ from setting to setting."""
        kind = self.model.dynamics.kind
        if self.model.is_shared:
            return ()
        if self.model.local or kind is None:
            return self.model.factors
        return tuple(parameter.name for parameter in _positive(kind))

    def _part(self, number: int) -> tuple[Array, Array, Array]:
        return self.model.models[number].split(self.x[self.model.places[number]])


def fit_jointly(groups: Sequence[Runs], law: str, choices: Choices) -> JointFit:
    """Fit one law with a curve for each setting.

    The law is chosen, and the search for its parameters started, on the setting with the largest force.

    Args:
        groups: Runs of each setting.
        law: Name of the law, or `auto`.
        choices: Options; the curve always has knots.

    Raises:
        ParameterError: The law is unknown or cannot be fitted over settings, or no law could be fitted.
    """
    choices = replace(choices, curve="knots")
    hardest = max(groups, key=lambda runs: runs.deviation)
    choice: LawChoice | None = None
    fit: FittedLaw | None = None
    if law == AUTO:
        choice, fit, _ = best_law(hardest, choices, _OVER_SETTINGS)
        law = choice.law
    elif law not in _OVER_SETTINGS:
        known = ", ".join(_OVER_SETTINGS)
        raise ParameterError(
            f"law {law!r} cannot be fitted over settings, because its file does not declare how its own parameters are "
            f"fitted; use one of {known}"
        )
    if fit_form(LAWS[law]) == LAGGED_VELOCITY:
        return _fit_lagged(groups, fit or CurveChooser(hardest, choices)(law)[0].fit, choices, choice)
    first = fit_law(hardest, law, choices, "knots")
    minimum = first.sketch.minimum
    theta = minimum.problem.model.split(minimum.parameters)[2]
    gas, notes = gas_columns(Runs.of([p for runs in groups for p in runs.prepared]), choices.gas)
    model = _joint_model(groups, gas, minimum.problem.model.dynamics)
    x = _start(model, theta)
    fitted = _searched(model, x, choices)
    if model.dynamics.names and len(groups) > 1:
        fitted, more = _with_own_parameters(fitted, choices)
        notes += more
    model, x, converged, status = fitted
    spread = covariances(np.vstack([model.jacobian(x), model.active_rows(x)]), model.error(x), model.runs)
    return JointFit(model, x, spread, converged, status, choice, (*first.notes, *notes))


def _fit_lagged(groups: Sequence[Runs], first: FittedLaw, choices: Choices, choice: LawChoice | None) -> JointFit:
    # The compiler takes a second to load.
    from eightpost.ident.shock.hysteresis_fit import HysteresisFit  # noqa: PLC0415
    from eightpost.ident.shock.settings.lagged import fit_lagged  # noqa: PLC0415

    assert isinstance(first, HysteresisFit)
    gas, notes = gas_columns(Runs.of([p for runs in groups for p in runs.prepared]), choices.gas)
    model = replace(_joint_model(groups, gas, first.model.dynamics, cells=KNOTS // 2), local=KNOTS)
    fit = fit_lagged(model, first, choices.robust, choice)
    return replace(fit, notes=(*fit.notes, *notes))


_Search = tuple[JointModel, Array, bool, str]


def _joint_model(groups: Sequence[Runs], gas: GasColumns, dynamics: Dynamics, cells: int = CELLS) -> JointModel:
    fastest = np.concatenate([runs.velocity[runs.inside] for runs in groups])
    knots = KnotBasis.of(fastest, cells=cells)
    models, start, offset = [], 0, 0
    for runs in groups:
        stop, last = start + runs.velocity.size, offset + (len(runs.prepared) if gas.offsets else 0)
        kept = [*range(offset, last), *([gas.columns.shape[1] - 1] if gas.size else [])]
        part = GasColumns(gas.columns[start:stop, kept], last - offset, gas.size, gas.reference)
        models.append(ForceModel(runs, _working_basis(knots, runs), part, dynamics))
        start, offset = stop, last
    return JointModel(tuple(models))


def _working_basis(knots: KnotBasis, runs: Runs) -> WorkingBasis:
    """Return the basis of a setting on shared knots; its coefficients are slopes times the highest speed [N]."""
    to_curve = np.eye(knots.count) / knots.speed
    grid = np.linspace(knots.knots[0], knots.knots[-1], 401)
    columns = np.asfortranarray(knots.design(runs.velocity) / knots.speed)
    return WorkingBasis(knots, columns, grid, knots.design(grid) / knots.speed, to_curve, knots.penalty() @ to_curve)


def _start(model: JointModel, theta: Array) -> Array:
    """Return a start: each curve by linear least squares without a lag, and a given theta."""
    x = np.zeros(model.size)
    for one, place in zip(model.models, model.places, strict=True):
        found = projected(one, one.curve_rows())[0]
        least = 0.05 * max(float(found[: one.curve_count].mean()), 0.0)
        found[: one.curve_count] = np.maximum(found[: one.curve_count], least)
        x[place] = np.concatenate([found, theta])
    return x


def _searched(model: JointModel, x: Array, choices: Choices) -> _Search:
    """Return the minimum with weights that follow its residuals."""
    weigh: Callable[[Array, float], Array] | None = weights_for(choices.robust)
    for _ in range(_WEIGHINGS + 1):
        low, high = model.bounds()
        ended = constrained_least_squares(
            model.residual,
            model.jacobian,
            np.clip(x, low, high),
            model.inequalities(x),
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


def _positive(law: type[ShockLaw]) -> tuple[FitParameter, ...]:
    """Return the own parameters of a law that are fitted on a logarithmic scale."""
    return tuple(parameter for parameter in fit_parameters(law) if parameter.scale == "logarithmic")


def _with_own_parameters(shared: _Search, choices: Choices) -> tuple[_Search, list[str]]:
    """Return the fit with the law's positive parameters for each setting if that is worthwhile, and a note."""
    model, x, _, _ = shared
    assert model.dynamics.kind is not None
    if not _positive(model.dynamics.kind):
        return shared, []
    separate = replace(model, is_shared=False)
    start = np.zeros(separate.size)
    for before, after in zip(model.places, separate.places, strict=True):
        start[after] = x[before]
    found = _searched(separate, start, replace(choices, robust="none"))
    costs = [float(np.sum(m.residual(p) ** 2)) for m, p in ((model, x), found[:2])]
    gain = 1.0 - costs[1] / costs[0]
    if gain < _WORTHWHILE:
        return shared, [
            "the law's own parameters are the same at all settings: separate ones would lower the sum of squares by "
            f"{100.0 * gain:.2g} % only"
        ]
    return found, [
        f"the law's own parameters depend on the setting, which lowers the sum of squares by {100.0 * gain:.2g} %"
    ]
