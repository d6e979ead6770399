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

#: Size of the part of an own error that only neighbouring setups share, per unit of `own`, and how near they are [1].
LOCAL, REACH = 0.05, 0.04

#: Number of frequencies of `local_features`.
_FREQUENCIES = 32

#: Measure of the sum of the tire forces of all wheels.
TOTAL = "total_tire_force"


@dataclass(frozen=True, slots=True)
class MeasureUncertainty:
    """Uncertainty of the RMS of an output on a drive, for setups that the vehicle was not tested with.

        ln(predicted / true) = common + own(setup)

    All setups on one drive share the common error, so it says nothing on which of them is better. The own errors of two
    setups differ the more, the more the setups differ: the scale of the difference is `own` times their `separation`.
    Errors have Student's t distribution with `DEGREES` degrees of freedom.

    Both scales contain the error of the part of the output above the band of the model, for the share of the output's
    power that the tests have there. `at_share` returns the uncertainty for another share.
    """

    common: float  #: Scale of the relative error that all setups share [1].
    own: float  #: Scale of the relative error between two setups per unit of their distance [1].
    common_above: float = 0.0  #: Part of `common` from above the band, per square root of the share of power there [1].
    own_above: float = 0.0  #: Part of `own` from above the band, per square root of the share of power there [1].
    share_above: float = 0.0  #: Share of the output's power above the band that `common` and `own` are for [1].

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
        factor = 1.0 + self.half_width(separation(distance, change), level)
        return predicted / factor, predicted * factor

    def half_width(self, apart: float, level: float = 0.95) -> float:
        """Return the relative half width of an interval [1]; see `interval`.

        Args:
            apart: Separation of the setups [1].
            level: Probability [1], between 0 and 1.

        Raises:
            ParameterError: The level is not between 0 and 1.
        """
        if not 0.0 < level < 1.0:
            raise ParameterError(f"the level of an interval is {level!r}; it must be between 0 and 1, e.g. 0.95")
        scale = math.hypot(self.common, self.own * apart)
        return math.expm1(scale * student_quantile(0.5 + 0.5 * level))

    def probability_below(self, first: float, second: float, *, distance: float) -> float:
        """Return the probability that the first setup's true value is below that of the second; 0.5 if they are equal.

        Args:
            first: Predicted value of the first setup.
            second: Predicted value of the second setup.
            distance: Distance of the two setups.
        """
        change = math.log(second / first)
        scale = self.own * separation(distance, change)
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


def separation(distance: float, change: float) -> float:
    """Return how far two setups are apart for a measure, as its own error sees it.

        sqrt(d^2 + c^2 + 2 L^2 (1 - exp(-d^2 / (2 R^2))))

    The first term is a gradient of the error over all measures. The second one is an error of the range of the measure
    itself over the setups, which a model states too wide or too narrow. The third one is an error that setups share
    only with those that are nearer than `REACH`, of size `LOCAL`.

    Args:
        distance: `setup_distance` d of the setups.
        change: Logarithm c of the ratio of the measure's predictions.
    """
    local = -2.0 * LOCAL**2 * math.expm1(-0.5 * (distance / REACH) ** 2)
    return math.hypot(distance, change, math.sqrt(local))


def local_features(positions: Array) -> Array:
    """Return features (S, F) of setups at positions (S, M): their products are those of the local part of the error.

        phi(x) . phi(y) ~ L^2 exp(-|x - y|^2 / (2 R^2))

    A random gradient over the features is a random smooth function of the position. Source: A. Rahimi, B. Recht, Random
    features for large-scale kernel machines (NIPS 2007); here the frequencies have the exact second moments.
    """
    size = positions.shape[1]
    frequencies = np.random.default_rng(0).standard_normal((_FREQUENCIES, size))
    if 0 < size < _FREQUENCIES:
        left, _, right = np.linalg.svd(frequencies, full_matrices=False)
        frequencies = math.sqrt(_FREQUENCIES) * left @ right
    phases = positions @ frequencies.T / REACH
    return np.asarray(LOCAL / math.sqrt(_FREQUENCIES) * np.hstack([np.cos(phases), np.sin(phases)]))


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

        ln(predicted / true) = common + (x - x_mean) g + (y - y_mean) h + phi(x) f,    x = ln(measures) / sqrt(M)

    `common` is the same for all setups, `y` is the logarithm of the measure itself, and `phi` are `local_features`. The
    gradients `g` and `f` and the slope `h` are normal, the same for all setups too, and their scale is `own`. So the
    difference of two setups has the scale that `MeasureUncertainty` states for every pair, and a setup has the
    difference from the geometric mean of the table as its own error. All are divided by the root of a gamma variable,
    which gives Student's t distribution. Different measures are independent.
    """

    names: tuple[str, ...]  #: Names of the M measures.
    uncertainties: Mapping[str, MeasureUncertainty]  #: Uncertainty by measure.
    positions: Array  #: Position x - x_mean of each setup (S, M); NaN for a setup without measures.

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
        features = local_features(self.positions)
        gradient = generator.standard_normal((count, len(self.names)))
        gradient[:, level] += math.sqrt(len(self.names)) * generator.standard_normal(count)
        drawn = gradient @ self.positions.T + generator.standard_normal((count, features.shape[1])) @ features.T
        return np.asarray(own * drawn / np.sqrt(generator.chisquare(DEGREES, (count, 1)) / DEGREES))

    def _of(self, name: str) -> MeasureUncertainty:
        if name not in self.uncertainties or name not in self.names:
            known = ", ".join(one for one in self.uncertainties if one in self.names) or "none"
            raise ParameterError(f"the uncertainty of {name!r} is not known; it is known for: {known}")
        return self.uncertainties[name]
