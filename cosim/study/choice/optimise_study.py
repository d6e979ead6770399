"""Search of a study's setup space: objectives, constraints and evaluation by runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np
from numpy.typing import NDArray

from cosim.study.choice.optimise import Optimum, optimise
from cosim.study.choice.optimise_genetic import Scores
from cosim.study.result import StudyResult
from cosim.study.running.evaluator import Coupling
from cosim.study.running.requested import Requested
from cosim.study.running.workers import Workers
from cosim.study.study import Constraint, Study

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Function that receives the number of setups evaluated so far and their maximum number.
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Search:
    """Objectives and settings of a search.

    Attributes:
        objectives: Measures to minimise, several for their trade-off; empty: the study's objective (Eq 2.6), or its
            first measure if it has none.
        evaluations: Maximum number of setups to evaluate.
        seed: Seed of the random number generator.
    """

    objectives: tuple[str, ...] = ()
    evaluations: int = 400
    seed: int = 0


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
