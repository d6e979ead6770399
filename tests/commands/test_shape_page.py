"""The page, the file and the verdict of `eightpost shapes` state what was found, in words that follow from it."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from cosim.study.choice.shape_search import Band, Evaluation, Range, Robustness, ShapeOptimum, ShockSpace
from eightpost.api import shape_page
from eightpost.api.shape_page import (
    aim_verdict,
    band_text,
    car_text,
    chance_text,
    gain_table,
    write_aim,
)
from eightpost.api.shapes import Aim, Curves, Request, Target, _Neighbour
from eightpost.shock.shape import Shape, ShapeFit, Side
from eightpost.verdict import is_intact
from eightpost.virtual.damper import NearestValving, Valving
from tests.unchanged import refusals, text_of_page

CORNERS = ("lf", "rf", "lr", "rr")
SHAPE = Shape(Side(3e3, 1500.0, 0.1, 600.0, 100.0), Side(4e3, 1500.0, 0.1, 600.0, 100.0))
VELOCITY = np.linspace(-1.0, 1.0, 5)
VALVING = NearestValving(Valving(), -25.0, 12.0, 0.02, VELOCITY, 900.0 * VELOCITY, 9, ("dish",))
BAND = Band(0.8, 0.12, 0.96, np.zeros((60, 1)), np.array([[0.0, 1.0]]))
TARGET = Target(
    CORNERS, SHAPE, VELOCITY, 800.0 * VELOCITY - 1.0, 800.0 * VELOCITY + 1.0, {"rebound.low": (1200.0, 1900.0)},
    ("rebound.low",), (_Neighbour("soft", 30.0, 0.05, 9.5),), VALVING, SHAPE, 9.7,
)  # fmt: skip
OPTIMUM = ShapeOptimum(
    np.array([0.4]), 9.3, 9.0, 0.15, 9.4, True, ((10.0, 9.1), (11.0, 9.0)), 50, ("converged", "steps")
)


def car(*, unknown=()):
    """Cars that the true one may be: 256 of them."""
    return SimpleNamespace(
        is_known=not unknown, unknown=lambda _measures: list(unknown), criterion=SimpleNamespace(measures=()),
        draws=SimpleNamespace(common=np.zeros((256, 3))),
    )  # fmt: skip


REQUEST = Request(robustness=Robustness(6, 2.0))


def aim(*, runs=(10.0, 9.0, 9.5, 9.7), request=REQUEST, gains=None, **curves):
    """Return what was found: 10 with the best of the bank, 9 with the targets."""
    one = lambda value: np.array([value])  # noqa: E731
    reference = Evaluation(one(10.6), np.zeros((1, 0)), one(10.0), one(0.3), one(10.7))
    gains = np.arange(21.0) - 1.0 if gains is None else gains
    space = ShockSpace((CORNERS,), (Range("rebound.low", 1000.0, 2000.0),), None)
    found = Curves(
        None, space, {"soft": ShapeFit(SHAPE, 3.0, 0.012)},
        dict.fromkeys(CORNERS, "soft"), {CORNERS: SHAPE}, reference, OPTIMUM, None, gains, BAND,
    )  # fmt: skip
    study = SimpleNamespace(name="lap", to_json=lambda: '{"schema": 1}')
    verified = SimpleNamespace(objective=np.array(runs), worst_coupling_error=0.2)
    return Aim(study, "abc", request, replace(found, **curves), (TARGET,), verified, 70)


def rules(found):
    verdict = aim_verdict(found)
    return {reason.rule: reason.figure for reason in verdict.reasons}, verdict.is_acceptable


def numbers(table, column):
    return [cell if isinstance(cell, str) else cell.value for cell in (row[column] for row in table.rows)]


def test_targets_that_are_not_better_than_the_bank_are_not_usable():
    assert rules(aim(car=car(), gains=np.ones(9))) == (
        {"targets better than the bank": "10 with the best of the bank, 9 with the targets"},
        True,
    )
    found, usable = rules(aim(runs=(9.0, 9.0, 9.0, 9.0)))
    assert "no gain over the bank" in found and not usable


@pytest.mark.parametrize(("run", "agrees"), [(9.005, True), (8.995, True), (9.02, False), (8.98, False)])
def test_a_verifying_run_may_differ_from_the_search_by_a_thousandth(run, agrees):
    found, usable = rules(aim(runs=(10.0, run, 9.5, 9.7)))
    assert usable is agrees
    assert ("verification differs" in found) is not agrees


@pytest.mark.parametrize(("as_shapes", "doubt"), [
    (9.9, None), (9.4, "10 with its own laws, 9.4 as shapes; gain 1"),
])  # fmt: skip
def test_a_gain_that_may_come_from_the_shapes_alone_is_limited(as_shapes, doubt):
    found = aim()
    reference = found.curves.reference._replace(nominal=np.array([as_shapes]))
    said = rules(replace(found, curves=replace(found.curves, reference=reference)))[0]
    assert said.get("gain within the error of the shapes") == doubt


def test_the_verdict_says_what_the_uncertainty_of_the_vehicle_means_for_the_gain():
    assert rules(aim())[0]["uncertainty of the gain unknown"] == "stated for no measure"
    found = rules(aim(car=car(unknown=("grip", "hub"))))[0]
    assert found["uncertainty of the gain unknown"] == "not stated for grip, hub"
    off = rules(aim(request=Request(uncertain=False), car=car()))[0]
    assert off["uncertainty of the gain not computed"] == "not computed"
    doubtful = rules(aim(car=car(), gains=np.arange(100.0) - 5.0))[0]  # 94 of 100 are above zero
    assert doubtful["gain in doubt"] == "94 %; limit 95 %"
    assert "gain in doubt" not in rules(aim(car=car(), gains=np.arange(100.0) - 4.0))[0]


def test_gains_are_those_that_half_and_95_percent_of_the_draws_exceed():
    table = gain_table(aim(gains=np.arange(21.0) - 1.0))
    assert numbers(table, 1) == pytest.approx([1.0, 9.0, 0.0])
    assert numbers(table, 2) == pytest.approx([10.0, 90.0, 0.0])  # of the objective, 10
    assert "of the draws of shocks" in table.rows[1][0]
    assert "of the draws of shocks and cars" in gain_table(aim(car=car())).rows[1][0]
    assert aim().curves.chance == pytest.approx(19.0 / 21.0)


def test_words_about_the_band_and_the_car():
    assert band_text(aim()) == (
        "All numbers of all corners may deviate together by 12 % of their ranges: 96 % of 60 random points there keep "
        "80 % of the assured gain."
    )
    assert "keeps 80 % of the assured gain" in band_text(aim(band=replace(BAND, size=0.0)))
    assert band_text(aim(band=None)) == "No gain is assured with 95 %, so there is no band."
    assert "left out on request" in car_text(aim(request=Request(uncertain=False), car=car()))
    assert "as if it were exact" in car_text(aim())
    assert car_text(aim(car=car(unknown=("hub",)))).endswith(
        "of 90.5 %. The uncertainty of hub is not known and not included."
    )


@pytest.mark.parametrize(
    ("share", "cars", "words"),
    [(0.96, 40, "96 %"), (0.98, 40, "more than 97 %"), (0.03, 40, "3 %"), (0.02, 40, "less than 3 %")],
)
def test_a_probability_is_no_more_extreme_than_the_number_of_cars_resolves(share, cars, words):
    assert chance_text(share, cars) == words


def test_the_page_and_the_file_of_the_targets_are_unchanged(tmp_path, unchanged):
    data, page = write_aim(aim(car=car(unknown=("hub",)), gains=np.arange(100.0) - 5.0), tmp_path)
    words = text_of_page(page.read_text(encoding="utf-8")).splitlines()
    unchanged([" | ".join(words[k : k + 5]) for k in range(0, len(words), 5)])
    content = json.loads(data.read_text())
    unchanged([f"{key} {json.dumps(value, ensure_ascii=False)}" for key, value in content.items()], "file")


def test_the_curves_of_a_target_are_unchanged_and_have_a_band_only_if_a_gain_is_assured(
    monkeypatch, tmp_path, unchanged
):
    pages = []
    monkeypatch.setattr(shape_page, "document", lambda title, _verdict, parts, **_: pages.append((title, parts)) or "")
    contents = [json.loads(write_aim(found, tmp_path)[0].read_text()) for found in (aim(car=car()), aim(band=None))]
    figures = [parts[1].blocks[0].content()["data"] for _, parts in pages]
    unchanged({"title": pages[0][0], "curves": [(one["name"], np.array([one["x"], one["y"]])) for one in figures[0]]})
    assert is_intact(contents[0]) and contents[1]["band"] is None
    assert [content["gain"]["includes_car"] for content in contents] == [True, False]
    assert [one["name"] for one in figures[1]] == [one["name"] for one in figures[0] if one["name"] != "band"]


def test_a_request_that_cannot_be_searched_is_refused(unchanged):
    wrong = [
        {"tolerance": 0.331}, {"tolerance": -0.001}, {"keep": 0.0}, {"keep": 1.001}, {"vary": ("knee",)},
        {"limits": {"lag": (1.0, 2.0)}}, {"limits": {"rebound.low": (2.0, 2.0)}},
    ]  # fmt: skip
    unchanged(refusals({str(fields): partial(Request, **fields) for fields in wrong}))
    assert Request(tolerance=0.33, keep=1.0).starts == 3 and Request(tolerance=0.0).seed == 0
