"""Leaders of a study: every setup that another rounding of its values could bring to the front."""

import numpy as np
import pytest

from cosim.study.definition import Constraint, Term
from cosim.study.running import leaders as leading
from cosim.study.running.leaders import leaders, pareto_front, run_leaders

from .constructed import result

#: Error of the measures, as a share of which two values are equal.
ERROR = 1e-3
ERRORS = {"grip": ERROR, "ride": ERROR}


@pytest.fixture(autouse=True)
def _few(monkeypatch):
    monkeypatch.setattr(leading, "_LEAST", 30)


def rough(digits):
    """Return values of setups that lie close together."""
    return np.round(digits @ [0.3, 0.21, 0.17, 0.12], 2)


def smooth(digits):
    return 3.0 - digits @ [0.1, 0.2, 0.12, 0.21] + 0.05 * digits[:, 0] * digits[:, 3]


def numbers(found, errors=ERRORS):
    return set(leaders(found, errors))


def test_the_best_percent_or_a_fixed_number_are_leaders(monkeypatch):
    found = result({"grip": smooth, "ride": rough})
    for share, count in ((0.01, 30), (0.1, 240)):
        monkeypatch.setattr(leading, "_SHARE", share)
        ranking = found.ranking()
        equal = found.values("grip") <= found.values("grip")[ranking[count - 1]]
        assert numbers(found, {}) == set(found.setups[equal].tolist())


def test_setups_that_other_errors_could_bring_among_them_are_leaders():
    """The errors change each value by up to the stated one."""
    found = result({"grip": smooth, "ride": rough}, objective=(Term("grip", 2.0), Term("ride", -1.0)))
    known, rng = numbers(found), np.random.default_rng(4)
    assert 30 < len(known) < 200
    for _ in range(20):
        other = [one + rng.choice([-ERROR, ERROR], found.setups.size) for one in map(found.values, ERRORS)]
        best = np.argsort(2.0 * other[0] - other[1])[:30]
        front = pareto_front(np.stack([other[0], -other[1]], axis=1))
        assert {*found.setups[best].tolist(), *found.setups[front].tolist()} <= known


def test_setups_that_nearly_meet_a_constraint_are_leaders():
    whole = result({"grip": smooth, "ride": rough})
    grip, ride = map(whole.values, ERRORS)
    limit = float(np.sort(grip)[1000])
    beyond = {Constraint("grip", at_least=limit): limit - grip, Constraint("ride", at_most=0.9): ride - 0.9}
    for constraint, apart in beyond.items():
        known = numbers(result({"grip": smooth, "ride": rough}, constraints=(constraint,)))
        nearly = apart < 3.0 * ERROR
        best = whole.setups[nearly][np.argsort(grip[nearly], kind="stable")][:30]
        assert set(best.tolist()) <= known and not known & set(whole.setups[apart > 5.0 * ERROR].tolist())


@pytest.mark.parametrize("size", [0.0, 0.05])
def test_more_setups_run_exactly_if_the_leaders_differ_by_more_than_stated(size):
    failed = (int(result({"grip": smooth, "ride": rough}).ranking()[0]),)
    whole = result({"grip": smooth, "ride": rough}, failed=failed)
    noise = np.random.default_rng(5).uniform(-size, size, whole.setups.size)
    rounded = result({"grip": lambda digits: smooth(digits) + noise, "ride": rough})
    ran = list[int]()

    def exact(numbers):
        ran.extend(numbers)
        kept = np.sort(numbers)
        return result({"grip": smooth, "ride": rough}, kept=kept, failed=failed)

    run_leaders(rounded, ERRORS, exact)
    assert len(ran) == len(set(ran)) and set(whole.setups[whole.ranking()[:30]].tolist()) <= set(ran)
    assert (len(ran) > len(leaders(rounded, ERRORS))) == (size > ERROR)


def test_setups_that_failed_are_no_leaders():
    failed = tuple(int(k) for k in result({"grip": smooth}).ranking()[:5])
    found = result({"grip": smooth}, failed=failed)
    assert not numbers(found) & set(failed)
    assert leaders(result({"grip": smooth}, failed=tuple(range(2401))), {}) == []


def test_rows_near_the_front_are_flagged_up_to_a_distance():
    front = np.array([[0.0, 1.0], [0.5, 0.5], [1.0, 0.0]])
    values = np.concatenate([front, front + 0.09, front + 0.11])
    assert pareto_front(values).tolist() == [True] * 3 + [False] * 6
    assert pareto_front(values, np.array([0.1, 0.1])).tolist() == [True] * 6 + [False] * 3
