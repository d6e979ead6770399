"""Robust choice: which setups are better than others beyond the stated uncertainty.

Two sources of uncertainty are taken into account: unknown parameters of the shocks and the vehicle (draws of these
parameters, the same for all setups), and run-to-run noise on the rig (7.3 takes the standard deviation of five runs of
the baseline). One setup is better than another if their difference exceeds two standard deviations of that difference.
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

#: Name of the weighted sum of Eq 2.6 among the measures.
OBJECTIVE = "objective"

#: Half-width of a band, in standard deviations (Fig 7.7).
REACH = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Values of one measure of K setups with their uncertainty, in one unit.

    Attributes:
        measure: Name of the measure.
        setups: Numbers of the setups (K,).
        values: Values with the best parameters (K,); NaN if the setup failed.
        draws: Values with drawn parameters (S, K); S = 0 if shocks and vehicle are treated as known exactly.
        run_to_run: Standard deviation of one rig run; 0 to ignore run-to-run noise.
        runs: Number of rig runs of each setup that would be averaged.

    Raises:
        InputError: The shapes disagree, there is a single draw, or run_to_run or runs are invalid.
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
            raise InputError(
                f"{self.measure}: values and draws must have {self.setups.size} setups; their shapes are {found}"
            )
        if self.draws.shape[0] == 1:
            raise InputError(f"{self.measure}: a spread cannot be computed from one draw; use two or more, or none")
        if not self.run_to_run >= 0.0 or self.runs < 1:
            raise InputError(
                f"{self.measure}: run_to_run must be 0 or more and runs 1 or more, not {self.run_to_run} and "
                f"{self.runs}"
            )

    @property
    def deviation(self) -> Array:
        """Standard deviation of each level from the parameters and the run-to-run noise (K,)."""
        return np.asarray(np.sqrt(_variance(self.draws) + self._noise), dtype=np.float64)

    def difference(self, other: int) -> tuple[Array, Array]:
        """Return the differences of all setups from the one in row `other` (K,), and their standard deviations (K,)."""
        paired = _variance(self.draws - self.draws[:, other : other + 1])
        noise = np.where(np.arange(self.setups.size) == other, 0.0, 2.0 * self._noise)
        return self.values - self.values[other], np.asarray(np.sqrt(paired + noise), dtype=np.float64)

    def worse_than(self, other: int) -> Flags:
        """Return whether each setup is higher than another by more than the uncertainty of the difference (K,)."""
        above, deviation = self.difference(other)
        return np.asarray(above > REACH * deviation, dtype=np.bool_)

    def groups(self) -> tuple[Integers, ...]:
        """Return the rows of the setups, lowest first, in groups: the members of a group are tied with its first one.

        Failed setups are in no group.
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
    """Return the standard deviation of one run (M,) from measures of repeated runs of one setup (R, M).

    Raises:
        InputError: Fewer than two runs.
    """
    if repeated.shape[0] < 2:
        raise InputError(f"the run-to-run deviation needs two or more runs of one setup, not {repeated.shape[0]}")
    return np.asarray(np.std(repeated, axis=0, ddof=1), dtype=np.float64)


def spreads_of(
    result: StudyResult, draws: Sequence[StudyResult], noise: Mapping[str, float] | None = None, *, runs: int = 1
) -> tuple[Spread, ...]:
    """Return the spread of the objective, if the study has one, and of every measure.

    Args:
        result: Result with the best parameters.
        draws: Results of the drawn studies (`robust_draws`); setups that one of them lacks are omitted.
        noise: Standard deviation of one rig run by measure [SI]; 0 for measures that are not listed.
        runs: Number of rig runs of each setup that would be averaged.

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
    """Return the run-to-run deviation of the objective, with independent deviations of its measures."""
    terms = result.study.objective
    factors = [term.weight * units.conversion(result.unit(term.measure), term.unit)[0] for term in terms]
    return float(np.sqrt(sum((f * noise[term.measure]) ** 2 for f, term in zip(factors, terms, strict=True))))


def _variance(draws: Array) -> Array:
    """Return the variance (K,) of draws (S, K); 0 without draws."""
    return np.var(draws, axis=0, ddof=1) if draws.shape[0] else np.zeros(draws.shape[1])
