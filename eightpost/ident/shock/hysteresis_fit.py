"""The law `hysteresis` fitted to runs, with outliers down-weighted, and with a stop where that predicts better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.cross_validation import WORTHWHILE, CrossValidation
from eightpost.ident.shock.curve import knot_basis
from eightpost.ident.shock.force import ForceModel, gas_columns, limits_for
from eightpost.ident.shock.hysteresis import NODES, Found, LaggedVelocity, Projected, Projection, minimum_from
from eightpost.ident.shock.law_fit import Choices, FittedLaw, nearly_equal, weights_for
from eightpost.ident.shock.problem import Solution, block_changes, covariances
from eightpost.ident.shock.runs import Runs
from eightpost.shock import LAWS
from eightpost.shock.curve import KNOTS

#: Starting values of tau [s], the same at all nodes.
_TAUS = (2e-3, 6e-3, 2e-2, 6e-2)

#: Starting values of the stop: yield travel [m] and time constant [s].
_STOPS = ((3e-4, 1e-2), (1e-3, 3e-2), (1e-4, 1e-1))

#: Number of starts that are followed to their minimum.
_FOLLOWED = 2

#: Tolerance and maximum number of evaluations: of a first search from each start, of a search to the minimum, and of a
#: fit to a part of the record, which must not end near its start, the fit to everything.
_ROUGH, _FINE, _REFIT = (1e-2, 6), (1e-5, 40), (1e-6, 30)

#: Maximum number of reweightings.
_WEIGHINGS = 4

_ONE_SPEED = "the law has no stop: the test has a single speed, at which a stop and a lag cannot be distinguished"

#: In the covariance, a parameter at its bound is fixed: a change by 1 N counts like a force error of this many N.
_STIFF = 10.0


# ---- The fitted law -------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class HysteresisFit(FittedLaw):
    """The law `hysteresis` fitted to runs."""

    found: Found[Projected]  #: Minimum on the whole record.
    stop_note: str  #: Sentence on whether the law has a stop, and why; empty if a stop would hardly lower the error.

    @property
    def model(self) -> ForceModel:
        """The model of the whole record with the weights of the fit."""
        return self.found.end.problem.model

    @property
    def runs(self) -> Runs:
        """The runs with the weights of the fit."""
        return self.model.runs

    @property
    def error(self) -> Array:
        """The force error at the rows (R,) [N], without weights."""
        return self.found.end.error

    @property
    def has_converged(self) -> bool:
        """Whether the search ended at a minimum."""
        return self.found.converged

    def refitted_rows(self, weights: Array) -> Array:
        """Return the force (R,) [N] of a free simulation, fitted again with weights (R,) from this minimum.

        The fit uses a thinned record, the simulation the whole one.
        """
        thin = Projection(self.model.weighted(weights), is_thin=True)
        end = _search(thin, self.found.end.parameters, _REFIT).end
        return self.found.end.problem.rows(end.parameters, end.linear)

    def solution(self) -> Solution:
        """Return the solution with its covariance."""
        end, model = self.found.end, self.model
        to_linear, to_states = search_coordinates(model)
        parameters = np.linalg.solve(np.vstack([to_linear, to_states]), np.append(end.linear, end.parameters))
        low, high = end.problem.dynamics.state_bounds()
        at_bound = (end.parameters <= low) | (end.parameters >= high)
        stiff = _STIFF * np.sqrt(model.runs.target.size)
        root = np.sqrt(model.runs.weights)
        jacobian = np.vstack(
            [
                root[:, None] * model.rows_jacobian(parameters),
                end.problem.penalty @ to_linear,
                end.problem.unevenness @ to_states,
                stiff * to_linear[end.is_fixed],
                stiff * model.runs.deviation * to_states[at_bound],
            ]
        )
        penalties = end.problem.penalty @ end.linear, end.problem.unevenness @ end.parameters
        error = root * end.error
        spread = covariances(jacobian, error, model.runs, penalties)
        left_out, notes = block_changes(jacobian, error, model.runs), (self.stop_note,) * bool(self.stop_note)
        return Solution(model, parameters, spread, self.found.converged, self.found.status, notes, left_out)


def search_coordinates(model: ForceModel) -> tuple[Array, Array]:
    """Return matrices from the parameters of a model (n + g + k,) to the linear ones of the search and to the states'.

    The model's parameters are the slopes of the whole curve, gas, and theta; those of the search are the slopes of f0,
    those of f1, the stop, and gas.
    """
    gas, has_stop = model.gas.count, model.dynamics.has_stop  # type: ignore[attr-defined]
    curve, g, slopes, taus, stop, rest = np.split(
        np.eye(2 * KNOTS + gas + NODES + 3 * has_stop),
        np.cumsum([KNOTS, gas, KNOTS, NODES, int(has_stop)]),
    )
    return np.vstack([curve - slopes, slopes, stop, g]), np.vstack([taus, rest])


# ---- The fit --------------------------------------------------------------------------------------------------------


def fit_hysteresis(runs: Runs, law: str, choices: Choices) -> CrossValidation:
    """Return the fit of the law `hysteresis` to runs, ready for cross-validation.

    It has a stop if the runs can show one, and if left-out parts are predicted better with it.

    """
    gas, notes = gas_columns(runs, choices.gas)
    limits = limits_for(runs.measured, runs.rate)
    dynamics = LaggedVelocity.of(LAWS[law], limits, runs.rate)
    basis, weigh = knot_basis(runs.velocity, runs.inside, cells=KNOTS // 2), weights_for(choices.robust)
    model = ForceModel(runs, basis, gas, dynamics)
    found = _robust(_without_stop, model, weigh)
    if runs.has_one_motion:
        return CrossValidation(HysteresisFit(law, tuple(notes), found, _ONE_SPEED))
    model = replace(model, dynamics=dynamics.with_stop()).weighted(found.end.problem.model.runs.weights)
    taus, thin = found.end.parameters, Projection(found.end.problem.model, is_thin=True)
    rough = _rough(Projection(model, is_thin=True), [np.append(taus, np.log(stop)) for stop in _STOPS])
    if rough[0].cost > (1.0 - WORTHWHILE) * thin.at(taus).cost:
        return CrossValidation(HysteresisFit(law, tuple(notes), found, ""))
    stopped = _robust(lambda problem: _followed(problem, rough), model, weigh)
    return _better(*(CrossValidation(HysteresisFit(law, tuple(notes), one, "")) for one in (found, stopped)))


def _better(without: CrossValidation, stopped: CrossValidation) -> CrossValidation:
    """Return the fit with a stop if that is worthwhile on left-out parts, else the other."""
    counted = np.maximum(without.fit.runs.weights, stopped.fit.runs.weights)
    held, other = without.errors(counted), stopped.errors(counted)
    figures = f"held-out error {other.percent:.3g} % with a stop, {held.percent:.3g} % without"
    if stopped.fit.has_converged and held.is_beaten_by(other):
        return _with_note(stopped, f"the law has a stop: {figures}")
    return _with_note(without, f"the law has no stop: {figures}; a stop must be better by a standard error and 2 %")


def _with_note(found: CrossValidation, note: str) -> CrossValidation:
    """Return a fit with its note on the stop; computed predictions are kept."""
    assert isinstance(found.fit, HysteresisFit)
    other = CrossValidation(replace(found.fit, stop_note=note))
    other.__dict__.update({name: value for name, value in found.__dict__.items() if name != "fit"})
    return other


def _search(problem: Projection, start: Array, effort: tuple[float, int]) -> Found[Projected]:
    tolerance, evaluations = effort
    return minimum_from(problem, start, tolerance=tolerance, evaluations=evaluations)


def _rough(problem: Projection, starts: list[Array]) -> list[Found[Projected]]:
    """Return the ends of short searches from some starts, the best first."""
    return sorted((_search(problem, start, _ROUGH) for start in starts), key=lambda found: found.cost)


def _followed(problem: Projection, rough: list[Found[Projected]]) -> Found[Projected]:
    """Return the best minimum from the best ends of short searches."""
    ends = [_search(problem, found.end.parameters, _FINE) for found in rough[:_FOLLOWED]]
    return min(ends, key=lambda found: found.cost)


def _without_stop(problem: Projection) -> Found[Projected]:
    return _followed(problem, _rough(problem, [np.full(NODES, np.log(tau)) for tau in _TAUS]))


def _robust(
    first: Callable[[Projection], Found[Projected]], model: ForceModel, weigh: Callable[[Array, float], Array] | None
) -> Found[Projected]:
    """Return the minimum on the whole record with weights that follow its own residuals.

    Args:
        first: Search on a thinned record for the first minimum.
        model: Model of the whole record.
        weigh: Function of residuals (R,) and the force's standard deviation [N]; None for the weights of the model.
    """
    found = first(Projection(model, is_thin=True))
    for _ in range(_WEIGHINGS if weigh else 0):
        assert weigh is not None
        weights = weigh(found.end.error, model.runs.deviation)
        if nearly_equal(weights, model.runs.weights):
            break
        model = model.weighted(weights)
        found = _search(Projection(model, is_thin=True), found.end.parameters, _FINE)
    return _search(Projection(model, is_thin=False), found.end.parameters, _FINE)
