"""The answer at the top of a study's page: it is never more certain than what is known."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from cosim.study.choice.certainty import Contradiction, Contribution, Status, TradeOff
from cosim.study.page import page, sheet_of
from cosim.study.sheet import AimPage, Extras, answer_of, tied_rows
from eightpost.verdict import Grade, sealed

FRONT, HUB = "front ride height, RMS", "rf hub acceleration, RMS"


@pytest.fixture(scope="module")
def few(surrogate):
    return surrogate(("AA/AA", "B/B", "C/C"))


def _answer(result, certainty):
    return answer_of(sheet_of(result, certainty=certainty))


def _text(html):
    shown = html[: html.index('<script type="application/json"')]
    return re.sub(r"\s+", " ", re.sub(r"<style>.*?</style>|<[^>]*>", " ", shown, flags=re.DOTALL))


def test_without_a_certainty_the_answer_is_the_best_prediction_and_says_that_nothing_is_known(few):
    answer = _answer(few, None)
    assert answer.grade is Grade.UNKNOWN
    assert answer.candidates[0].row == few.ranking()[0]
    assert "unknown" in answer.sure
    assert answer.trade_offs == ()  # the baseline of this study failed
    other = answer_of(replace(sheet_of(few), baseline=0))
    assert len(other.trade_offs) == 5 and {one.interval for one in other.trade_offs} == {"unknown"}


def test_several_tied_setups_are_a_set_and_never_one_best_setup(few, certain):
    certainty = certain(few)
    assert len(certainty.ties) > 1
    answer = _answer(few, certainty)
    assert answer.grade is Grade.LIMITED
    assert answer.which.startswith(f"One of {len(certainty.ties)} setups is the best")
    assert [few.setups[one.row] for one in answer.candidates] == list(certainty.ties[:5])
    assert len(answer.candidates) + answer.others == len(certainty.ties)


def test_one_setup_is_a_usable_answer_only_if_nothing_is_unknown_and_no_rig_run_contradicts_it(few, certain):
    alone = certain(few, ties=1)
    assert _answer(few, alone).grade is Grade.USABLE
    unknown = replace(alone, contributions=(Contribution("vehicle", Status.UNKNOWN, "the FMU states none"),))
    assert _answer(few, unknown).grade is Grade.UNKNOWN
    assert "vehicle" in _answer(few, unknown).sure
    assert "is the best" not in _answer(few, unknown).which and "not known" in _answer(few, unknown).which
    assert "known contributions alone" in _answer(few, unknown).chance
    partly = replace(alone, contributions=(Contribution("build to build", Status.LEFT_OUT, "copies are equal"),))
    assert _answer(few, partly).grade is Grade.LIMITED
    contradicted = replace(alone, contradictions=(Contradiction("run.csv", alone.ties[0], FRONT, 1.0, 2.0, 1e-6),))
    assert _answer(few, contradicted).grade is Grade.LIMITED


def test_a_trade_off_is_better_or_worse_only_if_its_interval_excludes_zero(few, certain):
    grades = {one.measure: one.grade for one in _answer(few, certain(few)).trade_offs}
    assert grades == {HUB: "worse", FRONT: "even"}


def test_the_objective_comes_first_then_what_gets_worse_and_the_rest_is_counted(few, certain):
    names = [m.name for m in few.study.measures] + [f"other {k}" for k in range(6)]
    changes = (-0.03, -0.02, 0.01, 0.04, 0.0, -0.01, *(-0.05,) * 6)
    lines = tuple(TradeOff(n, c, c - 0.005, c + 0.005, 0.0) for n, c in zip(names, changes, strict=True))
    answer = _answer(few, certain(few, trade_offs=lines))
    assert [one.measure for one in answer.trade_offs[:2]] == [term.measure for term in few.study.objective]
    assert [one.grade for one in answer.trade_offs[2:5]] == ["worse", "worse", "even"]
    assert answer.trade_offs[2].change.startswith("+4") and len(answer.trade_offs) == 8
    assert answer.unlisted == "4 more are better."


@pytest.mark.nightly
def test_the_answer_leads_to_the_curves_to_aim_at_with_the_gain_that_is_assured(few, certain):
    sheet = sheet_of(few, certainty=certain(few))
    assert "eightpost shapes searches" in _text(page(sheet, Extras()))
    sure = page(sheet, Extras(aim=AimPage("shapes.html", 0.021, 0.012, True)))
    assert 'href="shapes.html"' in sure and "gain 2.1" in _text(sure) and "at least 1.2" in _text(sure)
    doubtful = _text(page(sheet, Extras(aim=AimPage("shapes.html", 0.021, -0.002, True))))
    assert "less than 95 % probable" in doubtful
    unstated = _text(page(sheet, Extras(aim=AimPage("shapes.html", 0.021, 0.012, False))))
    assert "errors of the vehicle are not included" in unstated


def test_curves_of_another_study_or_edited_ones_are_not_linked(few, tmp_path):
    (tmp_path / "shapes.html").write_text("")
    content = {"digest": few.provenance.digest, "objective": {"best_of_bank": 50.0},
               "gain": {"predicted": 1.0, "assured": 0.5, "includes_car": True}}  # fmt: skip
    (tmp_path / "shapes.json").write_text(json.dumps(content))
    assert AimPage.of(tmp_path, few.provenance.digest) == AimPage("shapes.html", 0.02, 0.01, True)
    (tmp_path / "shapes.json").write_text(json.dumps(sealed(content)))
    assert AimPage.of(tmp_path, few.provenance.digest) == AimPage("shapes.html", 0.02, 0.01, True)
    changed = sealed(content) | {"gain": content["gain"] | {"assured": 5.0}}
    for wrong in (content | {"digest": "0" * 64}, {"digest": few.provenance.digest}, [], changed):
        (tmp_path / "shapes.json").write_text(json.dumps(wrong))
        assert AimPage.of(tmp_path, few.provenance.digest) is None


def test_no_answer_is_given_if_no_setup_meets_the_constraints(few):
    sheet = sheet_of(few)
    assert answer_of(replace(sheet, allowed=np.zeros_like(sheet.allowed))) is None


def test_the_page_shows_the_answer_before_the_verdict_and_the_ranking(few, certain):
    certainty = certain(few)
    text = _text(page(sheet_of(few, certainty=certainty), Extras()))
    places = [text.index(words) for words in ("Which setup", "How sure", "At what trade-off", "What to test next")]
    assert places == sorted(places) and places[-1] < text.index("Ranking ")
    assert f"One of {len(certainty.ties)} setups is the best" in text


def test_tied_rows_are_the_fewest_that_contain_the_best_with_95_percent():
    np.testing.assert_array_equal(
        tied_rows(np.array([0.04, 0.60, np.nan, 0.36, 0.0])), [False, True, False, True, False]
    )
    np.testing.assert_array_equal(tied_rows(np.array([0.10, 0.60, 0.30])), [True, True, True])
    np.testing.assert_array_equal(tied_rows(np.full(3, np.nan)), [False, False, False])
