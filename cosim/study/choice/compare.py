"""Measured against predicted: do the setups rank, and lie, as the study said (7.3, Fig 7.7)?"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from cosim.study.choice.robust import REACH
from eightpost.errors import InputError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Fewest setups that a line with an uncertainty can be laid through.
FEWEST = 3

#: Simulated rig days behind the rank correlation that the noise permits, and the share of them that does better.
_DAYS, _BETTER = 2000, 0.95


@dataclass(frozen=True, slots=True)
class Line:
    """Best-fit line, measured = intercept + slope predicted, by least squares.

    Attributes:
        slope: [1].
        intercept: [unit of the measure].
        scatter: Standard deviation of the measured levels about it.
        setups: That it was laid through.
        center: Mean of the predicted levels.
        breadth: Sum of squares of the predicted levels about their mean.
    """

    slope: float
    intercept: float
    scatter: float
    setups: int
    center: float
    breadth: float

    @property
    def slope_error(self) -> float:
        """Standard error of the slope [1]."""
        return float(self.scatter / np.sqrt(self.breadth))

    def at(self, predicted: Array) -> Array:
        """Return the line's level at predicted levels (K,)."""
        return np.asarray(self.intercept + self.slope * predicted, dtype=np.float64)

    def error_at(self, predicted: Array) -> Array:
        """Return the line's standard error at predicted levels (K,)."""
        return self.scatter * np.sqrt(1.0 / self.setups + (predicted - self.center) ** 2 / self.breadth)

    def interval(self, level: float = 0.95) -> tuple[float, float]:
        """Return the confidence interval of the slope, Student's t with two fewer degrees of freedom than setups."""
        reach = float(stats.t.ppf(0.5 + 0.5 * level, self.setups - 2)) * self.slope_error
        return self.slope - reach, self.slope + reach


@dataclass(frozen=True, eq=False)
class Comparison:
    """One measure of K setups, predicted and measured, in one unit.

    Attributes:
        measure: Its name.
        setups: (K,) their numbers.
        predicted: (K,) by the study.
        measured: (K,) on the rig, repeated runs of a setup averaged.
        runs: (K,) rig runs of each setup.
        run_to_run: Standard deviation of one rig run; 0 where it is not known.

    Raises:
        InputError: Shapes disagree, there are fewer than three setups, or all predicted or measured levels are alike.
    """

    measure: str
    setups: Integers
    predicted: Array
    measured: Array
    runs: Integers
    run_to_run: float = 0.0

    def __post_init__(self) -> None:
        shapes = {self.setups.shape, self.predicted.shape, self.measured.shape, self.runs.shape}
        if len(shapes) > 1 or self.setups.size < FEWEST:
            raise InputError(f"{self.measure}: {FEWEST} setups or more must be predicted and measured, not {shapes}")
        for what, levels in (("predicted", self.predicted), ("measured", self.measured)):
            if not np.ptp(levels) > 0.0:
                raise InputError(
                    f"{self.measure}: all {what} levels are {levels[0]:g}; setups that are alike in a measure cannot "
                    "be ranked by it, so select others"
                )

    @cached_property
    def line(self) -> Line:
        """The best-fit line of measured on predicted levels."""
        slope, intercept, *_ = stats.linregress(self.predicted, self.measured)
        residual = self.measured - intercept - slope * self.predicted
        count, center = self.setups.size, float(self.predicted.mean())
        scatter = float(np.sqrt(residual @ residual / (count - 2)))
        breadth = float(np.sum((self.predicted - center) ** 2))
        return Line(float(slope), float(intercept), scatter, count, center, breadth)

    @cached_property
    def spearman(self) -> float:
        """Rank correlation, Spearman's rho: 1 where the rig ranks the setups as the study does."""
        return float(stats.spearmanr(self.predicted, self.measured).statistic)

    @cached_property
    def kendall(self) -> float:
        """Rank correlation, Kendall's tau b: share of pairs in the right order less that of pairs in the wrong one."""
        return float(stats.kendalltau(self.predicted, self.measured).statistic)

    @cached_property
    def attainable(self) -> float:
        """Spearman's rho that 95 % of rig days would reach if the true levels lay on the line: noise takes the rest.

        1 where the run-to-run deviation is not known. Seeded: the same data give the same number.
        """
        if self.run_to_run == 0.0:
            return 1.0
        line = self.line.at(self.predicted)
        noise = np.random.default_rng(0).normal(size=(_DAYS, line.size)) * self.run_to_run / np.sqrt(self.runs)
        own, days = (_standard(stats.rankdata(levels, axis=-1)) for levels in (line, line + noise))
        return float(np.quantile(days @ own, 1.0 - _BETTER))

    @property
    def band(self) -> float:
        """Half the height of the band about the line: two standard deviations of a run, else of the scatter."""
        return REACH * (self.run_to_run or self.line.scatter)

    @property
    def within(self) -> Flags:
        """(K,) which measured levels lie in the band."""
        return np.asarray(np.abs(self.measured - self.line.at(self.predicted)) <= self.band, dtype=np.bool_)

    @property
    def level_error(self) -> float:
        """RMS of predicted over measured less 1 [%]."""
        return float(100.0 * np.sqrt(np.mean((self.predicted / self.measured - 1.0) ** 2)))

    @property
    def bias(self) -> float:
        """Mean of predicted over measured less 1 [%]."""
        return float(100.0 * np.mean(self.predicted / self.measured - 1.0))


def _standard(ranks: Array) -> Array:
    """Return rows (..., K) less their mean, of length 1: their products are correlations."""
    centered = ranks - ranks.mean(axis=-1, keepdims=True)
    return np.asarray(centered / np.linalg.norm(centered, axis=-1, keepdims=True), dtype=np.float64)
