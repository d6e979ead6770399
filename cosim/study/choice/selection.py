"""Selection of setups to confirm on the rig."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from cosim.study.choice.certainty import OBJECTIVE, Certainty
from cosim.study.choice.sensitivity import levels_of
from cosim.study.definition import Setup
from cosim.study.table import StudyResult
from eightpost import units
from eightpost.array_types import Array, Integers
from eightpost.errors import FileFormatError, InputError
from eightpost.files import MALFORMED, atomic_path, plain_cell, read_text, write_rows

# ---- Selection of low and high setups of each measure for the rig, spread over the bank (7.3, Table 7.5) ------------

#: Low or high in a measure, or a test that the certainty of the study proposes.
End = Literal["low", "high", "test"]

_ENDS: tuple[End, ...] = get_args(End)

#: Factor on the values of a measure that puts each end first.
ENDS: Mapping[End, float] = {"low": 1.0, "high": -1.0}

#: Share of the setups at each end from which to choose: 48 of 2401.
POOL = 0.02

#: Minimum number of candidates per selected setup, for small banks.
_CANDIDATES = 4

#: Number of setups that the dissertation tested on a rig day (Table 7.5).
TOTAL = 20


@dataclass(frozen=True, slots=True)
class Selected:
    """A setup to confirm on the rig."""

    setup: Setup  #: The setup.
    measure: str  #: Measure for which the setup was selected; for a proposed test of the objective, its first measure.
    end: End  #: Whether the setup is low or high in the measure, or a proposed test.
    value: float  #: Predicted value [SI].
    rank: int  #: Position from that end, for a test from the low end; 1 for the extreme setup.
    marks: str = ""  #: Marks of the prediction, such as a tire off the ground.


@dataclass(frozen=True, slots=True)
class Selection:
    """Setups to confirm on the rig, each once."""

    #: Setups in the order: proposed tests, low ones of the first measure, its high ones, those of the next measure, and
    #: so on.
    chosen: tuple[Selected, ...]
    closest: int  #: Minimum number of corners (or groups of corners that are alike) in which two of them differ.

    @property
    def setups(self) -> dict[str, set[int]]:
        """Numbers of the setups by the measure for which they were chosen."""
        return {name: {one.setup.index for one in self.of(name)} for name in (s.measure for s in self.chosen)}

    def of(self, measure: str) -> tuple[Selected, ...]:
        """Return the setups that were chosen for a measure, low ones first."""
        return tuple(selected for selected in self.chosen if selected.measure == measure)


def select(
    result: StudyResult,
    measures: Sequence[str] = (),
    *,
    total: int = TOTAL,
    share: Mapping[str, int] | None = None,
    pool: float = POOL,
    certainty: Certainty | None = None,
) -> Selection:
    """Choose setups to confirm on the rig; the same input gives the same setups.

    The tests that decide most about the best setup come first, if the certainty of the study is known. Setups that
    failed or break a constraint are excluded.

    Args:
        measures: Measures to confirm; empty: those of the objective, or all if the study has no objective.
        total: Total number of setups. Those that are not proposed tests are divided equally among the ends of all
            measures; the first ones get the remainder.
        share: Number of setups at each end by measure (Table 7.5 has 4, 4 and 2); replaces `measures` and `total`;
            proposed tests come in addition.
        pool: Share of the setups at each end from which to choose [1].
        certainty: Certainty of the study, whose next tests are selected; None selects none.

    Raises:
        InputError: A measure is not in the study, there are fewer setups than requested, or fewer are requested than
            there are ends of measures.
    """
    rows, tests = np.flatnonzero(result.feasible), list[Selected]()
    if share is None:
        names = _names(result, measures, total)
        tests = _tests(result, rows, certainty, total - 2 * len(names))
        each, left = divmod((total - len(tests)) // 2, len(names))
        counts: Mapping[str, int] = {name: each + (place < left) for place, name in enumerate(names)}
    else:
        counts = share
        tests = _tests(result, rows, certainty, rows.size - 2 * sum(share.values()))
    if (requested := 2 * sum(counts.values())) > rows.size:
        raise InputError(
            f"{requested} setups cannot be selected, because only {rows.size} ran and meet the constraints"
        )
    levels = levels_of(result.study.space, result.setups)
    orders = {(name, end): _order(rows, result.values(name) * sign) for name in counts for end, sign in ENDS.items()}
    found: dict[tuple[str, End], list[int]] = {key: [] for key in orders if counts[key[0]]}
    taken = [int(np.flatnonzero(result.setups == test.setup.index)[0]) for test in tests]
    for key, own in found.items():
        own.append(int(orders[key][~np.isin(orders[key], taken)][0]))
        taken.append(own[0])
    for key, extreme in found.items():
        extreme.extend(_spread(orders[key], levels, taken, counts[key[0]] - 1, pool))
    chosen = [_selected(result, key, row, orders[key]) for key, group in found.items() for row in group]
    return selection_of(result, [*tests, *chosen])


def selection_of(result: StudyResult, chosen: Sequence[Selected]) -> Selection:
    """Return a selection of setups of a study."""
    levels = levels_of(result.study.space, np.array([selected.setup.index for selected in chosen], dtype=np.int64))
    apart = (levels[:, None, :] != levels[None, :, :]).sum(axis=2)
    pairs = apart[np.triu_indices(levels.shape[0], 1)]
    return Selection(tuple(chosen), int(pairs.min()) if pairs.size else 0)


def _tests(result: StudyResult, rows: Integers, certainty: Certainty | None, most: int) -> list[Selected]:
    """Return at most `most` next tests of a certainty that ran and meet the constraints."""
    if certainty is None or most <= 0:
        return []
    is_sum = certainty.criterion == OBJECTIVE
    name = result.study.objective[0].measure if is_sum else certainty.criterion
    order, places = _order(rows, result.values(name)), {int(result.setups[row]): int(row) for row in rows}
    found = [places[test.setup] for test in certainty.tests if test.setup in places]
    return [_selected(result, (name, "test"), row, order) for row in found[:most]]


def _names(result: StudyResult, measures: Sequence[str], total: int) -> list[str]:
    """Return the measures to confirm, at both ends each."""
    objective = dict.fromkeys(term.measure for term in result.study.objective)
    names = list(measures or objective or (measure.name for measure in result.measures))
    for name in names:
        result.study.measure(name)
    if total // 2 < len(names):
        raise InputError(
            f"{total} setups are too few for both ends of {len(names)} measures; select {2 * len(names)} or more"
        )
    return names


def _order(rows: Integers, values: Array) -> Integers:
    """Return rows sorted by value, lowest first."""
    return rows[np.lexsort((rows, values[rows]))]


def _spread(order: Integers, levels: Integers, taken: list[int], count: int, pool: float) -> list[int]:
    """Take `count` more rows from the first ones of an order, each as different as possible from all rows taken."""
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


# ---- CSV file of the setups to test on the rig, to which the measured runs are added --------------------------------

#: Number of baseline runs, from which the run-to-run deviation is computed (7.3).
BASELINE_RUNS = 5

#: Number of selected setups that are run twice: what drifts from run to run moves other setups more than the baseline.
TWICE = 4


def write_selection(selection: Selection, result: StudyResult, path: str | Path, *, twice: int = TWICE) -> None:
    """Write the setups to test, one line each, then second runs of some, then the runs of the baseline if there is one.

    The column `file` names the record that `eightpost study compare --measured` reads from the folder of the list.

    Args:
        twice: Maximum number of setups with a second run; see `repeated`.
    """
    corners = tuple(result.study.corners)
    rows = [_row(number, result, selected.setup.index) for number, selected in enumerate(selection.chosen, start=1)]
    for row, selected in zip(rows, selection.chosen, strict=True):
        unit = result.display(selected.measure)
        predicted = float(units.convert(selected.value, result.unit(selected.measure), unit))
        row |= {"measure": selected.measure, "end": selected.end, "predicted": f"{predicted:.6g}", "unit": unit}
        row |= {"place": str(selected.rank), "marks": selected.marks}
    baseline = result.study.baseline_setup
    runs = [("repeat", setup) for setup in repeated(selection, twice)]
    runs += [("baseline", baseline.index)] * BASELINE_RUNS if baseline is not None else []
    rows += [{**_row(number, result, setup), "end": end} for number, (end, setup) in enumerate(runs, len(rows) + 1)]
    names = ("run", "file", "setup", *corners, "measure", "end", "predicted", "unit", "place", "marks")
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        write_rows(stream, [names, *([row.get(name, "") for name in names] for row in rows)], end="\r\n")


def repeated(selection: Selection, twice: int = TWICE) -> list[int]:
    """Return the numbers of at most `twice` setups that are run again: the first one of each end of each measure."""
    first = dict[tuple[str, End], int]()
    for one in selection.chosen:
        if one.end in ENDS:
            first.setdefault((one.measure, one.end), one.setup.index)
    return list(first.values())[:twice]


def read_selection(path: str | Path, result: StudyResult) -> Selection:
    """Read a list of `write_selection` for the same study; values are taken from the study.

    Raises:
        FileFormatError: The file is not a selection of this study.
    """
    path = Path(path)
    text = read_text(path)
    try:
        heads, *lines = csv.reader(io.StringIO(text, newline=""))
        rows = [dict(zip(map(plain_cell, heads), map(plain_cell, line), strict=True)) for line in lines if line]
        return selection_of(result, [_read(row, result) for row in rows if row["end"] in _ENDS])
    except (csv.Error, *MALFORMED) as error:
        raise FileFormatError(
            f"is not a selection of this study ({error}); run `eightpost study select` again", path=path
        ) from error


def _read(row: dict[str, str], result: StudyResult) -> Selected:
    setup = result.study.space.setup(int(row["setup"]))
    if (place := result.row(setup.builds)) is None:
        raise InputError(f"setup {setup.index} was not run in the study")
    value = float(result.values(row["measure"])[place])
    (end,) = (end for end in _ENDS if end == row["end"])
    return Selected(setup, row["measure"], end, value, int(row["place"]), row["marks"])


def _row(number: int, result: StudyResult, setup: int) -> dict[str, str]:
    builds = result.study.space.setup(setup).builds
    return {"run": str(number), "file": f"run_{number:02d}.parquet", "setup": str(setup), **builds}
