"""Each style of a line is drawn as such, with the points that the page needs."""

from __future__ import annotations

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


@pytest.mark.parametrize(
    ("style", "kind", "points", "size"),
    [
        ("line", "line", 400, None),
        ("dots", "dots", 1200, None),
        ("marks", "marks", 2400, None),
        ("points", "dots", 2400, 7),
    ],
)
def test_a_line_is_drawn_in_its_style_and_only_lines_and_dots_are_thinned(style, kind, points, size, drawn):
    x = np.arange(2400.0)
    figure_of("", [Plot("", Axis("x"), Axis("y"), [Line("ours", x, x, style)])])
    assert drawn == [(0, kind, "ours", points, COLORS[0], size)]


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


@pytest.mark.parametrize(("panels", "columns", "height"), [(1, 1, 350), (3, 3, 350), (4, 3, 610), (7, 3, 870)])
def test_a_figure_has_as_many_rows_as_its_panels_need(panels, columns, height, monkeypatch):
    given = []
    monkeypatch.setattr(plots, "grid_figure", lambda *arguments, **_: given.append(arguments))
    figure_of("", [Plot("", Axis("x"), Axis("y"))] * panels)
    ((_, found, _, across),) = given
    assert (found, across) == (height, columns)


def test_ten_times_the_unit_is_20_decibels():
    assert decibels(np.array([2.0, -20.0, 0.2]), 2.0) == pytest.approx([0.0, 20.0, -20.0])
    assert np.isfinite(decibels(np.zeros(1))).all()
