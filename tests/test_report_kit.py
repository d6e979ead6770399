"""The report kit: pages, tables, small plots, and the glossary of the pages."""

import base64
import gzip
import io
import json
import re

import numpy as np
import pytest
import scipy.signal
from markupsafe import Markup
from rich.console import Console

from cosim.study.answer import small_plot
from eightpost.report import page
from eightpost.report.charts import COLORS, MEASURED, Axis, grid_figure, row_figure
from eightpost.report.console import print_error
from eightpost.report.page import Section, Store, document, explained, glossary, soft, spectra, traces, welch
from eightpost.report.pictures import Cloud, Mark, cloud, loop, picture
from eightpost.report.pictures import traces as traces_of
from eightpost.report.static import Picture, static_page
from eightpost.report.tables import (
    Amount,
    Display,
    ResultTable,
    cell_html,
    figure,
    file_size,
    fixed,
    listed,
    percent,
    plain,
    result_table,
    unit_html,
)
from eightpost.signals import TimeSeries
from eightpost.verdict import Grade, Rule, Verdict
from tests.drawn import drawn

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


def test_a_figure_is_as_high_as_its_rows_of_panels_need():
    axes = [(Axis("v"), Axis("F"), "")]
    assert [row_figure("", 170, axes * count, 2, gap=0.2).height for count in (2, 3, 4)] == [280, 450, 450]
    places = [panel.row for panel in row_figure("", 170, axes * 3, 2, gap=0.2).panels]
    assert places == [pytest.approx((0.57, 1.0)), pytest.approx((0.57, 1.0)), pytest.approx((0.0, 0.43))]


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


# ---- Numbers, charts, plots and pictures, kept figure by figure -----------------------------------------------------


@pytest.mark.parametrize(("function", "arguments", "text"), [
    (figure, (0.0,), "0"), (figure, (1234.5678,), "1235"), (figure, (-1.5e-5,), "−1.5·10⁻⁵"),
    (figure, (1e16, 2), "1·10¹⁶"), (fixed, (1e-4,), "0.0001000"), (fixed, (9.9e-5,), "9.9·10⁻⁵"),
    (fixed, (99999.0,), "99999"), (fixed, (1e5,), "1·10⁵"), (fixed, (162.0,), "162.0"), (fixed, (10.0, 2), "10"),
    (fixed, (9.99, 3), "9.99"), (fixed, (1.0, 3), "1.00"), (plain, (1234.5, 3), "1230"),
    (plain, (999999.0, 3), "1000000"),
    (plain, (1e6, 3), "1.00e+06"), (plain, (-2.0, 3), "-2.00"), (plain, (0.00001, 3), "1.00e-05"),
    (plain, (123.0, 3), "123"), (percent, (99.4,), "99 %"), (percent, (99.5,), "99.5 %"), (percent, (99.96,), "100 %"),
    (percent, (-99.7,), "−99.7 %"), (percent, (100.4,), "100 %"), (percent, (12.34,), "12 %"),
    (percent, (-0.5,), "−0.5 %"), (percent, (123.4,), "123 %"),
])  # fmt: skip
def test_a_number_has_its_digits(function, arguments, text):
    assert function(*arguments).replace("\xa0", " ") == text


@pytest.mark.parametrize(("count", "text"), [
    (8, "0, 1, 2, 3, 4, 5, 6, 7"), (9, "0, 1, 2, 3, 4, 5, 6, 7, 8"), (10, "0, 1, 2, 3, 4, 5, 6, 7 and 2 more"), (0, ""),
])  # fmt: skip
def test_a_long_list_is_cut_where_two_or_more_names_are_saved(count, text):
    assert listed([str(k) for k in range(count)]) == text


def test_a_file_is_as_large_as_its_kibibytes(tmp_path):
    (tmp_path / "a").write_bytes(b"x" * 3000)
    assert file_size(tmp_path / "a") == "3 KiB"


def test_a_chart_is_unchanged(unchanged):
    axes = [(Axis("v", "m/s"), Axis("F", "N"), "first"), (Axis("f", "", "log", (0.0, 2.0)), Axis("|H|"), ""),
            (Axis("t", "s"), Axis("x", "m"), "third")]  # fmt: skip
    made, x = row_figure("a caption", 170, axes, 2, gap=0.2), np.linspace(-1.23456789, 1.0, 4)
    made.line(0, x, 1000.0 * x, name="measured", color=MEASURED)
    made.line(0, x, 1000.0 * x, name="law", color=COLORS[1], dash="dash")
    made.dots(1, x**2, x, name="dots", size=3.5)
    made.dots(1, x**2, x, name="dots")
    made.marks(2, x, np.zeros(4), name="", color=COLORS[2], symbol="square")
    made.ribbon(2, x, x - 1.0, x + 1.0, name="band", color=COLORS[3])
    made.band(1, 2.0, 8.0)
    made.level(1, 0.95)
    content = made.content()
    unchanged({"units": content["units"], "all": sorted(made.units), "height": made.height,
               "data": [json.dumps(one) for one in content["data"]],
               "layout": [f"{key} {json.dumps(value)}" for key, value in content["layout"].items()]})  # fmt: skip


