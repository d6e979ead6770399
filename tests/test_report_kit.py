"""The report kit: pages, tables, small plots, and the glossary of the pages."""

import base64
import gzip
import io
import re

import numpy as np
import pytest
import scipy.signal
from markupsafe import Markup
from rich.console import Console

from eightpost.report import page
from eightpost.report.charts import Axis, grid_figure, row_figure
from eightpost.report.console import print_error
from eightpost.report.numbers import Display
from eightpost.report.packing import welch
from eightpost.report.page import Section, document, explained, glossary, soft
from eightpost.report.small_plot import HEIGHT, WIDTH, small_plot
from eightpost.report.static import Picture, static_page
from eightpost.report.tables import Amount, ResultTable, cell_html, result_table, unit_html
from eightpost.verdict import Grade, Rule, Verdict

# ---- Pages, tables and numbers --------------------------------------------------------------------------------------


def test_a_page_shows_pressures_in_psi_and_bar():
    assert unit_html("Pa") == '<span class="us">psi</span><span class="si">bar</span>'
    assert cell_html(Amount(1e6, "Pa", 3)) == '<span class="us">145</span><span class="si">10.0</span>'


NASTY = "</script><b>[bold]"
TABLE = ResultTable.of("forces", ["record", "RMS [N]", "unit"], [(NASTY, 4.4482216, "m/s"), ("b", None, "s")])


def test_texts_of_a_document_are_escaped_and_html_is_not():
    blocks = [NASTY, (NASTY,), soft(NASTY), TABLE, Markup("<p>a <em>word</em></p>")]
    html = document(NASTY, Verdict(), [Section("one", NASTY, blocks)], lead=NASTY)
    assert "<b>" not in html
    assert html.count("&lt;b&gt;[bold]") == 9  # title twice, lead, link, heading, paragraph, list, soft text, cell
    assert "<em>word</em>" in html


def test_a_table_of_a_page_has_both_unit_systems():
    html = document("t", Verdict(), [Section("one", "One", [TABLE])])
    assert '<th class="number">RMS [<span class="us">lbf</span><span class="si">N</span>]</th>' in html
    assert '<td class="number"><span class="us">1.00</span><span class="si">4.45</span></td>' in html
    assert '<td><span class="us">in/s</span><span class="si">m/s</span></td>' in html


def test_a_table_in_a_terminal_has_us_customary_units():
    console = Console(file=io.StringIO(), width=80)
    console.print(result_table(TABLE))
    shown = console.file.getvalue()
    assert all(text in shown for text in (NASTY, "RMS, lbf", "1.00", "in/s", "–"))


def test_a_unit_that_nobody_knows_is_shown_unchanged_and_a_density_is_squared():
    assert Display.of("smiles").unit == "smiles"
    density = Display.of("N2/Hz")
    assert (density.unit, density.factor) == ("lbf2/Hz", Display.of("N").factor ** 2)
    assert Display.of("m/s").squared == ("(in/s)²", "(m/s)²")
    assert Amount(1.0, "N").digits == 3


def test_many_reasons_are_folded_only_if_the_page_asks_for_it():
    rule = Rule("r", "a", Grade.LIMITED, condition="c", why="w", remedy="m")
    verdict = Verdict(rule.reason(f"finding {k}", figure="1", origin="here") for k in range(8))
    for fold, more in ((0, 0), (8, 0), (3, 5)):
        html = document("t", verdict, [], fold=fold)
        assert (f"{more} more findings" in html) == bool(more)
        assert all(f"finding {k}:" in html for k in range(8))


