"""Content of a study's report and its files, compared with the result."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from itertools import islice

import numpy as np
import openpyxl
import pytest

from cosim.study.answer import answer_of, chance, corner_choices, sought
from cosim.study.choice.certainty import Certainty, Contradiction, Contribution, Status, TradeOff
from cosim.study.choice.rig_day import select
from cosim.study.choice.sensitivity import available_sensitivities
from cosim.study.definition import Build, Constraint
from cosim.study.measures import AboveBand
from cosim.study.page import (
    dominant_corner,
    packed,
    page,
    write_ranking,
    write_study_report,
    write_traces,
    write_workbook,
)
from cosim.study.sheet import (
    VELOCITIES,
    AimPage,
    Extras,
    Scale,
    ShockCurve,
    background,
    build_colors,
    copy_shock_pages,
    sheet_of,
    shock_curve,
    shock_curves,
    shown_columns,
    tied_rows,
)
from cosim.study.table import StudyResult
from cosim.study.verdict import study_verdict
from eightpost.signals import read_record
from eightpost.validity import Validity
from eightpost.verdict import Grade, Reason, Verdict, sealed

from ...page_content import content_of, manifest_lines, stores
from ..constructed import edited
from ..coupled import SCALES, study

__all__ = ["stores"]

FRONT, TIRE, HUB = "front ride height, RMS", "total tire force, RMS", "rf hub acceleration, RMS"
FEW = ("AA/AA", "B/B", "C/C")
IN, LBF = 0.0254, 4.4482216152605  # exact definitions


@pytest.fixture(scope="session")
def few(surrogate):
    return surrogate(FEW)


@pytest.fixture(scope="session")
def sheet(few):
    return sheet_of(few)


@pytest.fixture
def unranked(few):
    """Return a result without objective and constraints."""
    return StudyResult(replace(few.study, objective=(), constraints=()), few.table, few.provenance)


def _text(html):
    """Return approximately the visible text of the page."""
    shown = html[: html.index('<script type="application/json"')]
    return re.sub(r"\s+", " ", re.sub(r"<style>.*?</style>|<[^>]*>", " ", shown, flags=re.DOTALL))


def _manifest(html):
    return json.loads(re.search(r'id="manifest">(.*?)</script>', html, re.DOTALL)[1])


def test_setups_are_ranked_feasible_first_then_infeasible_then_failed(sheet, few):
    tire, front_height, hub = (few.table[name] for name in (TIRE, FRONT, HUB))
    objective = tire / LBF + 900.0 * front_height / IN
    kept = hub <= 2.45
    groups = [np.flatnonzero(kept), np.flatnonzero(~kept & np.isfinite(hub)), np.flatnonzero(np.isnan(hub))]
    assert all(group.size for group in groups)
    expected = np.concatenate([group[np.argsort(objective[group])] for group in groups])
    np.testing.assert_array_equal(sheet.order, expected)
    np.testing.assert_array_equal(sheet.order[: groups[0].size], few.ranking())


def test_the_page_loads_nothing_and_escapes_names(sheet):
    html = page(sheet, Extras())
    assert "default-src 'none'" in html
    assert "&lt;b&gt;own&lt;/b&gt; &amp; measure" in html and "<b>own</b>" not in html
    assert not re.findall(r'(?:src|href)="(?!#)', html)


def test_the_page_of_a_study_in_which_nothing_ran_states_the_reason(few):
    columns = {m.name: [None] * len(few) for m in few.measures}
    broken = edited(few, **columns, status=["failed"] * len(few), message=["no licence"] * len(few))
    sheet = sheet_of(broken)
    text = _text(page(sheet, Extras(sensitivities=available_sensitivities(broken))))
    assert "no setup ran" in text and "no licence" in text


def test_the_verdict_is_usable_if_nothing_limits_it(few):
    done = StudyResult(few.study, few.table.take(few.done), few.provenance)
    clean = edited(done, marks=[""] * len(done), coupling_error_percent=[0.01] * len(done))
    assert study_verdict(clean).grade is Grade.UNKNOWN  # it is not known how sure the choice is
    one, *others = clean.setups.tolist()
    share = np.eye(len(clean))[0]
    sure = Certainty("", FRONT, 1, clean.setups, share, share, np.ones(len(clean)), (one,), {})
    assert study_verdict(clean, sure).grade is Grade.USABLE
    assert study_verdict(clean, replace(sure, ties=(one, others[0]))).grade is Grade.LIMITED
    unknown = Contribution("vehicle", Status.UNKNOWN, "it states none")
    assert study_verdict(clean, replace(sure, contributions=(unknown,))).grade is Grade.UNKNOWN


def test_the_verdict_on_a_study_contains_the_validity_of_its_models(few):
    reason = Reason(
        "r", "fit of the shock", Grade.NOT_USABLE, "a lag of 40 ms", "40 ms", "record A.csv", "measure again"
    )
    models = {"a/A.fmu": Validity(Verdict([reason])).to_json(), "b/foreign.fmu": None}
    verdict = study_verdict(StudyResult(few.study, few.table, replace(few.provenance, models=models)))
    assert verdict.grade is Grade.NOT_USABLE
    assert {"A.fmu: record A.csv", "foreign.fmu"} <= {reason.origin for reason in verdict.reasons}
    assert verdict.grades["validity of the models"] is Grade.UNKNOWN


def test_the_verdict_begins_with_the_lack_of_a_feasible_setup(few):
    strict = StudyResult(replace(few.study, constraints=(Constraint(HUB, at_most=0.1),)), few.table, few.provenance)
    assert study_verdict(strict).summary().startswith("Not usable: no setup keeps all constraints")
    assert answer_of(sheet_of(strict)) is None


def test_traces_in_csv_are_read_back_in_si(sheet, lap, tmp_path):
    series = lap(1)
    path = write_traces(sheet, 12, series, tmp_path / "setup.csv")
    assert path.read_text(encoding="utf-8").startswith('"Format","MoTeC CSV File"')
    assert '"Comment","setup 9999"\n' in write_traces(sheet, 9999, series, tmp_path / "other.csv").read_text(
        encoding="utf-8"
    )
    record = read_record(path)
    assert record.names == ("Time", *series.names) and record.units == ("s", *series.units)
    np.testing.assert_array_equal(np.array(record.columns, dtype=float), np.vstack([series.time, series.values]))


def test_rows_of_the_workbook_have_texts_as_they_are_full_numbers_formats_and_empty_cells(few, tmp_path):
    sheet = sheet_of(StudyResult(replace(few.study, name="=1+1"), few.table, few.provenance))
    odd = replace(sheet, failures={int(sheet.order[-1]): "=1 <&>"}, marks={})
    book = openpyxl.load_workbook(write_workbook(odd, tmp_path / "ranking.xlsx"))
    ranking, name = book["Ranking"], next(row[1] for row in book["Provenance"].rows if row[0].value == "Study")
    assert (name.value, name.data_type) == ("=1+1", "s")  # text, no formula
    first, *_, last = list(ranking.rows)[1:]
    assert (last[-1].value, last[-1].data_type) == ("=1 <&>", "s") and last[0].value is None
    column = [column.name for column in shown_columns(odd)].index(FRONT)
    row, cell = int(odd.order[0]), first[2 + len(odd.corners) + column]
    shown = shown_columns(odd)[column]
    assert cell.value == pytest.approx(shown.scale.us(shown.values[row]), rel=1e-15)
    assert cell.number_format == "0.0000" and first[0].number_format == "General" and first[0].value == 1
    assert ranking.dimensions == f"A1:{last[-1].coordinate}"


def test_more_rows_than_are_in_memory_are_in_order(sheet, tmp_path, monkeypatch):
    whole = write_ranking(sheet, tmp_path / "a.csv").read_text(encoding="utf-8")
    monkeypatch.setattr("cosim.study.page._ROWS", 3)
    assert write_ranking(sheet, tmp_path / "b.csv").read_text(encoding="utf-8") == whole


def test_dots_are_coloured_by_the_dominant_corner(sheet):
    hub = next(column for column in sheet.measures if column.name == HUB)
    assert sheet.corners[dominant_corner(sheet, hub)] == "rf"


@pytest.mark.nightly
def test_all_files_are_written_and_named(surrogate, lap, tmp_path):
    whole = surrogate(("AA/AA", "C/C", "B/B"))
    result = StudyResult(
        replace(whole.study, measures=whole.measures[:1], objective=(), constraints=()), whole.table, whole.provenance
    )
    best = int(result.setups[result.ranking()[0]])
    extras = Extras({best: lap(1)}, available_sensitivities(result))
    page = write_study_report(sheet_of(result, trace_command="run {setup}"), extras, tmp_path / "out")
    files = {path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.*")}
    assert files == {"report.html", "ranking.xlsx", "ranking.csv", f"traces/setup_{best}.csv"}
    manifest = _manifest(page.read_text(encoding="utf-8"))
    assert list(manifest["traces"]) == [str(best)] and manifest["trace_command"] == "run {setup}"
    assert [one["column"] for one in manifest["sensitivities"]] == [0]


# ==== The answer at the top of a study's page: it is never more certain than what is known ===========================


def _answer(result, certainty):
    return answer_of(sheet_of(result, certainty=certainty))


def test_without_a_certainty_the_answer_is_the_best_prediction_and_says_that_nothing_is_known(few):
    answer = _answer(few, None)
    assert answer.grade is Grade.UNKNOWN
    assert answer.row == few.ranking()[0] and answer.candidates == ()
    assert "Unknown" in answer.sure
    assert answer.trade_offs == () and answer.gain == ""  # the baseline of this study failed
    other = answer_of(replace(sheet_of(few), baseline=0))
    assert len(other.trade_offs) == 5 and {one.interval for one in other.trade_offs} == {"unknown"}
    gain = 100.0 * (few.objective[other.row] / few.objective[0] - 1.0)
    assert other.gain.startswith(f"Objective −{-gain:.2g}") and other.gain.endswith("how exact this is, is unknown.")
    assert other.tests == ((other.row, ""), (0, ""))  # what is chosen, and what it is compared with


def test_one_setup_is_a_usable_answer_only_if_nothing_is_unknown_and_no_rig_run_contradicts_it(few, certain):
    alone = certain(few, ties=1)
    assert _answer(few, alone).grade is Grade.USABLE
    assert _answer(few, alone).which == f"Setup {alone.leader} is the best."
    assert "every known error is included" in _answer(few, alone).sure
    unknown = replace(alone, contributions=(Contribution("vehicle", Status.UNKNOWN, "the FMU states none"),))
    assert _answer(few, unknown).grade is Grade.UNKNOWN
    assert "vehicle" in _answer(few, unknown).sure
    assert "is the best" not in _answer(few, unknown).which and "not known" in _answer(few, unknown).which
    assert "from what is included" in chance(unknown) and chance(alone) == "probability of being best"
    partly = replace(alone, contributions=(Contribution("build to build", Status.LEFT_OUT, "copies are equal"),))
    assert _answer(few, partly).grade is Grade.LIMITED
    assert _answer(few, partly).which == f"Setup {alone.leader} is probably the best."
    assert _answer(few, partly).sure.startswith("Not included: build to build. With it, other setups may be as good.")
    contradicted = replace(alone, contradictions=(Contradiction("run.csv", alone.ties[0], FRONT, 1.0, 2.0, 1e-6),))
    assert _answer(few, contradicted).grade is Grade.LIMITED


def test_the_objective_comes_first_then_what_gets_worse_and_the_rest_is_counted(few, certain):
    names = [m.name for m in few.study.measures] + [f"other {k}" for k in range(6)]
    changes = (-0.03, -0.02, 0.01, 0.04, 0.0, -0.01, *(-0.05,) * 6)
    lines = tuple(TradeOff(n, c, c - 0.005, c + 0.005, 0.0) for n, c in zip(names, changes, strict=True))
    answer = _answer(few, certain(few, trade_offs=lines))
    assert [one.measure for one in answer.trade_offs[:2]] == [term.measure for term in few.study.objective]
    assert [one.grade for one in answer.trade_offs[2:5]] == ["worse", "worse", "even"]
    assert answer.trade_offs[2].change.startswith("+4") and len(answer.trade_offs) == 6
    assert answer.unlisted == "6 more are better."


def test_each_corner_shows_its_build_its_clicks_and_its_curve_over_that_of_today(few):
    bank = {name: Build(build.fmu, {"clicks.rebound": 20}) for name, build in few.study.bank.items()}
    sheet = replace(sheet_of(StudyResult(replace(few.study, bank=bank), few.table, few.provenance)), baseline=0)
    row = sheet.row(sheet.numbers[-1])
    velocity = np.linspace(-1.0, 1.0, 5)
    curves = {name: ShockCurve(velocity, (k + 1.0) * velocity) for k, name in enumerate(sheet.builds)}
    choices = corner_choices(sheet, row, curves)
    assert [(one.corner, one.build, one.setting, one.today) for one in choices] == [
        (corner, "C/C", "rebound 20 clicks", "AA/AA rebound 20 clicks") for corner in sheet.corners
    ]
    assert all(one.plots.count('class="chosen"') == one.plots.count('class="today"') == 2 for one in choices)
    assert "[in/s]" in choices[0].plots and "[mm/s]" in choices[0].plots
    same = corner_choices(sheet, 0, curves)[0]
    assert same.today == "" and 'class="today"' not in same.plots
    assert corner_choices(sheet, row, {})[0].plots == ""


def test_what_counts_is_said_in_words(few, unranked):
    assert sought(sheet_of(unranked)) == f"{TIRE}, as low as possible"
    terms = sheet_of(few).terms
    one = replace(sheet_of(few), terms=(terms[0]._replace(weight=-1.0),))
    assert sought(one) == f"{TIRE}, as high as possible"


@pytest.mark.nightly
def test_the_answer_leads_to_the_curves_to_aim_at_with_the_gain_that_is_assured(few, certain):
    sheet = sheet_of(few, certainty=certain(few))
    sure = page(sheet, Extras(aim=AimPage("shapes.html", 0.021, 0.012, True)))
    assert 'href="shapes.html"' in sure and "gain 2.1" in _text(sure) and "at least 1.2" in _text(sure)
    doubtful = _text(page(sheet, Extras(aim=AimPage("shapes.html", 0.021, -0.002, True))))
    assert "less than 95 % probable" in doubtful
    unstated = _text(page(sheet, Extras(aim=AimPage("shapes.html", 0.021, 0.012, False))))
    assert "errors of the vehicle are not included" in unstated


def test_curves_of_another_study_or_edited_ones_are_not_linked(few, tmp_path):
    (tmp_path / "shapes.html").write_text("")
    content = {"schema": 1, "kind": "shapes", "digest": few.provenance.digest, "objective": {"best_of_bank": 50.0},
               "gain": {"predicted": 1.0, "assured": 0.5, "includes_car": True}}  # fmt: skip
    (tmp_path / "shapes.json").write_text(json.dumps(content))
    assert AimPage.of(tmp_path, few.provenance.digest) == AimPage("shapes.html", 0.02, 0.01, True)
    (tmp_path / "shapes.json").write_text(json.dumps(sealed(content)))
    assert AimPage.of(tmp_path, few.provenance.digest) == AimPage("shapes.html", 0.02, 0.01, True)
    changed = sealed(content) | {"gain": content["gain"] | {"assured": 5.0}}
    others = ({"digest": "0" * 64}, {"schema": 2}, {"gain": 1.0}, {"objective": {"best_of_bank": 0.0}})
    for wrong in (*(content | other for other in others), {"digest": few.provenance.digest}, [], changed):
        (tmp_path / "shapes.json").write_text(json.dumps(wrong))
        assert AimPage.of(tmp_path, few.provenance.digest) is None


def test_tied_rows_are_the_fewest_that_contain_the_best_with_95_percent():
    np.testing.assert_array_equal(
        tied_rows(np.array([0.04, 0.60, np.nan, 0.36, 0.0])), [False, True, False, True, False]
    )
    np.testing.assert_array_equal(tied_rows(np.array([0.10, 0.60, 0.30])), [True, True, True])
    np.testing.assert_array_equal(tied_rows(np.full(3, np.nan)), [False, False, False])


# ==== Curves of shocks measured on their FMUs, and the pages that the FMUs carry =====================================


@pytest.mark.nightly
def test_the_curve_of_an_fmu_is_the_static_force_of_its_law(fmus, shocks):
    for name in ("polylinear", "lpf1", "lpnl2"):
        law = shocks[name].law
        port, static = law.port, np.array([law.static_force(velocity) for velocity in VELOCITIES])
        expected = static + port.gas_force(0.0) + [port.seal_force(velocity) for velocity in VELOCITIES]
        np.testing.assert_allclose(shock_curve(Build(fmus[name])).force, expected, atol=1.0)


def test_every_build_of_a_bank_has_the_curve_of_its_own_parameters(fmus, unchanged):
    curves = shock_curves(study(fmus))
    assert set(curves) == set(SCALES)
    assert curves["stiff"].force[-1] > 1.5 * curves["middle"].force[-1] > 0.0
    unchanged({name: [curve.velocity, *np.split(curve.force, [12, 24, 36, 48])] for name, curve in curves.items()})


def test_a_build_whose_fmu_is_missing_has_no_curve_and_no_page(fmus, tmp_path):
    made = study(fmus)
    gone = type(made)(**{**vars(made), "bank": made.bank | {"soft": Build(tmp_path / "gone.fmu")}})
    assert "soft" not in shock_curves(gone)
    pages = copy_shock_pages(gone, tmp_path)
    assert set(pages) == set(SCALES) - {"soft"}
    assert all((tmp_path / page).read_bytes().startswith(b"<!") for page in pages.values())


# ==== Kept pages and files ===========================================================================================


@pytest.fixture
def full(few, certain, lap):
    """Return a result, sheet and extras with everything that a page can show."""
    bank = {name: Build(build.fmu, {"clicks.rebound": 20, "gas_force": 1.5}) for name, build in few.study.bank.items()}
    study = replace(
        few.study, bank=bank,
        constraints=(*few.study.constraints, Constraint(FRONT, at_least=0.002, at_most=0.2)),
        vehicle=replace(few.study.vehicle, means_trusted=False, parameters={"mass": 2.0}),
    )  # fmt: skip
    source = replace(
        few.provenance, above_band={"road": AboveBand(25.0, 0.123)},
        settings={"coupling": {"scheme": "jacobi", "step": 2e-3}},
        digests=few.provenance.digests | {"bank/notes.toml": "cd" * 32},
    )  # fmt: skip
    result = StudyResult(study, few.table, source, partial=True)
    trade_offs = (TradeOff("objective", -0.041, -0.05, -0.03, 0.0), TradeOff(HUB, 0.02, 0.01, 0.03, 0.0),
                  TradeOff(FRONT, -0.01, -0.02, 0.01, 0.0))  # fmt: skip
    certainty = certain(few, trade_offs=trade_offs)
    sheet = replace(sheet_of(result, certainty=certainty, trace_command="run {setup}"), baseline=0)
    velocity = np.linspace(-1.0, 1.0, 5)
    curves = {name: ShockCurve(velocity, (k + 1.0) * velocity) for k, name in enumerate(sheet.builds)}
    selection = select(few, [FRONT, TIRE], total=4).chosen
    extras = Extras({12: lap(1), 30: lap(2)}, available_sensitivities(few), selection, curves, {"B/B": "shocks/b.html"},
                    AimPage("shapes.html", 0.021, 0.012, True))  # fmt: skip
    return result, sheet, extras


def test_the_page_of_a_study_is_unchanged(full, stores, unchanged):
    content = content_of(page(*full[1:]))
    manifest, _ = packed(*full[1:], [1, 2])
    unchanged(content["words"])
    unchanged({"manifest": manifest_lines(manifest), "arrays": stores[-1].arrays}, "numbers")


def test_the_files_of_a_study_are_unchanged(full, lap, tmp_path, unchanged):
    result, sheet, _ = full
    lines = write_ranking(sheet, tmp_path / "ranking.csv").read_text(encoding="utf-8").splitlines()
    book = openpyxl.load_workbook(write_workbook(sheet, tmp_path / "ranking.xlsx"))
    forms = {f"{page.title} {key}": one.width for page in book for key, one in page.column_dimensions.items()}
    cells = {page.title: [" | ".join(map(str, row)) for row in islice(page.values, 12)] for page in book}
    ranking = book["Ranking"]
    shading = [str(one.sqref) for one in ranking.conditional_formatting]
    formats = [cell.number_format for cell in ranking[2]]
    traces = write_traces(sheet, 12, lap(1), tmp_path / "setup.csv").read_text(encoding="utf-8").splitlines()
    unchanged({"csv": [*lines[:25], lines[-1]], "workbook": cells, "widths": forms, "formats": formats,
               "shading": shading, "filter": [ranking.auto_filter.ref, ranking.freeze_panes],
               "traces": traces[:12]})  # fmt: skip
    alike = StudyResult(replace(result.study, alike=(("lf", "rf"),)), result.table, result.provenance)
    unchanged({"answer": answer_of(sheet), "facts": [": ".join(one) for one in background(alike, "").facts]}, "answer")
    unchanged(study_verdict(result, sheet.certainty).to_json(), "verdict")


def test_colours_of_builds_are_unchanged(unchanged):
    unchanged(list(build_colors(20)))


@pytest.mark.parametrize(("better", "first"), [("low", [2, 0, 1, 3]), ("high", [1, 2, 0, 3])])
def test_setups_with_equal_values_are_in_the_order_of_their_numbers(sheet, better, first):
    values = np.array([-1.0, 0.5, -1.0 if better == "high" else -2.0, np.nan])
    column = replace(sheet.measures[0], values=values, better=better)
    numbers = np.array([5, 1, 3, 0])
    small = replace(sheet, objective=None, measures=(column,), numbers=numbers, allowed=np.ones(4, bool), failures={})
    assert small.order.tolist() == first


@pytest.mark.parametrize(("largest", "form"), [
    (1000.0, "0"), (999.0, "0.0"), (100.0, "0.0"), (99.0, "0.00"), (10.0, "0.00"), (9.9, "0.0000"), (-1000.0, "0"),
])  # fmt: skip
def test_a_column_of_the_workbook_shows_four_digits(sheet, largest, form, tmp_path):
    values = np.where(np.arange(sheet.numbers.size) == 0, largest, min(largest, 0.0))
    column = replace(sheet.measures[-1], scale=Scale.of("1"), values=values)
    one = replace(sheet, objective=None, measures=(column,))
    ranking = openpyxl.load_workbook(write_workbook(one, tmp_path / "ranking.xlsx"))["Ranking"]
    assert ranking.cell(2, 3 + len(sheet.corners)).number_format == form