@pytest.mark.parametrize(("names", "length", "top"), [(0, 0, 30), (1, 4, 58), (14, 60, 302), (40, 5, 112), (11, 5, 58)])
def test_the_legend_above_a_chart_has_columns_of_equal_width(names, length, top):
    made = grid_figure("", 300, [(Axis("v"), Axis("F"), "")], 1, gap=(0.0, 0.0))
    for k in range(names):
        made.line(0, np.zeros(2), np.zeros(2), name=f"{k:0{length}d}", color="#000")
    assert made.content()["layout"]["margin"]["t"] == top


def test_small_plots_are_unchanged(unchanged):
    x = np.linspace(-0.9, 0.7, 5)
    curves = [(x, 900.0 * x + 30.0, "today"), (x, 1500.0 * x**3, "chosen")]
    flat = [(np.zeros(2), np.full(2, 5.0), "chosen")]
    velocity, force = ("velocity", Display.us("m/s")), ("force", Display.us("N"))
    metric = ("v", Display.of("m/s", "mm/s")), ("F", Display.of("N", "N"))
    unchanged({"curves": small_plot(curves, velocity, force, "a label"), "metric": small_plot(curves, *metric, "c"),
               "flat": small_plot(flat, velocity, force, "force & <velocity>")})  # fmt: skip


def test_pictures_of_series_and_points_are_unchanged(unchanged):
    time = np.arange(0.0, 30.0, 0.05)
    rows = {f"c{k}": ("N" if k % 2 else "m/s", np.sin((1.0 + k) * time)) for k in range(14)}
    long, short = (
        TimeSeries.from_channels(time[:n], {k: (u, v[:n]) for k, (u, v) in rows.items()}) for n in (600, 160)
    )
    kept = time[:250] < 8.0
    points = Cloud((np.sin(time[:250]), time[:250]), ("x", "y"), kept, (Mark("best", 3), Mark("today", 40)))
    few = Cloud((np.cos(time[:9]), time[:9]), ("x", "y"), kept[:9], is_line=True)
    unchanged({
        "long": drawn(picture(long, title="a title").figure)[:12],
        "short": drawn(picture(short, ["c0", "c1"]).figure),
        "part": drawn(picture(long, "c1", start=3.0, stop=4.0).figure),
        "runs": drawn(traces_of({"one": long, "two": short}, ["c1"], start=0.0, stop=2.0, title="t")),
        "loop": drawn(loop(long, "c0", "c1", title="u").figure),
        "cloud": drawn(cloud(points, title="setups").figure), "line": drawn(cloud(few).figure),
    })  # fmt: skip


@pytest.mark.parametrize(("stop", "shown"), [(8.0, (0.0, 8.0)), (8.125, (2.0625, 6.0625))])
def test_of_a_series_of_more_than_eight_seconds_the_middle_is_drawn(stop, shown):
    time = np.arange(0.0, stop + 1e-9, 0.0625)
    (line,) = picture(TimeSeries.from_channels(time, {"c": ("N", time)})).figure.axes[0].lines
    assert (line.get_xdata()[0], line.get_xdata()[-1]) == pytest.approx(shown)


@pytest.mark.parametrize(("columns", "broken"), [(7, False), (8, True)])
def test_a_table_of_many_columns_has_less_space_between_them(columns, broken):
    heads = [f"h{k}" for k in range(columns)]
    shown = result_table(ResultTable.of("", heads, [list(range(columns))]))
    assert (shown.collapse_padding, shown.pad_edge) == (broken, not broken)


def test_series_that_hardly_fit_into_a_page_are_thinned_and_shorter_ones_are_not():
    time = np.arange(41) * 0.1
    series = TimeSeries.from_channels(time, {"a": ("N", np.sin(time)), "b": ("N", np.cos(3.0 * time))})
    whole, thin, least = (traces(series, capacity=capacity) for capacity in (84, 80, 1))
    assert (whole.samples, whole.values.shape[1], whole.interval) == (1, 41, pytest.approx(0.1))
    assert (thin.samples, thin.values.shape[1], thin.interval) == (3, 28, pytest.approx(0.3))
    assert thin.time[:4] == pytest.approx([0.0, 0.1, 0.3, 0.4]) and (least.samples, least.values.shape[1]) == (41, 2)


@pytest.mark.parametrize(("count", "known"), [(15, False), (16, True), (400, True)])
def test_a_spectrum_needs_sixteen_samples_and_has_blocks_of_four_seconds(count, known):
    time = np.arange(count) * 0.02
    found = spectra(TimeSeries.from_channels(time, {"a": ("N", np.sin(20.0 * time))}))
    assert (found is not None) == known
    if found is not None:
        assert found.block == pytest.approx(min(count * 0.02, 4.0)) and found.duration == pytest.approx(time[-1])
        assert found.frequency[0] == pytest.approx(1.0 / found.block)
    assert spectra(TimeSeries(time, np.empty((0, count)), (), ())) is None


def test_numbers_of_a_page_begin_at_multiples_of_eight_bytes_and_come_back():
    store, values = Store(), np.array([0.25, -1.5, 3.0])
    places = [store.add_single(values), store.add(values), store.add_levels(values), store.add_levels(np.ones(2))]
    content = gzip.decompress(base64.b64decode(store.text))
    assert places == [0, 16, 40, 48] and np.frombuffer(content, "<f8", 3, 16).tolist() == values.tolist()
    assert np.frombuffer(content, "<f4", 3, 0).tolist() == values.tolist()
    levels = np.cumsum(np.frombuffer(content, "<u2", 3, 40).astype(int)) % 65536
    assert levels.tolist() == [round(1.75 / 4.5 * 65535), 0, 65535] and content[48:52] == bytes(4)