def test_a_ribbon_surrounds_its_line_and_leaves_the_legend_to_it():
    figure = grid_figure("", 300, [(Axis("v", "m/s"), Axis("F", "N"), "")], 1, gap=(0.1, 0.1))
    x = np.array([0.0, 1.0, 2.0])
    figure.ribbon(0, x, x - 1.0, x + 1.0, name="law", color="#000")
    figure.line(0, x, x, name="law", color="#000")
    ribbon, line = figure.content()["data"]
    assert (ribbon["x"], ribbon["y"]) == ([0, 1, 2, 2, 1, 0], [-1, 0, 1, 3, 2, 1])
    assert (ribbon["showlegend"], line["showlegend"]) == (False, True)


def test_panels_fill_a_grid_row_by_row_from_above_with_gaps_between():
    figure = grid_figure("", 300, [(Axis("v"), Axis("F"), str(k)) for k in range(3)], 2, gap=(0.2, 0.1))
    places = [(*panel.column, *panel.row) for panel in figure.panels]
    above, below = (0.55, 1.0), (0.0, 0.45)
    assert places == [
        pytest.approx((0.0, 0.4, *above)), pytest.approx((0.6, 1.0, *above)), pytest.approx((0.0, 0.4, *below)),
    ]  # fmt: skip


def test_a_figure_is_as_high_as_its_rows_of_panels_need():
    axes = [(Axis("v"), Axis("F"), "")]
    assert [row_figure("", 170, axes * count, 2, gap=0.2).height for count in (2, 3, 4)] == [280, 450, 450]
    places = [panel.row for panel in row_figure("", 170, axes * 3, 2, gap=0.2).panels]
    assert places == [pytest.approx((0.57, 1.0)), pytest.approx((0.57, 1.0)), pytest.approx((0.0, 0.43))]


def test_the_space_above_a_figure_grows_with_its_legend():
    tops = []
    for count in (0, 2, 40):
        figure = grid_figure("", 300, [(Axis("v"), Axis("F"), "heading")], 1, gap=(0.1, 0.1))
        for k in range(count):
            figure.line(0, np.zeros(2), np.zeros(2), name=f"a long name of a build {k}", color="#000")
        tops.append(figure.content()["layout"]["margin"]["t"])
    assert tops[0] < tops[1] < tops[2]


@pytest.mark.parametrize("length", [16, 64, 65])
def test_spectral_densities_are_those_of_scipy(length):
    values = np.random.default_rng(3).normal(2.0, 1.0, (2, 300)).cumsum(axis=-1)
    frequency, density = welch(values, 50.0, length)
    expected = scipy.signal.welch(values, fs=50.0, nperseg=length, detrend="constant")
    assert frequency == pytest.approx(expected[0])
    assert density == pytest.approx(expected[1], rel=1e-9)


@pytest.mark.slow
def test_templates_and_the_plotting_library_are_prepared_once_for_all_processes(tmp_path, monkeypatch):
    monkeypatch.setenv("EIGHTPOST_CACHE", str(tmp_path))
    page._plotly.cache_clear()

    def written():
        """Return the library, and a page without the minute in which it is written."""
        return page._plotly(), re.sub(r"\d\d:\d\d UTC", "", document("a", Verdict(), [Section("b", "B", ["c"])]))

    first = written()
    assert gzip.decompress(base64.b64decode(first[0])).decode() == page.get_plotlyjs()
    page._plotly.cache_clear()
    compress = gzip.compress
    monkeypatch.setattr(gzip, "compress", lambda content, **how: compress(content[:1000], **how))
    monkeypatch.setattr("jinja2.environment.Environment._compile", None)
    assert written() == first


def test_a_page_without_scripts_escapes_its_texts():
    html = static_page(NASTY, NASTY, NASTY, [("a", NASTY)], Picture(b"", NASTY), "<p>body</p>")
    assert not re.search("<b>|<script", html)
    assert "<p>body</p>" in html


# ---- Small plots ----------------------------------------------------------------------------------------------------

INCH, POUND = 0.0254, 4.4482216152605
VELOCITY = ("velocity", Display.us("m/s"))
FORCE = ("force", Display.us("N"))


