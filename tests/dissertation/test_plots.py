"""Each style of a line is drawn as such, with the points that the page needs."""

from types import SimpleNamespace

import numpy as np
import pytest

from dissertation import plots
from dissertation.plots import TRUTH, Line, Plot, decibels, figure_of
from eightpost.report.charts import COLORS, MEASURED, Axis


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
