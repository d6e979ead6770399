"""Joint fit of the law `hysteresis` over settings: two curves, and a lag and a stop of all settings or of each.

For given lag and stop the force is linear in the slopes of both curves, and every setting has curves of its own. So the
search is over the parameters that all settings share, and the curves of each setting follow from non-negative least
squares: no curve falls, and the law is passive at every setting. At the end, time constants and the stiffness of
the stop are tried for each setting.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.shock.force import ForceModel
from eightpost.ident.shock.hysteresis_fit import HysteresisFit, search_coordinates
from eightpost.ident.shock.hysteresis_search import Found, minimum_from
from eightpost.ident.shock.robust import Robust, nearly_equal, weights_for
from eightpost.ident.shock.settings.joint import JointFit, JointModel
from eightpost.ident.shock.settings.joint_projection import JointPoint, JointProjection
from eightpost.ident.shock.settings.lag_by_setting import lag_by_setting
from eightpost.ident.shock.settings.stop_by_setting import stop_by_setting
from eightpost.ident.shock.uncertainty import covariances
from eightpost.shock.curve import KNOTS

#: Tolerance and maximum number of evaluations of a search, and maximum number of reweightings.
_TOLERANCE, _EVALUATIONS, _WEIGHINGS = 1e-5, 40, 3

#: In the covariance, a parameter at its bound is fixed: a change by 1 N counts like a force error of this many N.
_STIFF = 10.0


def fit_lagged(model: JointModel, first: HysteresisFit, robust: Robust) -> JointFit:
    """Fit the curves of all settings together, with a lag and a stop that are common or belong to each setting.

    Args:
        model: Model of all settings with the dynamics of the first fit.
        first: Fit to the setting with the largest force, from which the search starts.
        robust: Treatment of outliers.
    """
    found, model = _searched(model, first, weights_for(robust))
    end, notes, factors = found.end, [first.stop_note, "both curves depend on the setting"], []
    if end.problem.parts[0].dynamics.has_stop:
        stops = stop_by_setting(end, _with_own_stops(model, first))
        end, notes = stops.end or end, [*notes, stops.note]
        factors += ["stop_stiffness"] * (stops.end is not None)
    lags = lag_by_setting(end)
    end, notes = lags.end or end, [*notes, lags.note]
    factors += ["time_constant"] * (lags.end is not None)
    model = replace(model, factors=tuple(factors), is_shared=not factors)
    x = np.zeros(model.size)
    for part, place in zip(end.parts, model.places, strict=True):
        x[place] = np.linalg.solve(_coordinates(part.problem.model), np.append(part.linear, part.parameters))
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


def _with_own_stops(model: JointModel, first: HysteresisFit) -> JointPoint:
    """Return the minimum on the whole records with a stop of each setting."""
    problem = JointProjection.of(model, is_thin=True, has_own_stop=True)
    start = np.append(first.found.end.parameters, _start_forces(problem, first))
    thin = minimum_from(problem, start, tolerance=_TOLERANCE, evaluations=_EVALUATIONS)
    problem = JointProjection.of(model, is_thin=False, has_own_stop=True)
    return minimum_from(problem, thin.end.parameters, tolerance=_TOLERANCE, evaluations=_EVALUATIONS).end


def _start_forces(problem: JointProjection, first: HysteresisFit) -> Array:
    """Return the shared forces of the first fit, as shares of the force's standard deviation of all settings."""
    gas = first.model.gas
    stiffness = float(first.found.end.linear[-1]) / gas.size if gas.size else 0.0  # [N/m]
    common = problem.parts[0].model.gas.size
    has_stop = problem.parts[0].dynamics.has_stop and not problem.has_own_stop
    forces = [float(first.found.end.linear[2 * KNOTS])] if has_stop else []
    return np.array([*forces, *([stiffness * common] if common else [])]) / problem.deviation


def _coordinates(model: ForceModel) -> Array:
    """Return the matrix from the parameters of a setting's model to the linear ones and those of the states."""
    return np.vstack(search_coordinates(model))


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
