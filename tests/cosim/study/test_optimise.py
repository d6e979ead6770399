"""Searches of constructed banks whose best setups are known from exhaustive evaluation."""

from __future__ import annotations

from itertools import combinations

import moocore
import numpy as np
import pytest

from cosim.study.choice.optimise import Scores, optimise
from cosim.study.definition import SetupSpace
from eightpost.corners import CORNERS
from eightpost.errors import InputError

BUILDS = ("AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C")
SPACE = SetupSpace(dict.fromkeys(CORNERS, BUILDS))


def responses(seed: int, count: int) -> np.ndarray:
    """Return responses (2401, count) with main effects, weaker interactions of two corners, and noise."""
    generator = np.random.default_rng(seed)
    levels, values = SPACE.digits(SPACE.indices), np.zeros((2401, count))
    for m in range(count):
        for corner in range(4):
            values[:, m] += 2.0 * generator.normal() * generator.normal(size=7)[levels[:, corner]]
        for a, b in combinations(range(4), 2):
            values[:, m] += 0.4 * generator.normal(size=(7, 7))[levels[:, a], levels[:, b]]
        values[:, m] += 0.1 * generator.normal(size=2401)
    return values


class Bank:
    """Bank with tabulated responses that counts how often each setup was run."""

    def __init__(self, objectives: np.ndarray, violations: np.ndarray | None = None) -> None:
        self.objectives = objectives
        self.violations = np.zeros((objectives.shape[0], 0)) if violations is None else violations
        self.runs = np.zeros(objectives.shape[0], dtype=int)

    def __call__(self, indices: np.ndarray) -> Scores:
        np.add.at(self.runs, indices, 1)
        return Scores(self.objectives[indices], self.violations[indices])


@pytest.mark.repeated(2)
@pytest.mark.parametrize("seed", range(5))
def test_the_best_of_2401_setups_is_found_within_400(seed):
    bank = Bank(responses(seed, 1))
    found = optimise(SPACE, bank, evaluations=400, seed=seed)
    assert found.best == int(bank.objectives.argmin())


def test_no_setup_is_run_twice_and_no_more_than_allowed():
    bank = Bank(responses(0, 2))
    found = optimise(SPACE, bank, evaluations=150)
    assert bank.runs.max() == 1
    assert bank.runs.sum() == found.indices.size == 150


def test_the_same_seed_evaluates_the_same_setups():
    first, again, other = (optimise(SPACE, Bank(responses(1, 2)), evaluations=200, seed=s) for s in (3, 3, 4))
    np.testing.assert_array_equal(first.indices, again.indices)
    assert not np.array_equal(first.indices, other.indices)


def test_a_quarter_of_the_bank_shows_the_trade_off_of_two_measures():
    bank = Bank(responses(2, 2))
    worst = bank.objectives.max(axis=0)
    found = optimise(SPACE, bank, evaluations=600)
    front, whole = (moocore.hypervolume(one, ref=worst) for one in (bank.objectives[found.front], bank.objectives))
    assert front > 0.98 * whole


def test_the_best_setup_that_keeps_the_constraints_is_found():
    objectives = responses(3, 2)
    limit = np.quantile(objectives[:, 1], 0.2)
    bank = Bank(objectives[:, :1], (objectives[:, 1:] - limit) / abs(limit))
    allowed = np.flatnonzero(objectives[:, 1] <= limit)
    found = optimise(SPACE, bank, evaluations=500)
    assert found.best == allowed[objectives[allowed, 0].argmin()]


def test_a_setup_that_fails_is_never_the_best():
    objectives = responses(4, 1)
    best = objectives[:, 0].argsort()[:2]
    objectives[best[0]] = np.nan
    assert optimise(SPACE, Bank(objectives), evaluations=400).best == best[1]


def test_without_an_allowed_setup_there_is_no_best_one():
    found = optimise(SPACE, Bank(responses(5, 1), np.ones((2401, 1))), evaluations=60)
    assert found.best is None
    assert found.front.size == 0


def test_a_space_no_larger_than_the_evaluations_is_evaluated_completely():
    bank = Bank(responses(6, 1))
    found = optimise(SPACE, bank, evaluations=2401)
    assert found.status == "every setup was evaluated"
    assert (bank.runs == 1).all()


def test_the_first_generation_has_the_start_setups_and_every_build_at_every_corner():
    found = optimise(SPACE, Bank(responses(7, 1)), evaluations=21, population=21, start=(1200,))
    assert found.indices[0] == 1200
    for digits in SPACE.digits(found.indices).T:
        assert set(digits) == set(range(7))


def test_corners_that_are_alike_stay_alike_in_a_very_large_space():
    many = tuple(f"build {n}" for n in range(400))
    space = SetupSpace(dict.fromkeys(CORNERS, many), alike=(("lf", "rf"), ("lr", "rr")))

    def distance(indices: np.ndarray) -> Scores:
        digits = space.digits(indices)
        assert (digits[:, 0] == digits[:, 1]).all()
        assert (digits[:, 2] == digits[:, 3]).all()
        return Scores(np.abs(digits - 200).sum(axis=1, keepdims=True).astype(float), np.zeros((indices.size, 0)))

    found = optimise(space, distance, evaluations=500)
    assert found.objectives[:, 0].min() < found.objectives[:20, 0].min()


def test_a_search_needs_two_evaluations():
    with pytest.raises(InputError, match="two evaluations or more"):
        optimise(SPACE, Bank(responses(0, 1)), evaluations=1)
