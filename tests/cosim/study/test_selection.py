"""Selection of setups for the rig, on banks whose low and high setups are known."""

from __future__ import annotations

import csv
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from cosim.study.choice.assess import certainty_of
from cosim.study.choice.certainty import Certainty, NextTest
from cosim.study.choice.rig_day import read_run_list, read_selection, select, selection_of, write_selection
from cosim.study.table import StudyResult
from eightpost.api.study_folder import StudyFolder
from eightpost.errors import FileFormatError
from tests.unchanged import refusals

from .constructed import CORNERS, result


def front(digits: np.ndarray) -> np.ndarray:
    """Low with soft builds in front; the rear has little effect, as in 7.2 for the front ride height."""
    return 10.0 + digits[:, 0] + digits[:, 1] + 1e-3 * digits[:, 2] + 1e-4 * digits[:, 3]


def rear(digits: np.ndarray) -> np.ndarray:
    return 5.0 - digits[:, 2] - digits[:, 3] + 1e-3 * digits[:, 0]


def accel(digits: np.ndarray) -> np.ndarray:
    return digits @ np.array([1.0, 2.0, -1.5, 0.5])


STUDY = result({"front": front, "rear": rear, "accel": accel})


def test_the_extreme_setups_of_every_measure_come_first():
    selection = select(STUDY, total=18)
    for measure in ("front", "rear", "accel"):
        values, chosen = STUDY.values(measure), selection.of(measure)
        low, high = (next(s for s in chosen if s.end == end) for end in ("low", "high"))
        assert (low.rank, high.rank) == (1, 1)
        assert low.value == values.min()
        assert high.value == values.max()


def test_twenty_setups_are_divided_as_in_table_7_5():
    selection = select(STUDY, share={"front": 4, "rear": 4, "accel": 2})
    assert len({selected.setup.index for selected in selection.chosen}) == 20
    counts = [
        len([s for s in selection.of(m) if s.end == e]) for m in ("front", "rear", "accel") for e in ("low", "high")
    ]
    assert counts == [4, 4, 4, 4, 2, 2]


def _certain(study: StudyResult) -> Certainty:
    """Return a certainty that proposes setups 1200 and 5; setup 9999 was not run."""
    found = certainty_of(study)
    return replace(found, tests=tuple(NextTest(setup, 0.5) for setup in (1200, 9999, 5)))


def test_the_tests_that_the_certainty_proposes_come_first_and_count_towards_the_total(tmp_path):
    selection = select(STUDY, ["front", "rear"], total=18, certainty=_certain(STUDY))
    assert [(s.setup.index, s.measure, s.end) for s in selection.chosen[:2]] == [
        (1200, "front", "test"),
        (5, "front", "test"),
    ]
    assert len({selected.setup.index for selected in selection.chosen}) == 18
    assert [s.end for s in selection.chosen[2:]] == 4 * ["low"] + 4 * ["high"] + 4 * ["low"] + 4 * ["high"]
    write_selection(selection, STUDY, tmp_path / "selection.csv")
    assert read_selection(tmp_path / "selection.csv", STUDY) == selection


def test_proposed_tests_never_displace_both_ends_of_the_measures_and_come_in_addition_to_counts():
    ends = select(STUDY, ["front", "rear"], total=4, certainty=_certain(STUDY))
    assert ends == select(STUDY, ["front", "rear"], total=4)
    counted = select(STUDY, share={"front": 2}, certainty=_certain(STUDY))
    assert [s.end for s in counted.chosen] == ["test", "test", "low", "low", "high", "high"]


def test_setups_chosen_for_an_end_are_near_that_end():
    selection = select(STUDY, total=18)
    assert max(selected.rank for selected in selection.chosen) <= 0.02 * 2401 + 18


def test_chosen_setups_differ_more_than_the_plain_extremes_do():
    def fewest_changes(setups):
        return min(sum(a.builds[c] != b.builds[c] for c in CORNERS) for a, b in combinations(setups, 2))

    selection = select(STUDY, share={"front": 4})
    plain = [STUDY.setup(int(row)) for row in np.argsort(STUDY.values("front"))[[0, 1, 2, 3, -4, -3, -2, -1]]]
    assert fewest_changes(plain) == 1
    assert selection.closest == fewest_changes([s.setup for s in selection.chosen]) == 2


def test_failed_setups_are_not_sent_to_the_rig():
    lowest = int(front(STUDY.study.space.digits(STUDY.setups)).argmin())
    chosen = {selected.setup.index for selected in select(result({"front": front}, failed=(lowest,)), total=8).chosen}
    assert lowest not in chosen


def test_the_marks_of_a_prediction_are_kept_with_the_setup():
    marked = select(result({"front": front}, marks={0: "lf tire off the ground"}), total=2)
    assert [selected.marks for selected in marked.chosen if selected.setup.index == 0] == ["lf tire off the ground"]


def test_a_selection_of_another_study_in_the_folder_is_refused(tmp_path):
    other, studied = result({"rear": rear}), result({"front": front})
    folder = StudyFolder(tmp_path, studied.study)
    folder.result = studied
    assert folder.selection is None
    write_selection(select(other, total=4), other, tmp_path / "selection.csv")
    with pytest.raises(FileFormatError, match="is not a selection of this study"):
        _ = folder.selection
    write_selection(select(studied, total=4), studied, tmp_path / "selection.csv")
    assert len(folder.selection.chosen) == 4


def test_a_selection_with_names_like_formulas_is_safe_in_a_spreadsheet_and_is_read_back(tmp_path):
    builds = ("=cmd|' /C calc'!A0", "+soft", "@firm", "-stiff")
    study = result({"=front": front, "rear": rear}, builds=builds)
    selection = select(study, total=8)
    write_selection(selection, study, tmp_path / "selection.csv")
    with (tmp_path / "selection.csv").open(encoding="utf-8", newline="") as stream:
        cells = [cell for row in csv.reader(stream) for cell in row]
    assert not [cell for cell in cells if cell[:1] in tuple("=+@") or cell == "-stiff"]
    assert [one.setup for one in read_selection(tmp_path / "selection.csv", study).chosen] == [
        one.setup for one in selection.chosen
    ]
    runs = read_run_list(tmp_path / "selection.csv", study.study)
    assert [run.setup for run in runs][: len(selection.chosen)] == [one.setup.index for one in selection.chosen]


def test_a_selection_of_one_setup_has_no_distance():
    chosen = select(STUDY, share={"front": 1}).chosen
    assert selection_of(STUDY, chosen[:1]).closest == 0
    assert selection_of(STUDY, chosen).closest == select(STUDY, share={"front": 1}).closest > 0


def test_a_selection_that_the_study_cannot_give_is_refused(unchanged):
    few = result({"front": front}, kept=np.arange(6))
    unchanged(refusals({"20 of 6": lambda: select(few), "less than each end": lambda: select(STUDY, total=4),
                        "an unknown measure": lambda: select(STUDY, ["frnt"])}))  # fmt: skip
