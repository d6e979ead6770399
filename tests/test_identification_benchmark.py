"""What the identification benchmark says of measures is right; its cases are what they are called."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.identification import markdown
from benchmarks.identification_cases import CASES, DRIVE, LAP
from benchmarks.identification_measures import TOTAL, agreement, measures_of
from benchmarks.identification_methods import methods

RATE = 250.0


def _table(factor: float) -> list[dict[str, float]]:
    return [{"a": factor * value, "b": factor * (4.0 - value)} for value in (1.0, 2.0, 3.0)]


def test_a_prediction_that_is_all_a_tenth_high_errs_by_ten_percent_and_ranks_perfectly() -> None:
    found = agreement(_table(1.0), _table(1.1))
    assert found.all_percent == pytest.approx(10.0)
    assert found.max_percent == pytest.approx(10.0)
    assert (found.spearman_min, found.kendall_min) == pytest.approx((1.0, 1.0))


def test_the_lowest_rank_correlation_is_that_of_the_worst_measure() -> None:
    wrong = _table(1.0)
    wrong[0]["b"], wrong[2]["b"] = wrong[2]["b"], wrong[0]["b"]
    found = agreement(_table(1.0), wrong)
    assert (found.spearman_min, found.kendall_min) == pytest.approx((-1.0, -1.0))


def test_measures_leave_the_mean_and_the_first_seconds_out() -> None:
    time = np.arange(0.0, 8.0, 1.0 / RATE)
    wave = 2.0 * np.sin(2.0 * np.pi * 2.0 * time) + 50.0
    wave[time < 3.0] = 1e6
    found = measures_of(("lf.tire_force", "rf.tire_force", "lf.displacement"), np.stack([wave, wave, wave]), RATE)
    assert found == pytest.approx({"lf.tire_force": 2.0**0.5, "rf.tire_force": 2.0**0.5, TOTAL: 8.0**0.5}, rel=1e-3)


def test_setups_are_all_combinations_or_the_same_hundred_of_them_each_time() -> None:
    case = replace(CASES["eight_post_close"], laws=lambda: (None,) * 7)
    every, some = case.chosen(None), case.chosen(100)
    assert len(set(every)) == 7**4
    assert len(set(some)) == 100
    assert set(some) < set(every)
    assert some == case.chosen(100)


def test_seeds_of_drive_and_lap_differ() -> None:
    assert DRIVE != LAP


def test_each_methods_file_gives_recipes_by_name() -> None:
    found = methods()
    assert {"boggs, raw", "boggs, smoothed"} <= set(found)
    assert all(hasattr(method, "identify") for method in found.values())


def test_what_failed_stands_in_the_table_as_a_dash() -> None:
    row = {"case": "c", "method": "m", "setups": 3, "all_percent": None, "spearman_min": 0.99987}
    assert markdown([row]).splitlines()[-1] == "| c | m | 3 | - | 0.9999 |"
