"""Selection: low and high setups of each measure to confirm on the rig, spread over the bank (7.3, Table 7.5).

The lowest setups of a measure are often one setup with a rear shock changed: confirming them confirms one thing
several times. So the first of each end is the extreme setup itself, and each further one is, among the best few
percent, the one that differs in the most corners from all that were chosen before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cosim.study.choice.factor import levels_of
from cosim.study.result import StudyResult
from cosim.study.setup import Setup
from eightpost.errors import InputError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

End = Literal["low", "high"]

#: The ends of a measure, and what its values are multiplied by to have that end first.
ENDS: Mapping[End, float] = {"low": 1.0, "high": -1.0}

#: Share of the setups, from each end, among which a selection spreads: 48 of 2401.
POOL = 0.02

#: Setups to choose from for each that is wanted, where the bank is small.
_CANDIDATES = 4

#: Setups that the dissertation's rig day tested (Table 7.5).
TOTAL = 20


@dataclass(frozen=True, slots=True)
class Selected:
    """A setup to confirm.

    Attributes:
        setup: Its builds.
        measure: That it is low or high in.
        end: Which of the two.
        value: Predicted [SI].
        rank: Its place from that end, 1 for the extreme setup.
        marks: What a reader must know of its prediction, such as that a tire left the ground.
    """

    setup: Setup
    measure: str
    end: End
    value: float
    rank: int
    marks: str = ""


@dataclass(frozen=True, slots=True)
class Selection:
    """Setups to confirm on the rig, each once.

    Attributes:
        chosen: The low ones of the first measure, its high ones, those of the next measure ...
        closest: Fewest corners (or groups of corners that are alike) in which two of them differ.
    """

    chosen: tuple[Selected, ...]
    closest: int

    def of(self, measure: str) -> tuple[Selected, ...]:
        """Return those that were chosen for a measure, low ones first."""
        return tuple(selected for selected in self.chosen if selected.measure == measure)


def select(
    result: StudyResult,
    measures: Sequence[str] = (),
    *,
    total: int = TOTAL,
    share: Mapping[str, int] | None = None,
    pool: float = POOL,
) -> Selection:
    """Choose setups to confirm, the same ones every time.

    Setups that failed or break a constraint are left out.

    Args:
        result: Of the study.
        measures: To confirm; empty: those of the objective, or where there is none all.
        total: Setups in all, the same number for each end of each measure; what is left over goes to the first ones.
        share: In place of `measures` and `total`: how many of each end by measure, as Table 7.5 has 4, 4 and 2.
        pool: Share of the setups, from each end, to choose from [1].

    Raises:
        InputError: A measure is not in the study, there are fewer setups than are wanted, or fewer are wanted than
            there are ends of measures.
    """
    wanted = share if share is not None else _shares(result, measures, total)
    rows = np.flatnonzero(result.feasible)
    if (asked := 2 * sum(wanted.values())) > rows.size:
        raise InputError(f"{asked} setups cannot be selected from {rows.size} that ran and keep the constraints")
    levels = levels_of(result.study.space, result.setups)
    orders = {(name, end): _order(rows, result.values(name) * sign) for name in wanted for end, sign in ENDS.items()}
    found: dict[tuple[str, End], list[int]] = {key: [] for key in orders if wanted[key[0]]}
    taken: list[int] = []
    for key, own in found.items():
        own.append(int(orders[key][~np.isin(orders[key], taken)][0]))
        taken.append(own[0])
    for key, extreme in found.items():
        extreme.extend(_spread(orders[key], levels, taken, wanted[key[0]] - 1, pool))
    chosen = [_selected(result, key, row, orders[key]) for key, group in found.items() for row in group]
    return selection_of(result, chosen)


def selection_of(result: StudyResult, chosen: Sequence[Selected]) -> Selection:
    """Return setups of a study as a selection."""
    levels = levels_of(result.study.space, np.array([selected.setup.index for selected in chosen], dtype=np.int64))
    apart = (levels[:, None, :] != levels[None, :, :]).sum(axis=2)
    pairs = apart[np.triu_indices(levels.shape[0], 1)]
    return Selection(tuple(chosen), int(pairs.min()) if pairs.size else 0)


def _shares(result: StudyResult, measures: Sequence[str], total: int) -> dict[str, int]:
    """Return how many setups of each end each measure gets."""
    objective = dict.fromkeys(term.measure for term in result.study.objective)
    names = list(measures or objective or (measure.name for measure in result.measures))
    for name in names:
        result.study.measure(name)
    each, left = divmod(total // 2, len(names))
    if each == 0:
        raise InputError(
            f"{total} setups are fewer than one of each end of {len(names)} measures: ask for {2 * len(names)}"
        )
    return {name: each + (place < left) for place, name in enumerate(names)}


def _order(rows: Integers, values: Array) -> Integers:
    """Return rows with the least value first."""
    return rows[np.lexsort((rows, values[rows]))]


def _spread(order: Integers, levels: Integers, taken: list[int], count: int, pool: float) -> list[int]:
    """Take `count` rows more from the first ones of an order, each as far as can be from all that are taken."""
    free = order[~np.isin(order, taken)]
    candidates, own = free[: max(round(pool * order.size), _CANDIDATES * count)], list[int]()
    while len(own) < count:
        candidates = candidates[~np.isin(candidates, taken)]
        apart = (levels[candidates][:, None, :] != levels[taken][None, :, :]).sum(axis=2)
        best = int(candidates[np.lexsort((-apart.sum(axis=1), -apart.min(axis=1)))[0]])
        own.append(best)
        taken.append(best)
    return own


def _selected(result: StudyResult, key: tuple[str, End], row: int, order: Integers) -> Selected:
    name, end = key
    rank = int(np.flatnonzero(order == row)[0]) + 1
    marks: str = result.table["marks"][row].as_py()
    return Selected(result.setup(row), name, end, float(result.values(name)[row]), rank, marks)
