"""Figures that a law of mechanics predicts, and the channels on which they depend."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.preparation.plausibility.regression import Regression

#: A comparison is violated above this number of its standard deviations.
SIGNIFICANT = 4.0

#: Smallest ratio that is distinguished from zero or a wrong sign.
_SMALLEST = 0.01


class Kind(StrEnum):
    """Kind of a comparison: a ratio (its logarithm), or a time [s]."""

    GAIN = "gain"
    DELAY = "delay"


class Comparison(NamedTuple):
    """A figure that should be zero.

    Attributes:
        law: Law of mechanics, as a message names it.
        kind: Whether the figure is the logarithm of a ratio or a time [s].
        value: Figure minus its expectation.
        tolerance: Absolute value that a sound record and a usual car may reach.
        deviation: Standard deviation of the figure from the record's noise.
        effect: Change of the figure per logarithm of the gain, or per delay, of each channel.
    """

    law: str
    kind: Kind
    value: float
    tolerance: float
    deviation: float
    effect: Mapping[str, float]

    @property
    def scale(self) -> float:
        """Standard deviation to be expected, from usual cars and from noise."""
        return float(np.hypot(self.tolerance / SIGNIFICANT, self.deviation))

    @property
    def score(self) -> float:
        """Figure in standard deviations."""
        return self.value / self.scale

    @property
    def is_violated(self) -> bool:
        """Whether the figure contradicts the law."""
        return abs(self.score) > SIGNIFICANT


def ratio(
    law: str,
    fit: Regression,
    figure: Callable[[Array], Array],
    *,
    effect: Mapping[str, float],
    tolerance: float,
    expected: float = 1.0,
) -> Comparison:
    """Return the comparison of a ratio, computed from coefficients (..., P), with its expected value."""
    value, samples = (figure(np.atleast_2d(c)) / expected for c in (fit.values, fit.samples))
    size = max(float(value[0]), _SMALLEST)
    return Comparison(law, Kind.GAIN, float(np.log(size)), tolerance, fit.deviation(samples) / size, effect)


def delay(
    law: str,
    fit: Regression,
    figure: Callable[[Array], Array],
    *,
    effect: Mapping[str, float],
    tolerance: float,
    expected: float = 0.0,
) -> Comparison:
    """Return the comparison of a time, computed from coefficients (..., P), with its expected value [s]."""
    value, samples = (figure(np.atleast_2d(c)) - expected for c in (fit.values, fit.samples))
    return Comparison(law, Kind.DELAY, float(value[0]), tolerance, fit.deviation(samples), effect)
