"""Uncertainty of a response measure of an identified vehicle: what all setups share, and what belongs to one setup.

A study reads `MeasureUncertainty` of every measure from its car, and draws possible errors of all its setups with
`SetupErrors` (docs/explanation/vehicle_uncertainty.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from eightpost.array_types import Array
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
    setups differ the more, the more the setups differ: the scale of the difference is `own` times

        sqrt(distance^2 + change^2)

    with the `setup_distance` of the setups and the change of this measure, the logarithm of the ratio of its
    predictions. The second term is there because a model states the range of a measure over the setups too wide or too
    narrow. Errors have Student's t distribution with `DEGREES` degrees of freedom.

    Both scales contain the error of the part of the output above the band of the model, for the share of the output's
    power that the tests have there. `at_share` returns the uncertainty for another share.

    Attributes:
        common: Scale of the relative error that all setups share [1].
        own: Scale of the relative error between two setups per unit of their distance [1].
        common_above: Part of `common` from above the band, per square root of the share of power there [1].
        own_above: Part of `own` from above the band, per square root of the share of power there [1].
        share_above: Share of the output's power above the band that `common` and `own` are for [1].
    """

    common: float
    own: float
    common_above: float = 0.0
    own_above: float = 0.0
    share_above: float = 0.0

    def at_share(self, share: float) -> MeasureUncertainty:
        """Return the uncertainty of a measure with another share of its power above the band.

            common^2 = common_in_band^2 + common_above^2 share

        Args:
            share: Share of the measure's power above the upper end of the band [1].

        Raises:
            ParameterError: The share is not between 0 and 1.
        """
        if not 0.0 <= share <= 1.0:
            raise ParameterError(f"the share of power above the band is {share!r}; it must be between 0 and 1")
        change = share - self.share_above
        common, own = (
            math.sqrt(max(scale**2 + above**2 * change, 0.0))
            for scale, above in ((self.common, self.common_above), (self.own, self.own_above))
        )
        return replace(self, common=common, own=own, share_above=share)

    def interval(
        self, predicted: float, level: float = 0.95, *, distance: float = 0.0, change: float = 0.0
    ) -> tuple[float, float]:
        """Return the interval that contains the true value of a measure with a given probability.

        Args:
            predicted: Predicted value of the measure.
            level: Probability [1], between 0 and 1.
            distance: Distance of the setup from the mean of the setups on that drive, or from the tests' setup.
            change: Logarithm of the ratio of this measure of the setup and of that mean [1].

        Raises:
            ParameterError: The level is not between 0 and 1.
        """
        factor = 1.0 + self.half_width(math.hypot(distance, change), level)
        return predicted / factor, predicted * factor

    def half_width(self, distance: float, level: float = 0.95) -> float:
        """Return the relative half width of an interval [1]; see `interval`.

        Args:
            distance: Distance that includes the change of this measure [1].
            level: Probability [1], between 0 and 1.

        Raises:
            ParameterError: The level is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ParameterError(f"the level of an interval is {level!r}; it must be between 0 and 1, e.g. 0.95")
        scale = math.hypot(self.common, self.own * distance)
        return math.expm1(scale * student_quantile(0.5 + 0.5 * level))

    def probability_below(self, first: float, second: float, *, distance: float) -> float:
        """Return the probability that the first setup's true value is below that of the second; 0.5 if they are equal.

        Args:
            first: Predicted value of the first setup.
            second: Predicted value of the second setup.
            distance: Distance of the two setups.
        """
        change = math.log(second / first)
        scale = self.own * math.hypot(distance, change)
        if scale == 0.0:
            return 0.5 if change == 0.0 else float(change > 0.0)
        return student_probability(change / scale)


def student_probability(value: float) -> float:
    """Return the probability of at most a value under Student's t distribution with four degrees of freedom.

        1/2 + 3/4 r - 1/4 r^3,    r = t / sqrt(4 + t^2)

    >>> round(student_probability(2.776), 4)
    0.975

    Source: W. T. Shaw, Sampling Student's T distribution, Journal of Computational Finance 9 (2006) 37-73.
    """
    r = value / math.hypot(2.0, value)
    return 0.5 + 0.75 * r - 0.25 * r**3


def student_quantile(probability: float) -> float:
    """Return the value of a probability under Student's t distribution with four degrees of freedom.

        t = sign(p - 1/2) 2 sqrt(q - 1),    q = cos(acos(sqrt(a)) / 3) / sqrt(a),    a = 4 p (1 - p)

    >>> round(student_quantile(0.975), 3)
    2.776

    Args:
        probability: Probability [1], between 0 and 1.

    Source: W. T. Shaw, Sampling Student's T distribution, Journal of Computational Finance 9 (2006) 37-73.
    """
    root = math.sqrt(4.0 * probability * (1.0 - probability))
    size = 2.0 * math.sqrt(max(math.cos(math.acos(min(root, 1.0)) / 3.0) / root - 1.0, 0.0))
    return math.copysign(size, probability - 0.5)


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


@dataclass(frozen=True, slots=True, eq=False)
class SetupErrors:
    """Joint distribution of the errors of M measures of S setups on one drive, which is drawn from.

        ln(predicted / true) = common + (x - x_mean) g + (y - y_mean) h,    x = ln(measures) / sqrt(M)

    `common` is the same for all setups, and `y` is the logarithm of the measure itself. The gradient `g` (M,) and the
    slope `h` are normal, the same for all setups too, and their scale is `own`. So the difference of two setups has the
    scale that `MeasureUncertainty` states for every pair, and a setup has the difference from the geometric mean of the
    table as its own error. All are divided by the root of a gamma variable, which gives Student's t distribution.
    Different measures are independent.

    Attributes:
        names: Names of the M measures.
        uncertainties: Uncertainty by measure.
        positions: Position x - x_mean of each setup (S, M); NaN for a setup without measures.
    """

    names: tuple[str, ...]
    uncertainties: Mapping[str, MeasureUncertainty]
    positions: Array

    @classmethod
    def of(cls, table: Mapping[str, Array], uncertainties: Mapping[str, MeasureUncertainty]) -> SetupErrors:
        """Return the distribution for a table of predicted measures.

        Args:
            table: Predicted measures of S setups (S,), by name, positive; NaN if a setup failed. The distance of setups
                comes from all of them.
            uncertainties: Uncertainty of the measures to draw, which are in the table, for their share of power above
                the band.

        Raises:
            ParameterError: There is no measure, the measures have different numbers of setups, or one is not positive.
        """
        rows = {name: np.asarray(values, dtype=np.float64) for name, values in table.items()}
        if not rows or len({row.shape for row in rows.values()}) != 1:
            raise ParameterError("a table of measures needs at least one measure, and one value of each per setup")
        for name, row in rows.items():
            if np.any(row <= 0.0):
                raise ParameterError(
                    f"{name!r} is {float(np.nanmin(row)):g} for a setup; errors are relative, so leave out measures "
                    "that are not positive, such as means"
                )
        logarithms = np.log(np.stack(list(rows.values()), axis=1)) / math.sqrt(len(rows))
        done = np.asarray(np.isfinite(logarithms).all(axis=1), dtype=np.bool_)
        middle = logarithms[done].mean(axis=0) if done.any() else 0.0
        return cls(tuple(rows), uncertainties, np.where(done[:, None], logarithms - middle, np.nan))

    def draw(self, name: str, count: int, generator: np.random.Generator) -> Array:
        """Return drawn errors ln(predicted / true) of one measure (count, S): common plus own.

        The true values are the predicted ones times `exp(-error)`.

        Args:
            name: Measure.
            count: Number of draws.
            generator: Random number generator.
        """
        common = self.draw_common(name, count, generator)
        return common[:, None] + self.draw_own(name, count, generator)

    def draw_common(self, name: str, count: int, generator: np.random.Generator) -> Array:
        """Return drawn errors that all setups share (count,)."""
        return np.asarray(self._of(name).common * generator.standard_t(DEGREES, count))

    def draw_own(self, name: str, count: int, generator: np.random.Generator) -> Array:
        """Return drawn errors of the setups themselves (count, S), which decide which setup is better."""
        own = self._of(name).own
        level = self.names.index(name)
        gradient = generator.standard_normal((count, len(self.names)))
        gradient[:, level] += math.sqrt(len(self.names)) * generator.standard_normal(count)
        gradient /= np.sqrt(generator.chisquare(DEGREES, (count, 1)) / DEGREES)
        return np.asarray(own * gradient @ self.positions.T)

    def _of(self, name: str) -> MeasureUncertainty:
        if name not in self.uncertainties or name not in self.names:
            known = ", ".join(one for one in self.uncertainties if one in self.names) or "none"
            raise ParameterError(f"the uncertainty of {name!r} is not known; it is known for: {known}")
        return self.uncertainties[name]
