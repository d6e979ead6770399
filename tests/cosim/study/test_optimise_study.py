"""Searches of studies: runs of the FMUs, none twice, and constraints."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from cosim.study.choice.optimise import Search, scores_of, search_study, violation
from cosim.study.definition import Constraint, Term
from cosim.study.running.sweep import Sweep, run_study
from eightpost.errors import InputError

from .constructed import result
from .coupled import COUPLING, InProcess, study


@pytest.fixture(scope="module")
def exhaustive(fmus, tmp_path_factory):
    folder = tmp_path_factory.mktemp("exhaustive")
    return folder, run_study(study(fmus), folder, InProcess())


def test_a_search_runs_the_fmus_as_the_exhaustive_study_does(fmus, exhaustive, tmp_path):
    _, whole = exhaustive
    table, found = search_study(Sweep(study(fmus), tmp_path), InProcess(), COUPLING, Search(evaluations=15))
    assert found.best == whole.setups[whole.ranking()[0]]
    rows = np.searchsorted(whole.setups, table.setups)
    np.testing.assert_array_equal(table.values("front ride height"), whole.values("front ride height")[rows])


def test_a_search_begins_with_the_baseline(fmus, tmp_path):
    made = study(fmus)
    _, found = search_study(Sweep(made, tmp_path), InProcess(), COUPLING, Search(evaluations=4))
    assert found.indices[0] == made.baseline_setup.index


def test_a_repeated_search_runs_nothing_again(fmus, tmp_path):
    first, again = InProcess(), InProcess()
    _, found = search_study(Sweep(study(fmus), tmp_path), first, COUPLING, Search(evaluations=8))
    _, repeated = search_study(Sweep(study(fmus), tmp_path), again, COUPLING, Search(evaluations=8))
    assert len(first.ran) == len(set(first.ran)) == 8
    assert again.ran == []
    np.testing.assert_array_equal(found.indices, repeated.indices)


def test_ctrl_c_during_a_request_keeps_the_completed_setups(fmus, tmp_path):
    class Interrupted(InProcess):
        def rows(self, study, coupling, chunks, stop):
            yield next(iter(super().rows(study, coupling, chunks, stop)))
            raise KeyboardInterrupt

    made, after = study(fmus), InProcess()
    numbers = made.space.indices.tolist()[:12]
    with pytest.raises(KeyboardInterrupt):
        Sweep(made, tmp_path).request(Interrupted(), COUPLING, numbers)
    found = Sweep(made, tmp_path).request(after, COUPLING, numbers)
    assert after.ran == numbers[8:] and found.setups.tolist() == numbers  # eight setups are a batch


def test_a_search_uses_the_results_of_an_exhaustive_study(fmus, exhaustive):
    folder, _ = exhaustive
    workers = InProcess()
    search_study(Sweep(study(fmus), folder), workers, COUPLING, Search(evaluations=10))
    assert workers.ran == []


def test_a_search_for_several_measures_gives_the_front_of_the_evaluated_setups(fmus, exhaustive):
    folder, _ = exhaustive
    names = ("total tire force", "front ride height")
    table, found = search_study(Sweep(study(fmus), folder), InProcess(), COUPLING, Search(names, 20))
    values = np.stack([table.values(name) for name in names], axis=1)
    best = [not any((other <= row).all() and (other < row).any() for other in values) for row in values]
    assert found.front.tolist() == table.setups[best].tolist()


def front(digits: np.ndarray) -> np.ndarray:
    return digits.sum(axis=1) - 6.0


def test_scores_have_the_order_of_the_requested_setups():
    made = result({"front": front}, objective=(Term("front", 2.0, "m"),))
    indices = np.array([8, 0, 2400])
    np.testing.assert_allclose(scores_of(made, indices).objectives[:, 0], [2.0 * -4.0, 2.0 * -6.0, 2.0 * 18.0])


@pytest.mark.parametrize(
    ("constraint", "expected"),
    [
        (Constraint("front", at_most=2.0), [-0.5, 0.0, 0.5]),
        (Constraint("front", at_least=2.0), [0.5, 0.0, -0.5]),
        (Constraint("front", at_most=0.0), [1.0, 2.0, 3.0]),
        (Constraint("front", at_least=-inf, at_most=inf), [-1.0, -1.0, -1.0]),
    ],
)
def test_a_violation_is_a_share_of_the_limit(constraint, expected):
    np.testing.assert_allclose(violation(np.array([1.0, 2.0, 3.0]), constraint), expected)


def test_a_failed_setup_has_no_objective_and_breaks_every_constraint():
    made = result({"front": front}, failed=(5,), constraints=(Constraint("front", at_most=100.0),))
    scores = scores_of(made, np.array([4, 5]))
    assert np.isfinite(scores.objectives[:, 0]).tolist() == [True, False]
    assert (scores.violations[:, 0] > 0.0).tolist() == [False, True]


def test_an_objective_that_is_not_a_measure_is_reported():
    with pytest.raises(InputError, match="did you mean 'front'"):
        scores_of(result({"front": front}), np.array([0]), ["frnt"])
