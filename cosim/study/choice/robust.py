"""Spread of the leading setups over draws of uncertain parameters, each of them simulated."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm, qmc

from cosim.study.certainty.certainty import OBJECTIVE
from cosim.study.result import StudyResult
from cosim.study.running.evaluator import coupling_of
from cosim.study.running.sweep import Requested
from cosim.study.running.workers import Workers
from cosim.study.study import Parameters, Study
from eightpost import units
from eightpost.array_types import Array, Flags, Integers
from eightpost.errors import InputError
from eightpost.left_out_blocks import FittedParameter, LeftOutBlocks, correlation_of, square_root

# ---- Spread of setups -----------------------------------------------------------------------------------------------


#: Half-width of a band, in standard deviations (Fig 7.7).
REACH = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Values of one measure of K setups with their uncertainty, in one unit.

    Raises:
        InputError: The shapes disagree, there is a single draw, or run_to_run or runs are invalid.
    """

    measure: str  #: Name of the measure.
    setups: Integers  #: Numbers of the setups (K,).
    values: Array  #: Values with the best parameters (K,); NaN if the setup failed.
    draws: Array  #: Values with drawn parameters (S, K); S = 0 if shocks and vehicle are treated as known exactly.
    run_to_run: float = 0.0  #: Standard deviation of one rig run; 0 to ignore run-to-run noise.
    runs: int = 1  #: Number of rig runs of each setup that would be averaged.

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

    def only(self, setups: Sequence[int]) -> Spread:
        """Return the spread of some of the setups, by number."""
        kept = np.isin(self.setups, setups)
        return replace(self, setups=self.setups[kept], values=self.values[kept], draws=self.draws[:, kept])

    @property
    def _noise(self) -> float:
        return self.run_to_run**2 / self.runs


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


# ---- Uncertain parameters of shocks and vehicle, and studies in which they are drawn --------------------------------

#: Tolerance for the symmetry and the eigenvalues of a covariance, as a share of its largest entry.
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Uncertain:
    """Parameters of one FMU with their covariance, such as that of a fit. n parameters.

    Raises:
        InputError: The shapes disagree, or the covariance is not symmetric or has negative variances.
    """

    part: str  #: Name of the build, or of the vehicle's component. A build has the same errors at every corner.
    names: tuple[str, ...]  #: Names of the FMU's parameters.
    values: Array  #: Best values (n,), each in the parameter's unit.
    covariance: Array  #: Covariance of the parameters (n, n).
    lowest: ArrayLike = -inf  #: Lower limits (n,), or one number for all; draws below are set to the limit.
    highest: ArrayLike = inf  #: Upper limits (n,), or one number for all.
    #: Changes of the parameters when blocks of the fit's test are left out; parts with the same test have correlated
    #: errors. None if they are not known.
    left_out: LeftOutBlocks | None = None

    def __post_init__(self) -> None:
        n = len(self.names)
        if np.shape(self.values) != (n,) or np.shape(self.covariance) != (n, n):
            found = f"{np.shape(self.values)} and {np.shape(self.covariance)}"
            raise InputError(
                f"{self.part}: {n} parameters need {n} values and a square covariance of that size; the shapes are "
                f"{found}"
            )
        scale = _ROUNDING * float(np.abs(self.covariance).max(initial=0.0))
        if not np.allclose(self.covariance, self.covariance.T, rtol=0.0, atol=scale):
            raise InputError(f"{self.part}: the covariance of {', '.join(self.names)} is not symmetric")
        if not np.linalg.eigvalsh(self.covariance).min(initial=0.0) >= -scale:
            raise InputError(
                f"{self.part}: the covariance of {', '.join(self.names)} has negative variances or NaN; omit the "
                "parameters that the fit did not determine"
            )

    @property
    def deviations(self) -> Array:
        """Standard deviations (n,) of the parameters."""
        return np.asarray(self.covariance.diagonal() ** 0.5)

    def at(self, standard: Array) -> Array:
        """Return parameter values (S, n) for standard normal numbers (S, n)."""
        drawn = self.values + standard @ square_root(self.covariance)
        return np.asarray(np.clip(drawn, self.lowest, self.highest), dtype=np.float64)


