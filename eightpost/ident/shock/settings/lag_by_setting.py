"""Time constants of the law `hysteresis` at each setting: a factor per setting, if left-out parts need it.

A click opens a bleed or stiffens a shim, and the lag of the force behind it may change too. All three time constants of
a setting change by one factor, which interpolates over the settings like the law's other positive parameters.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.optimize import minimize_scalar

from eightpost.array_types import Array
from eightpost.ident.shock.cross_validation import PIECES, HeldOut, left_out_blocks
from eightpost.ident.shock.hysteresis_model import NODES
from eightpost.ident.shock.hysteresis_search import Projected, Projection
from eightpost.ident.shock.settings.joint_projection import JointPoint, JointProjection

#: Largest factor, and its accuracy as a logarithm.
_MOST, _ACCURACY = 4.0, 1e-2

#: The factors must lower the held-out error by this share, and by more than one standard error.
_WORTHWHILE = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class LagBySetting:
    """Whether the time constants differ from setting to setting.

    Attributes:
        end: Minimum with the factors; None if the time constants are the same at all settings.
        note: Sentence on the choice with both held-out errors.
    """

    end: JointPoint | None
    note: str


def lag_by_setting(problem: JointProjection, end: JointPoint) -> LagBySetting:
    """Compare time constants of each setting with common ones on left-out quarters of all records.

    Args:
        problem: Problem on the whole records.
        end: Minimum with common time constants.
    """
    if len(problem.parts) < 2:
        return LagBySetting(None, "the lag is that of the only setting")
    thin = replace(problem, parts=tuple(Projection(part.model, is_thin=True) for part in problem.parts))
    common, own = (
        HeldOut(pieces, pieces)
        for pieces in zip(*(pair for part in thin.parts for pair in _pieces(thin, part, end)), strict=True)
    )
    figures = f"held-out error {own.percent:.3g} % with time constants of each setting, {common.percent:.3g} % without"
    if common.is_as_good_as(own) or own.percent > (1.0 - _WORTHWHILE) * common.percent:
        needed = "they must be better by a standard error and 2 %"
        return LagBySetting(None, f"the time constants are the same at all settings: {figures}; {needed}")
    factors = [_best(thin, part, end)[0] for part in thin.parts]
    parts = tuple(_at(problem, part, end, factor) for part, factor in zip(problem.parts, factors, strict=True))
    named = ", ".join(f"{np.exp(factor):.3g}" for factor in factors)
    return LagBySetting(
        JointPoint(problem, end.parameters, parts),
        f"the time constants depend on the setting, by factors of {named}: {figures}",
    )


def _pieces(problem: JointProjection, part: Projection, end: JointPoint) -> Iterator[tuple[float, float]]:
    """Yield the mean square errors of left-out pieces of a setting over the force's variance: common, own factor."""
    runs = part.model.runs
    for left_out in left_out_blocks(runs):
        kept = Projection(part.model.weighted(runs.weights * left_out.kept), is_thin=True)
        found = _at(problem, kept, end, 0.0), _best(problem, kept, end)[1]
        for rows in left_out.parts:
            variance = max(float(np.var(runs.target[rows])), 1e-300)
            ends = np.linspace(rows.start, rows.stop, PIECES + 1).astype(int)
            for first, last in pairwise(ends.tolist()):
                weights = runs.weights[first:last]
                if weights.sum() > 0.0:
                    common, own = (float(np.average(one.error[first:last] ** 2, weights=weights)) for one in found)
                    yield common / variance, own / variance


def _best(problem: JointProjection, part: Projection, end: JointPoint) -> tuple[float, Projected]:
    """Return the logarithm of the factor that suits a setting best, and the minimum over its curves with it."""

    def cost(factor: float) -> float:
        return _at(problem, part, end, factor).cost

    most = np.log(_MOST)
    found = minimize_scalar(cost, bounds=(-most, most), method="bounded", options={"xatol": _ACCURACY})
    return float(found.x), _at(problem, part, end, float(found.x))


def _at(problem: JointProjection, part: Projection, end: JointPoint, factor: float) -> Projected:
    """Return the minimum over the curves of a setting with its time constants multiplied by exp(factor)."""
    count = end.parameters.size - problem.shared.size
    low, high = part.bounds()
    states: Array = end.parameters[:count].copy()
    states[:NODES] += factor
    return problem.at_states(part, np.clip(states, low, high), problem.deviation * end.parameters[count:])
