"""Positions of setups, which the own errors of their measures depend on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.study.certainty.vehicle_errors import plain_output, stated_uncertainty
from cosim.study.result import StudyResult
from eightpost.array_types import Array, Flags, Integers
from eightpost.measure_uncertainty import local_features

#: Statistics whose values are proportional to the motion, so that they can measure the distance of two setups.
_DISTANCE = ("rms", "joint_rms")


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
    """Axes of the positions of setups: O outputs, their local features, then all M measures; Z in all."""

    #: Positions of the measures of the outputs (O,): each output of the vehicle counts once, as in the vehicle's own
    #: distance.
    outputs: Integers
    positive: Flags  #: Whether a measure is positive for all setups (M,); the coordinate of any other one is 0.
    middle: Array  #: Means of the logarithms over the setups of the study (O + M,).

    @classmethod
    def of(cls, result: StudyResult) -> Axes:
        """Return the axes of a study."""
        study, predicted = result.study, predicted_levels(result)[result.done]
        positive = np.asarray(np.all(predicted > 0.0, axis=0), dtype=np.bool_)
        found = stated_uncertainty(result, study.vehicle.fmu)
        names = {} if found is None else found.measures
        plain = {plain_output(m, study.vehicle.name, names): k for k, m in enumerate(study.measures) if positive[k]}
        kept = [k for output, k in plain.items() if output is not None]
        if not kept:
            distances = [m.statistic in _DISTANCE and not m.function for m in study.measures]
            kept = [k for k, plain_one in enumerate(distances) if plain_one and positive[k]]
        axes = cls(np.array(kept, dtype=np.int64), positive, np.zeros(len(kept) + positive.size))
        return cls(axes.outputs, positive, axes._logarithms(predicted).mean(axis=0) if len(predicted) else axes.middle)

    def position(self, levels: Array) -> Array:
        """Return the positions (R, Z) of setups by the levels of their measures (R, M), SI.

        The coordinates are `ln(measure) / sqrt(O)` of the outputs, minus their means, `local_features` of these, and
        `ln(measure)` of all measures, minus their means.
        """
        outputs, own = np.split(self._logarithms(levels) - self.middle, [self.outputs.size], axis=1)
        return np.hstack([outputs, local_features(outputs), own])

    def _logarithms(self, levels: Array) -> Array:
        own = np.log(np.where(self.positive, levels, 1.0))
        return np.hstack([own[:, self.outputs] / np.sqrt(max(self.outputs.size, 1)), own])


def predicted_levels(result: StudyResult) -> Array:
    """Return the predicted levels of the measures of all setups (R, M), SI."""
    return np.stack([result.values(measure.name) for measure in result.measures], axis=1)