def drawn_studies(
    study: Study, uncertain: Sequence[Uncertain], *, draws: int, seed: int = 0, vehicles: Sequence[Path] = ()
) -> tuple[Study, ...]:
    """Return studies with drawn parameters: a Latin hypercube of their normal distribution.

    Args:
        study: Study with the best values.
        uncertain: Uncertain parameters; each parameter at most once.
        draws: Number of studies S.
        seed: Seed of the random number generator; the same seed gives the same studies.
        vehicles: FMUs of equivalent vehicles; the draws use the study's own vehicle and these in turn.

    Raises:
        InputError: Fewer than two draws, or a part is neither a build of the bank nor the vehicle.
    """
    if draws < 2:
        raise InputError(f"a spread needs two or more draws, not {draws}")
    for entry in uncertain:
        if entry.part != study.vehicle.name and entry.part not in study.bank:
            known = ", ".join((study.vehicle.name, *study.bank))
            raise InputError(f"there is no part {entry.part!r}; the parts are {known}")
    sizes = [len(entry.names) for entry in uncertain]
    uniform = qmc.LatinHypercube(max(sum(sizes), 1), rng=seed).random(draws)[:, : sum(sizes)]
    fitted = [FittedParameter(entry.left_out, name) for entry in uncertain for name in entry.names]
    standard = norm.ppf(uniform) @ square_root(correlation_of(fitted))
    parts = np.split(standard, np.cumsum(sizes)[:-1], axis=1) if sizes else []
    values = [entry.at(part) for entry, part in zip(uncertain, parts, strict=True)]
    cars = [replace(study, vehicle=replace(study.vehicle, fmu=fmu)) for fmu in (study.vehicle.fmu, *vehicles)]
    return tuple(_with(cars[s % len(cars)], uncertain, [rows[s] for rows in values]) for s in range(draws))


def _with(study: Study, uncertain: Sequence[Uncertain], values: Sequence[Array]) -> Study:
    drawn: dict[str, dict[str, float]] = {}
    for entry, row in zip(uncertain, values, strict=True):
        drawn.setdefault(entry.part, {}).update(zip(entry.names, row.tolist(), strict=True))
    bank = {n: replace(b, parameters=_over(b.parameters, drawn.get(n))) for n, b in study.bank.items()}
    vehicle = study.vehicle
    vehicle = replace(vehicle, parameters=_over(vehicle.parameters, drawn.get(vehicle.name)))
    return replace(study, bank=bank, vehicle=vehicle)


def _over(own: Parameters, drawn: Mapping[str, float] | None) -> Parameters:
    return {**own, **(drawn or {})}


# ---- Robustness of a choice -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Draws:
    """Uncertain parameters and number of draws."""

    parts: tuple[Uncertain, ...]  #: Uncertain parameters with their covariance.
    count: int = 32  #: Number of draws.
    seed: int = 0  #: Seed of the random number generator.
    vehicles: tuple[Path, ...] = ()  #: FMUs of equivalent vehicles.

    @property
    def any(self) -> bool:
        """Whether anything is uncertain."""
        return bool(self.parts or self.vehicles)


def leading(result: StudyResult, count: int, measure: str | None = None) -> Integers:
    """Return the numbers of the best setups by the objective or a measure, and of the baseline, in increasing order."""
    rows = result.ranking(measure)[:count]
    baseline = result.baseline_row
    if baseline is not None and result.done[baseline]:
        rows = np.append(rows, baseline)
    return np.unique(result.setups[rows])


def run_draws(
    result: StudyResult, folder: str | Path, workers: Workers, draws: Draws, setups: Sequence[int]
) -> Iterator[StudyResult]:
    """Run setups with every draw, with the coupling of the study; runs that are in the folder are not repeated.

    Args:
        result: Result of the study.
        folder: Folder of completed runs.
        workers: Workers that run the setups.
        draws: Uncertain parameters and number of draws.
        setups: Numbers of the setups.

    Yields:
        Results of the setups for each draw; nothing if nothing is uncertain.

    Raises:
        InputError: A part is not in the study, or an FMU lacks a parameter.
    """
    if not draws.any:
        return
    coupling = coupling_of(result)
    for study in drawn_studies(result.study, draws.parts, draws=draws.count, seed=draws.seed, vehicles=draws.vehicles):
        yield Requested(study, folder).request(workers, coupling, setups)
