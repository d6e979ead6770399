"""Positions of setups, which the own errors of their measures depend on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cosim.study.certainty.vehicle_errors import plain_output, stated_uncertainty
from cosim.study.result import StudyResult
from eightpost.array_types import Array, Flags, Integers

#: Statistics whose values are proportional to the motion, so that they can measure the distance of two setups.
_DISTANCE = ("rms", "joint_rms")


@dataclass(frozen=True, slots=True, eq=False)
class Axes:
    """Axes of the positions of setups: O outputs, then all M measures.

    Attributes:
        outputs: Positions of the measures of the outputs (O,): each output of the vehicle counts once, as in the
            vehicle's own distance.
        positive: Whether a measure is positive for all setups (M,); the coordinate of any other one is 0.
        middle: Mean of the coordinates over the setups of the study (O + M,).
    """

    outputs: Integers
    positive: Flags
    middle: Array

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
        return cls(axes.outputs, positive, axes.position(predicted).mean(axis=0) if len(predicted) else axes.middle)

    def position(self, levels: Array) -> Array:
        """Return the positions (..., O + M) of setups by the levels of their measures (..., M), SI.

        The coordinates are `ln(measure) / sqrt(O)` of the outputs and `ln(measure)` of all measures, minus their means.
        """
        own = np.log(np.where(self.positive, levels, 1.0))
        outputs = own[..., self.outputs] / np.sqrt(max(self.outputs.size, 1))
        return np.asarray(np.concatenate([outputs, own], axis=-1) - self.middle)


def predicted_levels(result: StudyResult) -> Array:
    """Return the predicted levels of the measures of all setups (R, M), SI."""
    return np.stack([result.values(measure.name) for measure in result.measures], axis=1)
