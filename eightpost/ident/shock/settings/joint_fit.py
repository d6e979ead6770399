"""Joint fit of all files of a shock: a curve for each setting, and one law for all."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.shock.closed import projected
from eightpost.ident.shock.curve import basis_on
from eightpost.ident.shock.fit import fit_of
from eightpost.ident.shock.fitted_law import FittedLaw
from eightpost.ident.shock.force import Dynamics, ForceModel
from eightpost.ident.shock.gas import GasColumns, gas_columns
from eightpost.ident.shock.knots import CELLS, KnotBasis
from eightpost.ident.shock.law_fit import LawFit
from eightpost.ident.shock.options import Choices, has_own_recipe
from eightpost.ident.shock.problem import TOLERANCE, constrained_least_squares
from eightpost.ident.shock.robust import weights_for
from eightpost.ident.shock.runs import Runs
from eightpost.ident.shock.settings.joint import JointFit, JointModel
from eightpost.ident.shock.uncertainty import covariances
from eightpost.shock import LAWS, fit_parameters, own_parameters
from eightpost.shock.curve import KNOTS

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
    # The compiler takes a second to load.
    from eightpost.ident.shock.hysteresis_fit import HysteresisFit  # noqa: PLC0415
    from eightpost.ident.shock.settings.lagged import fit_lagged  # noqa: PLC0415

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
