"""The tables of benchmarks/cars count what they state, and a row is made by the public path."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks.cars import __main__ as tables
from benchmarks.cars.judge import RIDE, Case, row_of, setups_of


def row(factors, *, common=0.01, own=0.1):
    """Return a row of four setups, with predictions that are the truth times a factor."""
    true = [{name: level * (1.0 + 0.1 * k) for k, name in enumerate(RIDE)} for level in (1.0, 1.1, 1.2, 1.3)]
    predicted = [{n: v * f for n, v in one.items()} for one, f in zip(true, factors, strict=True)]
    return {
        "kind": "links", "seed": 1, "seconds": 60.0, "lap": "track", "cpu": 30.0,
        "true": true, "predicted": predicted, "stated": {n: {"common": common, "own": own} for n in RIDE},
        "verdict": {"grade": "usable", "reasons": []},
    }  # fmt: skip


def test_error_is_that_of_the_predictions_in_percent():
    found = tables.errors(row([1.01, 1.0, 1.0, 0.98]))
    assert found.shape == (4, len(RIDE))
    assert found[:, 0] == pytest.approx([1.0, 0.0, 0.0, -2.0])


def test_interval_contains_the_truth_if_the_error_is_small_for_its_scale():
    good = tables.inside(row([1.005] * 4, common=0.01, own=0.0), 0.5)
    bad = tables.inside(row([1.05] * 4, common=0.01, own=0.0), 0.95)
    assert all(all(flags) for flags in good.values())
    assert not any(any(flags) for flags in bad.values())


def test_comparison_is_right_if_the_order_is_that_of_the_truth():
    right, wrong = tables.comparisons(row([1.0] * 4)), tables.comparisons(row([1.3, 1.0, 1.0, 1.0]))
    assert len(right) == 6 * len(RIDE)
    assert right[:, 1].all()
    assert (right[:, 0] >= 0.5).all()
    assert wrong[:, 1].mean() == pytest.approx(4.0 / 6.0)


def test_regret_is_the_true_loss_of_the_chosen_setup():
    assert tables.regret(row([1.0] * 4)) == 0.0
    assert tables.regret(row([1.5, 1.0, 1.0, 1.0])) == pytest.approx(10.0)


def test_summary_has_a_line_per_car_kind_and_all_and_bins_of_probability():
    lines = tables.summary([row([1.01, 1.0, 1.0, 0.98]), row([1.0] * 4) | {"seed": 2}]).splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:6]] == [
        "links 1 track 60", "links 2 track 60", "**links** track 60", "**all** track 60",
    ]  # fmt: skip
    assert lines[2].split("|")[2:5] == [" 1.12 ", " 2.0 ", " 1.000 "]
    assert sum(int(line.split("|")[2]) for line in lines if " to " in line) == 2 * 6 * len(RIDE)


def test_row_is_read_again_from_its_file(tmp_path):
    case = Case("links", 1)
    (tmp_path / f"{case.name}.json").write_text(json.dumps({"kept": 1}))
    assert row_of(case, tmp_path) == {"kept": 1}


def test_setups_belong_to_the_seed():
    assert setups_of(1) == setups_of(1) != setups_of(2)
    assert len(setups_of(1)) == 24
    assert set(np.ravel(setups_of(1))) == set(range(7))
