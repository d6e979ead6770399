"""Search for the best setups of a bank that is too large to run completely."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import inf, isfinite, prod

import numpy as np

from cosim.study.choice.optimise_genetic import Scores, evolve
from cosim.study.choice.sensitivity import factors_of, indices_of, levels_of
from cosim.study.result import StudyResult
from cosim.study.running.evaluator import Coupling
from cosim.study.running.sweep import Requested
from cosim.study.running.workers import Workers
from cosim.study.study import Constraint, SetupSpace, Study
from eightpost.array_types import Array, Flags, Integers
from eightpost.errors import InputError
from eightpost.progress import Progress

# ---- Pareto front of setups and its hypervolume ---------------------------------------------------------------------


def pareto_front(values: Array) -> Flags:
    """Return whether each row is on the Pareto front: no other row is as low in every column and lower in one.

    Args:
        values: Responses (N, M); lower is better; a row with NaN is never on the front.

    Returns:
        Flags (N,); equal rows have equal flags.
    """
    known = np.flatnonzero(np.isfinite(values).all(axis=1))
    left = known[np.lexsort(values[known].T[::-1])]  # a row that dominates another one precedes it
    front = np.zeros(values.shape[0], dtype=bool)
    while left.size:
        best = values[left[0]]
        equal = (values[left] == best).all(axis=1)
        front[left[equal]] = True
        left = left[(values[left] < best).any(axis=1)]
    return front


def hypervolume(values: Array, reference: Array) -> float:
    """Return the hypervolume that a set of setups dominates, up to a reference point.

    The volume is sliced along the last response, recursively; this is suitable for fronts of up to some hundred setups.

    Args:
        values: Responses (N, M); lower is better.
        reference: Reference point (M,); setups that do not dominate it are ignored.

    Returns:
        Hypervolume, in the product of the M units.
    """
    front = values[(values < reference).all(axis=1)]
    front = np.unique(front[pareto_front(front)], axis=0)
    if front.shape[0] == 0:
        return 0.0
    if front.shape[1] == 1:
        return float(reference[0] - front.min())
    front = front[np.argsort(front[:, -1], kind="stable")]
    heights = np.diff(front[:, -1], append=reference[-1])
    slices = (hypervolume(front[: n + 1, :-1], reference[:-1]) for n in range(front.shape[0]))
    return float(sum(area * height for area, height in zip(slices, heights, strict=True)))


# ---- Integer optimisation -------------------------------------------------------------------------------------------


#: Number of setups in a generation; with 7 builds at 4 corners, 10 to 40 need the same number of evaluations.
POPULATION = 20

Evaluate = Callable[[Integers], Scores]


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """All setups that an optimisation evaluated. N setups, O objectives, C constraints."""

    indices: Integers  #: Numbers of the setups (N,) in the order of evaluation, each once.
    objectives: Array  #: Objectives (N, O); lower is better.
    violations: Array  #: Constraint violations (N, C), as shares of the limits.
    seed: int  #: Seed of the random number generator.
    status: str  #: Reason why the search ended.

    @property
    def allowed(self) -> Flags:
        """Whether each setup ran and meets every constraint (N,)."""
        ran, kept = np.isfinite(self.objectives).all(axis=1), (self.violations <= 0.0).all(axis=1)
        return np.asarray(ran & kept, dtype=np.bool_)

    @property
    def best(self) -> int | None:
        """Number of the feasible setup with the lowest first objective; None if no setup is feasible."""
        rows = np.flatnonzero(self.allowed)
        if rows.size == 0:
            return None
        return int(self.indices[rows[np.lexsort((self.indices[rows], self.objectives[rows, 0]))[0]]])

    @property
    def front(self) -> Integers:
        """Numbers of the setups on the Pareto front of the feasible ones, in increasing order."""
        values = np.where(self.allowed[:, None], self.objectives, np.nan)
        return np.sort(self.indices[pareto_front(values)])


def optimise(
    space: SetupSpace,
    evaluate: Evaluate,
    *,
    evaluations: int,
    seed: int = 0,
    population: int = POPULATION,
    start: Sequence[int] = (),
) -> Optimum:
    """Search a space of setups for the lowest objectives; the same seed gives the same setups.

    Args:
        space: Space to search (Theta of Eq 2.3); it is evaluated completely if `evaluations` suffices.
        evaluate: Function that runs setups by number (K,).
        evaluations: Maximum number of setups to evaluate.
        seed: Seed of the random number generator.
        population: Number of setups in a generation, at most `evaluations`.
        start: Numbers of setups that the first generation contains, such as the baseline.

    Raises:
        InputError: `evaluations` or `population` is below 2, or the extra `optimise` is not installed.
    """
    population = min(population, evaluations)
    if population < 2:
        raise InputError(
            f"a search needs two setups or more per generation and two evaluations or more, not {population}"
        )
    factors = factors_of(space)
    counts = tuple(len(factor.builds) for factor in factors)
    trials = _Trials(space, evaluate)
    if prod(counts) <= evaluations:
        trials.run(np.stack(np.unravel_index(np.arange(prod(counts)), counts), axis=-1))
        return trials.optimum(seed, "every setup was evaluated")
    first = _first_generation(counts, population, levels_of(space, np.array(start, dtype=np.int64)), seed)
    status = evolve(trials.run, counts, first, evaluations=evaluations, seed=seed)
    return trials.optimum(seed, status)


@dataclass(slots=True)
class _Trials:
    """Setups evaluated so far."""

    space: SetupSpace  #: Space of the setups.
    evaluate: Evaluate  #: Function that runs setups by number.
    indices: list[Integers] = field(default_factory=list)  #: Numbers of the setups, batch by batch.
    scores: list[Scores] = field(default_factory=list)  #: Objectives and violations of the setups, batch by batch.

    def run(self, levels: Integers) -> Scores:
        """Evaluate a batch of setups by their levels (K, F)."""
        self.indices.append(indices_of(self.space, levels))
        self.scores.append(self.evaluate(self.indices[-1]))
        return self.scores[-1]

    def optimum(self, seed: int, status: str) -> Optimum:
        """Return the evaluated setups with the reason why the search ended."""
        objectives, violations = (np.concatenate(part) for part in zip(*self.scores, strict=True))
        return Optimum(np.concatenate(self.indices), objectives, violations, seed, status)


def _first_generation(counts: tuple[int, ...], population: int, start: Integers, seed: int) -> Integers:
    """Return different setups (P, F): `start`, then setups with every build equally frequent at every position."""
    generator = np.random.default_rng(seed)
    chosen = dict.fromkeys(tuple(row) for row in start.tolist())
    while len(chosen) < population:
        columns = [generator.permutation(np.arange(population) % count) for count in counts]
        chosen |= dict.fromkeys(tuple(row) for row in np.stack(columns, axis=-1).tolist())
    return np.array(list(chosen)[:population], dtype=np.int64)


# ---- Search of a study's setup space --------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Search:
    """Objectives and settings of a search."""

    #: Measures to minimise, several for their trade-off; empty: the study's objective (Eq 2.6), or its first measure if
    #: it has none.
    objectives: tuple[str, ...] = ()
    evaluations: int = 400  #: Maximum number of setups to evaluate.
    seed: int = 0  #: Seed of the random number generator.


def search_study(
    requested: Requested,
    workers: Workers,
    coupling: Coupling,
    search: Search,
    progress: Progress = lambda _evaluated, _maximum: None,
) -> tuple[StudyResult, Optimum]:
    """Search a study; a repeated search with the same seed evaluates the same setups and runs none of them again.

    Returns:
        Results of the evaluated setups, and the best of them.

    Raises:
        InputError: An objective is not a measure, a setting is invalid, or the extra `optimise` is not installed.
    """
    study, evaluated = requested.study, 0

    def evaluate(indices: Integers) -> Scores:
        nonlocal evaluated
        result = requested.request(workers, coupling, indices.tolist())
        evaluated += indices.size
        progress(evaluated, search.evaluations)
        return scores_of(result, indices, search.objectives)

    baseline = study.baseline_setup
    start = () if baseline is None else (baseline.index,)
    found = optimise(study.space, evaluate, evaluations=search.evaluations, seed=search.seed, start=start)
    return requested.request(workers, coupling, found.indices.tolist()), found


def scores_of(result: StudyResult, indices: Integers, objectives: Sequence[str] = ()) -> Scores:
    """Return the scores of setups: objectives (K, O), and violations (K, C) of the study's constraints.

    Args:
        result: Result that contains all of the setups.
        indices: Numbers of the setups (K,).
        objectives: Measures to minimise, in SI; empty: the study's objective, or its first measure if it has none.

    Raises:
        InputError: An objective is not a measure of the study.
    """
    rows = np.searchsorted(result.setups, indices)
    own = result.objective
    if not objectives and own is not None:
        columns = [np.where(result.done, own, np.nan)]
    else:
        columns = [result.values(name) for name in objectives or (result.measures[0].name,)]
    kept = [violation(result.values(c.measure), c)[rows] for c in result.study.constraints]
    none = np.empty((indices.size, 0))
    return Scores(np.stack(columns, axis=-1)[rows], np.stack(kept, axis=-1) if kept else none)


def violation(values: Array, constraint: Constraint) -> Array:
    """Return the violation of a constraint by values (K,), as a share of the limit (per SI unit if the limit is 0).

    The constraint is met if the violation is 0 or less. The violation of NaN is infinite.
    """
    above = (values - constraint.at_most) / _scale(constraint.at_most)
    below = (constraint.at_least - values) / _scale(constraint.at_least)
    return np.nan_to_num(np.maximum(above, below), nan=inf, neginf=-1.0)


def _scale(limit: float) -> float:
    return abs(limit) if limit != 0.0 and isfinite(limit) else 1.0


def objectives_in_words(study: Study, search: Search) -> str:
    """Return a description of what a search minimises."""
    if search.objectives:
        return "the trade-off between " * (len(search.objectives) > 1) + ", ".join(search.objectives)
    terms = " + ".join(f"{term.weight:g} x {term.measure} [{term.unit}]" for term in study.objective)
    return terms or study.measures[0].name