def _plot(x, y):
    return small_plot([(np.array(x) * INCH, np.array(y) * POUND, "chosen")], VELOCITY, FORCE, "force & <velocity>")


def _points(svg):
    (text,) = re.findall(r'points="([^"]*)"', svg)
    return np.array([[float(part) for part in pair.split(",")] for pair in text.split()])


def test_a_curve_fills_the_plot_and_upwards_is_more():
    points = _points(_plot([-10.0, 0.0, 10.0], [-100.0, 0.0, 300.0]))
    assert points[0] == pytest.approx([42.0, HEIGHT - 32.0]) and points[2] == pytest.approx([WIDTH - 6.0, 8.0])
    assert points[1, 0] == pytest.approx(0.5 * (42.0 + WIDTH - 6.0))
    assert points[1, 1] == pytest.approx(HEIGHT - 32.0 - 0.25 * (HEIGHT - 40.0), abs=0.06)


def test_the_axes_have_round_numbers_in_the_unit_that_is_shown():
    svg = _plot([-38.0, 38.0], [-520.0, 640.0])
    numbers = re.findall(r">([−0-9.]+)</text>", svg)
    assert numbers == ["−20", "0", "20", "−500", "0", "500"]
    assert svg.count('class="axis"') == 2 and "velocity [in/s]" in svg and "force [lbf]" in svg


def test_a_number_is_at_the_place_of_its_value():
    svg = _plot([0.0, 10.0], [0.0, 100.0])
    place = float(re.search(r'x="([0-9.]+)" y="[0-9.]+">4</text>', svg)[1])
    assert place == pytest.approx(42.0 + 0.4 * (WIDTH - 48.0), abs=0.1)


def test_a_constant_curve_is_drawn_in_the_middle_and_the_label_is_escaped():
    svg = _plot([0.0, 1.0], [5.0, 5.0])
    assert np.ptp(_points(svg)[:, 1]) == 0.0
    assert 'aria-label="force &amp; &lt;velocity&gt;"' in svg


# ---- Words that a page explains -------------------------------------------------------------------------------------


def test_a_page_explains_the_words_that_it_contains_and_no_others():
    html = document("Curves", Verdict(), [Section("one", "One", ["a <b> Pareto front & its knees, RMS"])])
    words = html[html.index('class="words"') : html.index("<footer")]
    assert re.findall("<dt>(.*?)</dt>", words) == ["knee", "Pareto front", "RMS"]
    assert '<a href="#words">' in html


def test_words_are_found_in_any_spelling_and_not_inside_others_or_in_tags():
    assert list(explained("<p title='lag'>Coherent errors flag the FMUs</p>")) == ["coherence", "FMU"]
    assert list(explained("<style>knee</style><p>hysteresis, hysterical</p>")) == ["hysteresis"]
    assert explained("<p>a run of the setup</p>") == {}  # common words
    assert list(explained("<p>today the law Hysteresis</p>")) == ["baseline", "hysteresis", "Hysteresis"]


def test_every_word_has_a_short_definition_without_a_full_stop():
    words = glossary(common=True)
    assert len(words) > len(glossary()) > 40
    assert [word for word, text in words.items() if not 10 <= len(text) <= 130 or text.endswith(".")] == []


@pytest.mark.parametrize(("terminal", "widest"), [("1", 80), ("", 182)])
def test_an_error_is_wrapped_between_words_in_a_terminal_and_one_line_in_a_file(terminal, widest, monkeypatch, capsys):
    monkeypatch.setenv("FORCE_COLOR", terminal)
    monkeypatch.setenv("COLUMNS", "80")
    text = "lf.force in run3.csv has no unit; " * 4 + "give it with --channel 'lf.force=[lbf]'"
    print_error(text)
    lines = re.sub("\x1b[^m]*m", "", capsys.readouterr().err).splitlines()
    assert max(map(len, lines)) in range(widest - 15, widest + 1)
    assert " ".join(" ".join(lines).split()) == f"error: {text}"
