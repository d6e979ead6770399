"""Uncertainty of a response measure of an identified vehicle: what all setups share, and what belongs to one setup."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from scipy.stats import t as student

from eightpost.errors import ParameterError

#: Degrees of freedom of Student's t distribution of the errors: their standard deviations are themselves uncertain.
DEGREES = 4.0

#: Measure of the sum of the tire forces of all wheels.
TOTAL = "total_tire_force"


@dataclass(frozen=True, slots=True)
class MeasureUncertainty:
    """Uncertainty of the RMS of an output on a drive, for setups that the vehicle was not tested with.

        ln(predicted / true) = common + own(setup)

    All setups on one drive share the common error, so it says nothing on which of them is better. The own errors of two
    setups differ the more, the more the setups differ: the standard deviation of the difference is `own` times their
    `distance`. Errors have Student's t distribution with `DEGREES` degrees of freedom.

    Attributes:
        common: Scale of the relative error that all setups share [1].
        own: Scale of the relative error between two setups per unit of their distance [1].
    """

    common: float
    own: float

    def interval(self, predicted: float, level: float = 0.95, *, distance: float = 0.0) -> tuple[float, float]:
        """Return the interval that contains the true value of a measure with a given probability.

        Args:
            predicted: Predicted value of the measure.
            level: Probability [1], between 0 and 1.
            distance: Distance of the setup from the mean of the setups on that drive, or from the tests' setup.

        Raises:
            ParameterError: The level is not between 0 and 1.
        """
        factor = 1.0 + self.half_width(distance, level)
        return predicted / factor, predicted * factor

    def half_width(self, distance: float, level: float = 0.95) -> float:
        """Return the relative half width of an interval [1]; see `interval`.

        Raises:
            ParameterError: The level is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ParameterError(f"the level of an interval is {level!r}; it must be between 0 and 1, e.g. 0.95")
        scale = math.hypot(self.common, self.own * distance)
        return math.expm1(scale * float(student.ppf(0.5 + 0.5 * level, DEGREES)))

    def probability_below(self, first: float, second: float, *, distance: float) -> float:
        """Return the probability that the first setup's true value is below that of the second; 0.5 if they are equal.

        Args:
            first: Predicted value of the first setup.
            second: Predicted value of the second setup.
            distance: Distance of the two setups.
        """
        change, scale = math.log(second / first), self.own * distance
        if scale == 0.0:
            return 0.5 if change == 0.0 else float(change > 0.0)
        return float(student.cdf(change / scale, DEGREES))


def setup_distance(first: Mapping[str, float], second: Mapping[str, float]) -> float:
    """Return the distance of two setups: the RMS over all measures of ln(first / second).

    Args:
        first: Predicted measures of a setup, by name.
        second: Predicted measures of another setup with the same names.

    Raises:
        ParameterError: The setups do not have the same measures.
    """
    if set(first) != set(second) or not first:
        missing = ", ".join(sorted(set(first) ^ set(second))) or "all of them"
        raise ParameterError(f"both setups need the same measures; {missing} are missing from one of them")
    changes = [math.log(first[name] / second[name]) for name in first]
    return math.sqrt(sum(change * change for change in changes) / len(changes))
