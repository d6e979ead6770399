"""Figures that a law of mechanics predicts, and the channels on which they depend."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from functools import cache
from typing import NamedTuple

import numpy as np
from scipy.stats import norm, t

from eightpost.array_types import Array
from eightpost.ident.preparation.plausibility.regression import Regression

#: A comparison is violated above this number of its standard deviations.
SIGNIFICANT = 4.0

#: Smallest ratio that is distinguished from zero or a wrong sign.
SMALLEST = 0.01


class Kind(StrEnum):
    """Kind of a comparison: a ratio (its logarithm), or a time [s]."""

    GAIN = "gain"
    DELAY = "delay"


class Comparison(NamedTuple):
    """A figure that should be zero."""

    law: str  #: Law of mechanics, as a message names it.
    kind: Kind  #: Whether the figure is the logarithm of a ratio or a time [s].
    value: float  #: Figure minus its expectation.
    tolerance: float  #: Absolute value that a sound record and a usual car may reach.
    deviation: float  #: Standard deviation of the figure from the record's noise, with `few_blocks_factor`.
    effect: Mapping[str, float]  #: Change of the figure per logarithm of the gain, or per delay, of each channel.

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
    size = max(float(value[0]), SMALLEST)
    gain = float(np.log(size))
    # A ratio and its inverse are tested; the weaker test counts. They differ if the ratio is not well determined.
    slope = 1.0 / size if size <= 1.0 else gain / (size - 1.0)
    return Comparison(law, Kind.GAIN, gain, tolerance, slope * _deviation(fit, samples), effect)


def delay(
    law: str,
    fit: Regression,
    figure: Callable[[Array], Array],
    *,
    effect: Mapping[str, float],
    tolerance: float,
    over: Sequence[int] = (),
    expected: float = 0.0,
) -> Comparison:
    """Return the comparison of a time, computed from coefficients (..., P), with its expected value [s].

    Args:
        law: Law of mechanics, as a message names it.
        fit: Coefficients.
        figure: Function that computes the time.
        effect: Change of the figure per delay of each channel.
        tolerance: Absolute value that a sound record and a usual car may reach [s].
        over: Columns of the coefficients by which `figure` divides. If one of them is not significant, the record does
            not determine the time, and its deviation is infinite.
        expected: Expected time [s].
    """
    value, samples = (figure(np.atleast_2d(c)) - expected for c in (fit.values, fit.samples))
    is_known = all(abs(fit.values[k]) > SIGNIFICANT * _deviation(fit, fit.samples[:, k]) for k in over)
    deviation = _deviation(fit, samples) if is_known else np.inf
    return Comparison(law, Kind.DELAY, float(value[0]), tolerance, deviation, effect)


def _deviation(fit: Regression, samples: Array) -> float:
    """Return the standard deviation of a figure, from its values (B,) without each block, as of a normal figure."""
    return few_blocks_factor(len(samples)) * fit.deviation(samples)


@cache
def few_blocks_factor(blocks: int) -> float:
    """Return the factor by which a deviation from a few blocks must be larger to be exceeded as rarely as a known one.

    A figure over its jackknife deviation from B blocks has Student's distribution with B - 1 degrees of freedom:
    chance exceeds four standard deviations of 8 blocks 80 times as often as four known ones.

    Args:
        blocks: Number of blocks B, at least 2.
    """
    return float(t.isf(norm.sf(SIGNIFICANT), blocks - 1)) / SIGNIFICANT
