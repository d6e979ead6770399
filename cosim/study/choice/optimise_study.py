"""The search of a study's space of setups: what is minimised, within which constraints, by which runs."""

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

#: Told how many setups were tried, and the most that will be.
Progress = Callable[[int, int], None]


@dataclass(frozen=True, slots=True)
class Search:
    """What to search for.

    Attributes:
        objectives: Measures to minimise, several for their trade-offs; empty: the study's objective (Eq 2.6), or where
            it has none its first measure.
        evaluations: Most setups to try.
        seed: Of the random numbers.
    """

    objectives: tuple[str, ...] = ()
    evaluations: int = 400
    seed: int = 0


def search_study(
    requested: Requested,
    workers: Workers,
    coupling: Coupling,
    search: Search,
    progress: Progress = lambda _tried, _most: None,
) -> tuple[StudyResult, Optimum]:
    """Search a study; asked again with the same seed it takes the same way, and runs nothing that it has run.

    Returns:
        The setups that were tried, and what is best among them.

    Raises:
        InputError: An objective is no measure, the numbers make no sense, or the extra `optimise` is not installed.
    """
    study, tried = requested.study, 0

    def evaluate(indices: Integers) -> Scores:
        nonlocal tried
        result = requested.request(workers, coupling, indices.tolist())
        tried += indices.size
        progress(tried, search.evaluations)
        return scores_of(result, indices, search.objectives)

    baseline = study.baseline_setup
    start = () if baseline is None else (baseline.index,)
    found = optimise(study.space, evaluate, evaluations=search.evaluations, seed=search.seed, start=start)
    return requested.request(workers, coupling, found.indices.tolist()), found


def scores_of(result: StudyResult, indices: Integers, objectives: Sequence[str] = ()) -> Scores:
    """Return what setups reached: objectives (K, O), and violations (K, C) of the study's constraints.

    Args:
        result: That has a row of each.
        indices: (K,) numbers of the setups.
        objectives: Measures to minimise, each in SI; empty: the study's objective, else its first measure.

    Raises:
        InputError: An objective is no measure of the study.
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
    """Return by how much values (K,) break a constraint, as a share of the limit (of 1 SI unit where that is 0).

    0 or less: it is kept. A value that is NaN breaks it by infinity.
    """
    above = (values - constraint.at_most) / _scale(constraint.at_most)
    below = (constraint.at_least - values) / _scale(constraint.at_least)
    return np.nan_to_num(np.maximum(above, below), nan=inf, neginf=-1.0)


def _scale(limit: float) -> float:
    return abs(limit) if limit != 0.0 and isfinite(limit) else 1.0


def objectives_in_words(study: Study, search: Search) -> str:
    """Return what a search minimises."""
    if search.objectives:
        return "the trade-off of " * (len(search.objectives) > 1) + ", ".join(search.objectives)
    terms = " + ".join(f"{term.weight:g} x {term.measure} [{term.unit}]" for term in study.objective)
    return terms or study.measures[0].name
