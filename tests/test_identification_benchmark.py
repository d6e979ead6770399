"""The figures of the identification benchmark are correct, and its cases match their names."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import identification
from benchmarks.identification import markdown
from benchmarks.identification_cases import CASES, DRIVE, LAP, NOISE, noise_seeds
from benchmarks.identification_measures import TOTAL, agreement, measures_of
from benchmarks.identification_methods import methods
from benchmarks.identification_seeds import over_seeds
from eightpost.ident.vehicle.port_laws import bristle_force
from eightpost.vehicle import Bristle

pytestmark = pytest.mark.nightly

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


def test_an_interrupted_run_continues_where_it_was_and_keeps_the_order_of_setups(tmp_path, monkeypatch) -> None:
    asked: list[tuple[int, ...]] = []

    def simulated(_case: object, _lap: object, setups: list[tuple[int, ...]]) -> Iterator[dict[str, float]]:
        for setup in setups:
            asked.append(setup)
            yield {"a": float(sum(setup))}

    monkeypatch.setattr(identification, "truths", simulated)
    case, setups = CASES["eight_post_close"], [(0, 0, 0, k) for k in range(5)]
    first = identification.kept_truths(case, None, setups[:4], tmp_path)
    assert [next(first)["a"] for _ in range(2)] == [0.0, 1.0]  # interrupted after two
    again = [row["a"] for row in identification.kept_truths(case, None, setups[::-1], tmp_path)]
    assert again == [4.0, 3.0, 2.0, 1.0, 0.0]
    assert sorted(asked) == setups  # no setup was simulated twice


def test_a_failed_method_is_shown_as_a_dash_in_the_table() -> None:
    row = {"case": "c", "method": "m", "setups": 3, "all_percent": None, "spearman_min": 0.99987}
    assert markdown([row]).splitlines()[-1] == "| c | m | 3 | - | 0.9999 |"


def _rows(*figures: tuple[float | None, float | None]) -> list[dict[str, object]]:
    return [
        {"case": "c", "method": "m", "setups": 3, "max_percent": high, "spearman_min": low} for high, low in figures
    ]


def test_over_seeds_the_worst_error_is_the_largest_and_the_worst_correlation_the_lowest() -> None:
    worst, middle = over_seeds(_rows((1.0, 0.99), (3.0, 0.98), (2.0, 0.90)))
    assert (worst["seeds"], worst["max_percent"], worst["spearman_min"]) == ("3, worst", 3.0, 0.90)
    assert (middle["seeds"], middle["max_percent"], middle["spearman_min"]) == ("3, median", 2.0, 0.98)


def test_a_seed_that_failed_leaves_no_figure() -> None:
    worst, middle = over_seeds(_rows((1.0, 0.99), (None, None)))
    assert worst["max_percent"] is middle["max_percent"] is None


def test_no_two_rig_tests_share_a_noise_seed() -> None:
    seeds = noise_seeds(20)
    assert seeds[0] == NOISE
    assert len({seed + test for seed in seeds for test in range(5)}) == 100


def test_a_bristle_bends_over_its_reach_and_slides_from_there() -> None:
    time = np.arange(2500) / 125.0
    velocity = 0.01 * np.sin(2.0 * np.pi * 0.5 * time)
    bend = bristle_force(velocity, 125.0, Bristle(1.0, 1e-4))
    since = (time >= 10.0) & (time < 10.5)  # it turns back at 10 s, bent the other way
    travelled = 0.01 / np.pi * (1.0 - np.cos(np.pi * time[since]))
    np.testing.assert_allclose(bend[since], 1.0 - 2.0 * np.exp(-travelled / 1e-4), atol=0.05)
