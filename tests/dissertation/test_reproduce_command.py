"""`eightpost reproduce` prints a line per item, writes one offline page, and its exit code says what it found."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

import eightpost
from dissertation import Findings, plots, reproduction
from dissertation.plots import TRUTH, Line, Plot, decibels, figure_of
from eightpost.__main__ import main
from eightpost.report.charts import COLORS, MEASURED, Axis


def run(*words):
    return CliRunner().invoke(main, ["reproduce", *words])


def test_an_item_is_a_line_and_an_anchor_on_the_page(tmp_path):
    result = run("table-7.1", "eq4.2", "figure-3.9", "-o", str(tmp_path))
    assert result.exit_code == 0, result.output
    assert "Table 7.1 reproduced: 20 of 20 values within tolerance" in result.output
    assert "Figure 3.9 nothing to compute: a photograph" in result.output
    page = (tmp_path / "reproduce.html").read_text(encoding="utf-8")
    for name in ("table-7.1", "equation-4.2", "figure-3.9"):
        assert f'href="#{name}"' in page
        assert f'id="{name}"' in page
    assert not re.search(r"(src|href)=\"https?:", page), "the page must not load anything"


def test_a_difference_beyond_its_tolerance_is_exit_code_1(tmp_path, monkeypatch):
    values = {f"{row}/{n}": n**4 for row in ("setups", "hours") for n in range(1, 11)}
    monkeypatch.setattr(reproduction, "computations", lambda chapter: {"table-7.1": lambda effort: Findings(values)})
    result = run("table-7.1", "-o", str(tmp_path))
    assert result.exit_code == 1
    assert "Table 7.1 differs" in result.output
    assert "BEYOND" in (tmp_path / "reproduce.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(("words", "text"), [(["8.1"], "the nearest are"), ([], "--list")])
def test_an_unknown_or_missing_number_is_exit_code_2(words, text):
    result = run(*words)
    assert result.exit_code == 2
    assert text in result.output


def test_the_list_computes_nothing(monkeypatch):
    monkeypatch.setattr(reproduction, "computations", lambda chapter: pytest.fail("nothing must be computed"))
    result = run("7", "--list")
    assert result.exit_code == 0
    assert "Table 7.5" in result.output
    assert "Table 3.5" not in result.output


def test_without_a_checkout_the_verb_says_where_the_dissertation_is(monkeypatch, tmp_path):
    monkeypatch.setattr(eightpost, "__file__", str(tmp_path / "site-packages" / "eightpost" / "__init__.py"))
    result = run("7.2", "-o", str(tmp_path))
    assert result.exit_code == 2
    assert "dissertation/ of the source distribution and the repository of eightpost, not in its wheel" in " ".join(
        result.output.split()
    )
    assert run("--help").exit_code == 0


@pytest.fixture
def drawn(monkeypatch):
    """Calls that draw lines: panel, kind, name, number of points, colour and size."""
    calls = []

    def call(kind):
        return lambda panel, x, _y, *, name, color, size=None: calls.append((panel, kind, name, x.size, color, size))

    figure = SimpleNamespace(**{kind: call(kind) for kind in ("dots", "marks", "line")})
    monkeypatch.setattr(plots, "grid_figure", lambda *_args, **_options: figure)
    return calls


def test_a_line_is_drawn_in_its_style_and_only_lines_and_dots_are_thinned(drawn):
    x, styles = np.arange(2400.0), ("line", "dots", "marks", "points")
    figure_of("", [Plot("", Axis("x"), Axis("y"), [Line("ours", x, x, style)]) for style in styles])
    shown = [("line", 400, None), ("dots", 1200, None), ("marks", 2400, None), ("dots", 2400, 7)]
    assert drawn == [(k, kind, "ours", points, COLORS[0], size) for k, (kind, points, size) in enumerate(shown)]


def test_a_name_has_one_colour_in_all_panels_and_the_truth_is_grey(drawn):
    x = np.arange(3.0)
    rows = [[TRUTH, "estimate"], ["fit", "estimate", TRUTH]]
    figure_of("", [Plot("", Axis("x"), Axis("y"), [Line(name, x, x) for name in row]) for row in rows])
    assert [(panel, name, color) for panel, _, name, _, color, _ in drawn] == [
        (0, TRUTH, MEASURED),
        (0, "estimate", COLORS[0]),
        (1, "fit", COLORS[1]),
        (1, "estimate", COLORS[0]),
        (1, TRUTH, MEASURED),
    ]


def test_a_figure_has_as_many_rows_as_its_panels_need(monkeypatch):
    monkeypatch.setattr(plots, "grid_figure", lambda _, height, __, columns, **___: (columns, height))
    found = [figure_of("", [Plot("", Axis("x"), Axis("y"))] * panels) for panels in (1, 3, 4, 7)]
    assert found == [(1, 350), (3, 350), (3, 610), (3, 870)]


def test_ten_times_the_unit_is_20_decibels():
    assert decibels(np.array([2.0, -20.0, 0.2]), 2.0) == pytest.approx([0.0, 20.0, -20.0])
    assert np.isfinite(decibels(np.zeros(1))).all()
