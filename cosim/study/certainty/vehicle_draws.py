"""Drawn errors of the vehicle for setups that are not in the table of a study, such as shocks that nobody has built."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cosim.study.certainty.choice import Criterion, Limits, limits_of
from cosim.study.certainty.positions import Axes
from cosim.study.certainty.posterior import Posterior
from cosim.study.certainty.sources import Variables
from cosim.study.certainty.vehicle_errors import UNKNOWN
from cosim.study.result import StudyResult
from eightpost.array_types import Array, Integers

#: Number of groups of draws with the same scales, and number of draws in each; half of them are the others negated.
_GROUPS, _PER_GROUP = 64, 4

_SEED = 20270


@dataclass(frozen=True, eq=False)
class VehicleDraws:
    """D drawn errors of M measures, as functions of the levels that the vehicle predicts for a setup.

    ln(true / predicted) = common + own . z,    z: position of the setup
    """

    names: tuple[str, ...]  #: Names of the measures.
    common: Array  #: Common error (D, M).
    own: Array  #: Gradient of the own error (D, M, Z).
    axes: Axes  #: Axes of the positions of setups.
    unknown: tuple[str, ...]  #: Measures whose uncertainty is not known; their errors are 0.

    @classmethod
    def of(cls, result: StudyResult, posterior: Posterior, seed: int = _SEED) -> VehicleDraws | None:
        """Return drawn errors; None if the vehicle of the study states no uncertainty.

        Args:
            result: Result of the study.
            posterior: Errors of its setups, given the rig runs so far.
            seed: Seed of the draws.
        """
        sources = posterior.sources
        generator = np.random.default_rng(seed)
        drawn = [posterior.draw(one, _PER_GROUP, generator) for one in posterior.scales.groups(_GROUPS, generator)]
        parts = drawn if posterior.observations.rows.size else [_balanced(one, sources.shift) for one in drawn]
        unknown = tuple(n for n, origin in zip(sources.names, sources.bases, strict=True) if origin == UNKNOWN)
        common, own = (np.concatenate([getattr(one, part) for one in parts]) for part in ("common", "own"))
        if not np.any(common) and not np.any(own):
            return None
        return cls(sources.names, common, own, Axes.of(result), unknown)

    def levels(self, predicted: Array, measures: Integers) -> Array:
        """Return the true levels (D, K, I) of some measures, SI.

        Args:
            predicted: Predicted levels of all measures of K setups (K, M), SI.
            measures: Positions of the measures (I,).
        """
        places = self.axes.position(predicted)
        errors = self.common[:, None, measures] + np.einsum("diz,kz->dki", self.own[:, measures], places)
        return np.asarray(predicted[:, measures] * np.exp(errors))


def _balanced(drawn: Variables, shift: Array) -> Variables:
    """Return draws of which the second half is the first one negated about the shift, so that this is their mean."""
    half = len(drawn.common) // 2
    parts = (drawn.common - shift, drawn.own, drawn.shocks)
    common, own, shocks = (np.concatenate([part[:half], -part[:half]]) for part in parts)
    return Variables(common + shift, own, shocks)


@dataclass(frozen=True, eq=False)
class DrawnCar:
    """Objective and constraints of setups on D cars that the true one may be, compared with a reference setup.

    An error of the objective that the reference has too, such as a common one, says nothing on which setup is better;
    it is left out of the objective, but not of the constraints.
    """

    draws: VehicleDraws  #: Drawn errors.
    criterion: Criterion  #: Objective.
    limits: tuple[Limits, ...]  #: Constraints.
    reference: Array  #: Predicted levels of the reference (M,), SI.

    @classmethod
    def of(cls, result: StudyResult, draws: VehicleDraws, name: str, row: int) -> DrawnCar:
        """Return the drawn cars of a study.

        Args:
            result: Result of the study.
            draws: Drawn errors.
            name: `OBJECTIVE` or the name of a measure.
            row: Row of the reference.
        """
        reference = np.array([result.values(measure)[row] for measure in draws.names])
        return cls(draws, Criterion.of(result, name), limits_of(result), reference)

    @property
    def is_known(self) -> bool:
        """Whether the uncertainty of every measure of the objective is known."""
        return not self.unknown(self.criterion.measures)

    def unknown(self, measures: Integers) -> tuple[str, ...]:
        """Return those of some measures whose uncertainty is not known."""
        return tuple(self.draws.names[m] for m in measures.tolist() if self.draws.names[m] in self.draws.unknown)

    def objectives(self, predicted: Array) -> Array:
        """Return the objective (K, D) of predicted levels (K, M), less the error that the reference has too."""
        own, reference = (self._objectives(rows) for rows in (predicted, self.reference[None]))
        return own - reference + self.criterion.values(self.reference)

    def limited(self, predicted: Array) -> Sequence[Array]:
        """Return the levels (K, D) of the measure of each constraint."""
        return [self.draws.levels(predicted, np.array([limit.measure]))[..., 0].T for limit in self.limits]

    def _objectives(self, predicted: Array) -> Array:
        levels = self.draws.levels(predicted, self.criterion.measures)
        return np.asarray((levels @ self.criterion.weights + self.criterion.offset).T)
