"""Stop of the law `hysteresis` at each setting: a stiffness per setting, if left-out parts need it.

The force is linear in the stop's stiffness, so that of each setting follows from non-negative least squares like its
curves, and the search over lag, yield travel and time constant of the stop is repeated. The stiffness interpolates over
the settings by its logarithm like the law's other positive parameters, so it has a smallest value.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from eightpost.ident.shock.hysteresis_search import Projected, Projection
from eightpost.ident.shock.settings.by_setting import BySetting, Refit, is_worthwhile
from eightpost.ident.shock.settings.joint_projection import JointPoint, JointProjection
from eightpost.shock.curve import KNOTS

#: Smallest stiffness of a setting, as a share of the largest one.
_LEAST = 0.05

_WORDS = "stiffnesses of the stop"


def stop_by_setting(end: JointPoint, own_end: JointPoint) -> BySetting:
    """Compare a stop of each setting with a common one on left-out quarters of all records.

    Args:
        end: Minimum on the whole records with a common stop.
        own_end: Minimum on the whole records with a stop of each setting.
    """
    thin = [Projection(part.model, is_thin=True) for part in end.problem.parts]
    if len(thin) < 2:
        return BySetting(None, "the stop is that of the only setting")
    is_better, sentence = is_worthwhile(thin, _WORDS, common=_refit(end), own=_refit(own_end))
    forces = np.array([part.linear[2 * KNOTS] for part in own_end.parts])
    if not is_better or not forces.max() > 0.0:
        return BySetting(None, sentence)
    forces = np.maximum(forces, _LEAST * forces.max())
    named = ", ".join(f"{force:.3g}" for force in forces)
    note = f"the {_WORDS} depend on the setting, with forces of {named} N: {sentence}"
    return BySetting(_with_stops(own_end, forces.tolist()), note)


def _refit(end: JointPoint) -> Refit:
    def refit(number: int, part: Projection) -> Projected:
        base = end.parts[number]
        return end.problem.at_states(part, base.parameters, base.linear[end.problem.shared])

    return refit


def _with_stops(end: JointPoint, forces: list[float]) -> JointPoint:
    """Return the minimum over the curves with given forces of the stop [N], which the settings do not share."""
    problem: JointProjection = replace(end.problem, has_own_stop=False)
    parts = tuple(
        problem.at_states(part, base.parameters, np.append(force, base.linear[end.problem.shared]))
        for part, base, force in zip(problem.parts, end.parts, forces, strict=True)
    )
    count = end.parts[0].parameters.size
    shared = np.append(np.mean(forces) / problem.deviation, end.parameters[count:])
    return JointPoint(problem, np.append(end.parameters[:count], shared), parts)
