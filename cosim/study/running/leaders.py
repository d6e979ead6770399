"""The setups among which the best ones of a study are, in spite of the errors of its values."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cosim.study.table import StudyResult
from eightpost.array_types import Array, Flags

#: Share and least number of the setups that are leaders.
_SHARE, _LEAST = 0.01, 200

#: Factor on the stated errors, which are those of some setups, and of each of two setups that are compared.
_MARGIN = 4.0


def run_leaders(
    result: StudyResult, errors: Mapping[str, float], exact: Callable[[Sequence[int]], StudyResult]
) -> None:
    """Run the leaders exactly, and more of them if their values differ by more than the stated errors.

    Args:
        errors: Error of each measure of the result, in its SI unit.
        exact: Function that runs setups by number.
    """
    known = set[int]()
    while new := [number for number in leaders(result, errors) if number not in known]:
        found = exact(new)
        known.update(new)
        rows = np.searchsorted(result.setups, found.setups)
        apart = {name: np.abs(found.values(name) - result.values(name)[rows]) for name in errors}
        errors = {name: float(np.nanmax(apart[name], initial=error)) for name, error in errors.items()}


def leaders(result: StudyResult, errors: Mapping[str, float]) -> list[int]:
    """Return the numbers of setups whose rank matters: the best ones, and those near the best or the Pareto front.

    Args:
        errors: Error of each measure, in its SI unit.
    """
    margins = {name: _MARGIN * error for name, error in errors.items()}
    rows = np.flatnonzero(_may_be_feasible(result, margins))
    factors = {term.measure: result.factor(term) for term in result.study.objective} or {result.measures[0].name: 1.0}
    columns = np.stack([factor * result.values(name)[rows] for name, factor in factors.items()], axis=-1)
    apart = np.array([abs(factor) * margins.get(name, 0.0) for name, factor in factors.items()])
    cost = result.cost()[rows]
    limit = np.sort(cost)[: max(_LEAST, int(_SHARE * len(result)))].max(initial=-np.inf) + apart.sum()
    found: list[int] = result.setups[rows[(cost <= limit) | pareto_front(columns, apart)]].tolist()
    return found


def _may_be_feasible(result: StudyResult, margins: Mapping[str, float]) -> Flags:
    kept = result.done
    for constraint in result.study.constraints:
        values, margin = result.values(constraint.measure), margins.get(constraint.measure, 0.0)
        kept = kept & (values >= constraint.at_least - margin) & (values <= constraint.at_most + margin)
    return kept


def pareto_front(values: Array, apart: Array | float = 0.0) -> Flags:
    """Return whether each row is on the Pareto front: no other row is as low in every column and lower in one.

    Args:
        values: Responses (N, M); lower is better; a row with NaN is never on the front.
        apart: Distance from the front up to which rows are flagged, too (M,).

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
        left = left[~equal & (values[left] < best + apart).any(axis=1)]
    return front
