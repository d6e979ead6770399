"""Genetic search over builds as unordered choices, with pymoo.

It uses GA for one objective and NSGA-II for several, with uniform crossover and random mutation of builds. Setups are
evaluated in batches of one generation, so that all cores are busy; none is evaluated twice.

J. Blank, K. Deb, IEEE Access 8 (2020) 89497, doi:10.1109/ACCESS.2020.2990567; K. Deb et al., IEEE Transactions on
Evolutionary Computation 6 (2002) 182, doi:10.1109/4235.996017.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite, prod
from typing import Any, NamedTuple

import numpy as np

from cosim.study.choice.sensitivity import factors_of, indices_of, levels_of
from cosim.study.definition import Constraint, SetupSpace, Study
from cosim.study.running.evaluator import Coupling
from cosim.study.running.leaders import pareto_front
from cosim.study.running.sweep import Sweep
from cosim.study.running.workers import Workers
from cosim.study.table import StudyResult
from eightpost.array_types import Array, Flags, Integers
from eightpost.errors import InputError
from eightpost.extras import needs
from eightpost.progress import Progress

#: Constraint violation of a failed setup: larger than that of any setup that ran.
_FAILED = 1e12


class Scores(NamedTuple):
    """Objectives and constraint violations of a batch of K setups."""

    objectives: Array  #: Objectives (K, O); lower is better; NaN if the setup failed.
    #: Violation of each constraint (K, C), as a share of its limit; 0 or less if the constraint is met.
    violations: Array


def _evolve(
    run: Callable[[Integers], Scores], counts: tuple[int, ...], first: Integers, *, evaluations: int, seed: int
) -> str:
    """Generate and evaluate setups, generation by generation.

    Args:
        run: Function that evaluates setups by their levels (K, F).
        counts: Number of builds of each factor (F,).
        first: First generation (P, F); later ones have the same size.

    Returns:
        Reason why the search ended.

    Raises:
        InputError: pymoo is not installed.
    """
    scores, novelty = run(first), _Novelty()
    algorithm = _algorithm(scores, counts, first, novelty, seed)
    _tell(algorithm, algorithm.ask(), scores)
    novelty.learn(first)
    left = evaluations - first.shape[0]
    while left > 0:
        offspring = algorithm.ask()
        if offspring is None or len(offspring) == 0:
            return f"the search found no new setups after {evaluations - left} of {evaluations} evaluations"
        offspring = offspring[:left]
        levels = offspring.get("X").astype(np.int64)
        novelty.learn(levels)
        _tell(algorithm, offspring, run(levels))
        left -= len(offspring)
    return f"{evaluations} setups were evaluated"


class _Novelty:
    """Duplicate filter for pymoo that rejects all setups evaluated so far, not only those of the last generation."""

    def __init__(self) -> None:
        self._evaluated: set[tuple[int, ...]] = set()

    def learn(self, levels: Integers) -> None:
        """Add evaluated setups (K, F)."""
        self._evaluated.update(_keys(levels))

    def do(self, population: Any, *others: Any, **_: Any) -> Any:
        """Return the new setups of a pymoo population: not evaluated, not in `others`, and each once."""
        known = self._evaluated.union(*(_keys(other.get("X")) for other in others if len(other)))
        keys = _keys(population.get("X")) if len(population) else []
        return population[[n for n, key in enumerate(keys) if key not in known and key not in keys[:n]]]


def _keys(levels: Any) -> list[tuple[int, ...]]:
    return [tuple(int(level) for level in row) for row in levels]


def _algorithm(scores: Scores, counts: tuple[int, ...], first: Integers, novelty: _Novelty, seed: int) -> Any:
    """Return pymoo's algorithm, initialised with the first generation."""
    with needs("optimise", "the search of setups"):
        from pymoo.algorithms.moo.nsga2 import NSGA2  # noqa: PLC0415 - an extra
        from pymoo.algorithms.soo.nonconvex.ga import GA  # noqa: PLC0415
        from pymoo.core.problem import Problem  # noqa: PLC0415
        from pymoo.core.termination import NoTermination  # noqa: PLC0415
        from pymoo.core.variable import Choice  # noqa: PLC0415
        from pymoo.operators.crossover.ux import UX  # noqa: PLC0415
        from pymoo.operators.mutation.rm import ChoiceRandomMutation  # noqa: PLC0415
    objectives, constraints = scores.objectives.shape[1], scores.violations.shape[1] + 1
    choices = {f"factor {n}": Choice(options=list(range(count))) for n, count in enumerate(counts)}
    algorithm = (GA if objectives == 1 else NSGA2)(
        pop_size=first.shape[0],
        sampling=first.astype(object),
        crossover=UX(),
        mutation=ChoiceRandomMutation(),
        eliminate_duplicates=novelty,
    )
    problem = Problem(vars=choices, n_obj=objectives, n_ieq_constr=constraints)
    algorithm.setup(problem, seed=seed, termination=NoTermination())
    return algorithm


def _tell(algorithm: Any, population: Any, scores: Scores) -> None:
    """Pass scores to pymoo; the failure of a setup is one more constraint, violated by a large number."""
    from pymoo.core.evaluator import Evaluator  # noqa: PLC0415 - an extra
    from pymoo.problems.static import StaticProblem  # noqa: PLC0415

    failed = np.asarray(~np.isfinite(scores.objectives).all(axis=1))
    objectives = np.where(failed[:, None], 0.0, scores.objectives)
    constraints = np.column_stack([np.where(failed[:, None], 0.0, scores.violations), np.where(failed, _FAILED, 0.0)])
    Evaluator().eval(StaticProblem(algorithm.problem, F=objectives, G=constraints), population)
    algorithm.tell(infills=population)


# ==== Search for the best setups of a bank that is too large to run completely =======================================

# ---- Integer optimisation -------------------------------------------------------------------------------------------


#: Number of setups in a generation; with 7 builds at 4 corners, 10 to 40 need the same number of evaluations.
POPULATION = 20


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
    evaluate: Callable[[Integers], Scores],
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
    indices, scores = list[Integers](), list[Scores]()

    def run(levels: Integers) -> Scores:
        indices.append(indices_of(space, levels))
        scores.append(evaluate(indices[-1]))
        return scores[-1]

    status = "every setup was evaluated"
    if prod(counts) <= evaluations:
        run(np.stack(np.unravel_index(np.arange(prod(counts)), counts), axis=-1))
    else:
        first = _first_generation(counts, population, levels_of(space, np.array(start, dtype=np.int64)), seed)
        status = _evolve(run, counts, first, evaluations=evaluations, seed=seed)
    objectives, violations = (np.concatenate(part) for part in zip(*scores, strict=True))
    return Optimum(np.concatenate(indices), objectives, violations, seed, status)


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
    requested: Sweep,
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
        indices: Numbers of the setups (K,).
        objectives: Measures to minimise, in SI; empty: the study's objective, or its first measure if it has none.

    Raises:
        InputError: An objective is not a measure of the study.
    """
    rows = np.searchsorted(result.setups, indices)
    columns = [np.where(result.done, result.cost(name), np.nan) for name in objectives or ("",)]
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
