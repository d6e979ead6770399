"""Robust choice: which setups are better than others, said only where it is so.

Two things blur a measure: what is not known of shocks and vehicle (draws of their parameters, the same for all
setups), and that no two runs on the rig are alike (7.3 takes the standard deviation of five runs of the baseline).
One setup is better than another where their difference exceeds two standard deviations of that difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cosim.study.result import StudyResult
from eightpost import units
from eightpost.errors import InputError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: What the weighted sum of Eq 2.6 is called among the measures.
OBJECTIVE = "objective"

#: Standard deviations that a band reaches to either side (Fig 7.7).
REACH = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """One measure of K setups, in one unit, with what blurs it.

    Attributes:
        measure: Its name.
        setups: (K,) their numbers.
        values: (K,) with the best parameters; NaN where the setup failed.
        draws: (S, K) with drawn parameters; S = 0 where shocks and vehicle are taken as known.
        run_to_run: Standard deviation of one rig run; 0 where it is not asked whether the rig would show it.
        runs: Rig runs of each setup that would be averaged.

    Raises:
        InputError: Shapes disagree, there is a single draw, or run_to_run or runs make no sense.
    """

    measure: str
    setups: Integers
    values: Array
    draws: Array
    run_to_run: float = 0.0
    runs: int = 1

    def __post_init__(self) -> None:
        if self.values.shape != self.setups.shape or self.draws.shape[1:] != self.setups.shape:
            found = f"{self.values.shape} and {self.draws.shape}"
            raise InputError(f"{self.measure}: values and draws must be of {self.setups.size} setups, not {found}")
        if self.draws.shape[0] == 1:
            raise InputError(f"{self.measure}: one draw says nothing of a spread; make two or more, or none")
        if not self.run_to_run >= 0.0 or self.runs < 1:
            raise InputError(f"{self.measure}: a run-to-run deviation of {self.run_to_run} over {self.runs} runs")

    @property
    def deviation(self) -> Array:
        """(K,) standard deviation of each level: from the parameters and from run to run."""
        return np.asarray(np.sqrt(_variance(self.draws) + self._noise), dtype=np.float64)

    def difference(self, other: int) -> tuple[Array, Array]:
        """Return how far all setups (K,) lie above one of them, by its row, and the standard deviation of that (K,)."""
        paired = _variance(self.draws - self.draws[:, other : other + 1])
        noise = np.where(np.arange(self.setups.size) == other, 0.0, 2.0 * self._noise)
        return self.values - self.values[other], np.asarray(np.sqrt(paired + noise), dtype=np.float64)

    def worse_than(self, other: int) -> Flags:
        """Return which setups (K,) are higher than one of them by more than the uncertainty of the difference."""
        above, deviation = self.difference(other)
        return np.asarray(above > REACH * deviation, dtype=np.bool_)

    def groups(self) -> tuple[Integers, ...]:
        """Return the rows of the setups, lowest first, in groups: no member is told from the first.

        A failed setup is in none.
        """
        left = np.argsort(self.values, kind="stable")
        left = left[np.isfinite(self.values[left])]
        found = []
        while left.size:
            worse = self.worse_than(int(left[0]))[left]
            found.append(left[~worse])
            left = left[worse]
        return tuple(found)

    def only(self, setups: Sequence[int]) -> Spread:
        """Return the spread of some of the setups, by number."""
        kept = np.isin(self.setups, setups)
        return replace(self, setups=self.setups[kept], values=self.values[kept], draws=self.draws[:, kept])

    @property
    def _noise(self) -> float:
        return self.run_to_run**2 / self.runs


def run_to_run(repeated: Array) -> Array:
    """Return the standard deviation (M,) of one run from measures (R, M) of repeated runs of one setup.

    Raises:
        InputError: Fewer than two runs.
    """
    if repeated.shape[0] < 2:
        raise InputError(f"the deviation from run to run needs two runs of one setup or more, not {repeated.shape[0]}")
    return np.asarray(np.std(repeated, axis=0, ddof=1), dtype=np.float64)


def spreads_of(
    result: StudyResult, draws: Sequence[StudyResult], noise: Mapping[str, float] | None = None, *, runs: int = 1
) -> tuple[Spread, ...]:
    """Return the spread of the objective, where the study has one, and of every measure.

    Args:
        result: With the best parameters.
        draws: Results of the drawn studies (`robust_draws`); setups that one of them lacks are left out.
        noise: Standard deviation of one rig run by measure [SI]; a measure that is not named has none.
        runs: Rig runs of each setup that would be averaged.

    Raises:
        InputError: `noise` names a measure that the study lacks, or there is one draw only.
    """
    deviations = {measure.name: 0.0 for measure in result.measures}
    for name, deviation in (noise or {}).items():
        deviations[result.study.measure(name).name] = deviation
    if result.study.objective:
        deviations = {OBJECTIVE: _objective_noise(result, deviations), **deviations}
    shared = result.setups
    for drawn in draws:
        shared = np.intersect1d(shared, drawn.setups)
    return tuple(_spread(name, shared, (result, *draws), noise, runs) for name, noise in deviations.items())


def _spread(name: str, setups: Integers, results: Sequence[StudyResult], noise: float, runs: int) -> Spread:
    best, *rows = (_values(result, name)[np.isin(result.setups, setups)] for result in results)
    return Spread(name, setups, best, np.stack(rows) if rows else np.empty((0, setups.size)), noise, runs)


def _values(result: StudyResult, name: str) -> Array:
    objective = result.objective if name == OBJECTIVE else None
    return result.values(name) if objective is None else np.where(result.done, objective, np.nan)


def _objective_noise(result: StudyResult, noise: Mapping[str, float]) -> float:
    """Return the deviation of the objective over runs, whose measures are taken to vary each by itself."""
    terms = result.study.objective
    factors = [term.weight * units.conversion(result.unit(term.measure), term.unit)[0] for term in terms]
    return float(np.sqrt(sum((f * noise[term.measure]) ** 2 for f, term in zip(factors, terms, strict=True))))


def _variance(draws: Array) -> Array:
    """Return the variance (K,) of draws (S, K); 0 without any."""
    return np.var(draws, axis=0, ddof=1) if draws.shape[0] else np.zeros(draws.shape[1])
