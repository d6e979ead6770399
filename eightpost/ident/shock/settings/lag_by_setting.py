"""Time constants of the law `hysteresis` at each setting: a factor per setting, if left-out parts need it.

A click opens a bleed or stiffens a shim, and the lag of the force behind it may change too. All three time constants of
a setting change by one factor, which interpolates over the settings like the law's other positive parameters.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from eightpost.array_types import Array
from eightpost.ident.shock.hysteresis_model import NODES
from eightpost.ident.shock.hysteresis_search import Projected, Projection
from eightpost.ident.shock.settings.by_setting import BySetting, is_worthwhile
from eightpost.ident.shock.settings.joint_projection import JointPoint

#: Largest factor, and its accuracy as a logarithm.
_MOST, _ACCURACY = 4.0, 1e-2

_WORDS = "time constants"


def lag_by_setting(end: JointPoint) -> BySetting:
    """Compare time constants of each setting with common ones on left-out quarters of all records.

    Args:
        end: Minimum on the whole records with common time constants.
    """
    problem = end.problem
    if len(problem.parts) < 2:
        return BySetting(None, "the lag is that of the only setting")

    def common(number: int, part: Projection) -> Projected:
        return _at(end, number, part, 0.0)

    def own(number: int, part: Projection) -> Projected:
        return _at(end, number, part, _best(end, number, part))

    thin = [Projection(part.model, is_thin=True) for part in problem.parts]
    is_better, sentence = is_worthwhile(thin, _WORDS, common=common, own=own)
    if not is_better:
        return BySetting(None, sentence)
    factors = [_best(end, number, part) for number, part in enumerate(thin)]
    parts = tuple(_at(end, number, part, factors[number]) for number, part in enumerate(problem.parts))
    named = ", ".join(f"{np.exp(factor):.3g}" for factor in factors)
    note = f"the {_WORDS} depend on the setting, by factors of {named}: {sentence}"
    return BySetting(JointPoint(problem, end.parameters, parts), note)


def _best(end: JointPoint, number: int, part: Projection) -> float:
    """Return the logarithm of the factor that suits a setting best."""
    most = np.log(_MOST)
    found = minimize_scalar(
        lambda factor: _at(end, number, part, float(factor)).cost,
        bounds=(-most, most),
        method="bounded",
        options={"xatol": _ACCURACY},
    )
    return float(found.x)


def _at(end: JointPoint, number: int, part: Projection, factor: float) -> Projected:
    """Return the minimum over the curves of a setting with its time constants multiplied by exp(factor)."""
    base, (low, high) = end.parts[number], part.bounds()
    states: Array = base.parameters.copy()
    states[:NODES] += factor
    return end.problem.at_states(part, np.clip(states, low, high), base.linear[end.problem.shared])
