"""The study's page in a browser: sorting, filters, brush and clicks, with 2401 setups or 81, without any error."""

import base64
import json
import re
from importlib.resources import files

import numpy as np
import pytest

from cosim.study.choice.rig_day import select
from cosim.study.choice.sensitivity import available_sensitivities
from cosim.study.page import page
from cosim.study.sheet import Extras, sheet_of

FRONT, TIRE, HUB = "front ride height, RMS", "total tire force, RMS", "rf hub acceleration, RMS"
IN, LBF = 0.0254, 4.4482216152605  # exact definitions

_ROWS = "[...document.querySelectorAll('#ranking tbody tr[data-row]')]"
_HEADS = "[...document.querySelectorAll('#ranking th')]"
# Two frames: changes are drawn in the first of them.
_DRAWN = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done(true))))"
# Margins of a panel as in script/dots.js: left, right, top, bottom [px]; margin beyond the levels 0 and 1.
_LEFT, _RIGHT, _TOP, _BOTTOM, _ROOM = 78.0, 12.0, 26.0, 46.0, 0.03
# Number of coloured pixels in the right part of the first trade-off, at levels above 50 %.
_COLORED = """(() => {
  const drawn = document.querySelector('#trades canvas'), x = Math.round(0.6 * drawn.width);
  const copy = document.createElement('canvas');
  Object.assign(copy, { width: drawn.width, height: drawn.height });
  const pen = copy.getContext('2d');
  pen.drawImage(drawn, 0, 0);
  const { data } = pen.getImageData(x, 30, drawn.width - x, drawn.height - 80);
  let count = 0;
  for (let k = 0; k < data.length; k += 4) {
    const [red, green, blue, opaque] = data.slice(k, k + 4);
    if (opaque > 100 && Math.max(red, green, blue) - Math.min(red, green, blue) > 60) count++;
  }
  return count;
})()"""
_FIND = "{{ const box = document.getElementById('find'); box.value = '{}'; box.dispatchEvent(new Event('input')); }}"
_AXIS = "document.querySelector('#traces .js-plotly-plot').layout.yaxis.title.text"
_EFFECTS = "JSON.stringify(document.querySelector('#effects').data.map((line) => [...line.y]))"


class _Page:
    """The page on the screen of a laptop, with actions of a reader."""

    def __init__(self, browser, path):
        self.browser, self.path = browser, path
        browser.call("Emulation.setDeviceMetricsOverride", width=1366, height=768, deviceScaleFactor=1, mobile=False)
        browser.call("Page.navigate", url=path.as_uri())
        browser.until("document.body && document.body.dataset.ready")

    def do(self, code):
        value = self.browser.evaluate(code)
        self.browser.evaluate(_DRAWN)
        return value

    def click(self, selector):
        self.do(f"document.querySelector('{selector}').click()")

    def text(self, selector):
        return self.do(f"document.querySelector('{selector}').textContent")

    def rows(self):
        """Return the table rows in the document, cell by cell."""
        return json.loads(self.do(f"JSON.stringify({_ROWS}.map((r) => [...r.cells].map((c) => c.textContent)))"))

    def column(self, head):
        heads = json.loads(self.do(f"JSON.stringify({_HEADS}.map((h) => h.textContent))"))
        return next(k for k, text in enumerate(heads) if text.startswith(head))

    def sort(self, head):
        self.do(f"{_HEADS}.find((h) => h.textContent.startsWith('{head}')).querySelector('button').click()")
        return self.rows()

    def shown(self):
        """Return the number of setups that pass the filters, as shown on the page."""
        return int(self.text("#shown").split()[0])

    def focus(self, measure):
        self.do(
            "{ const box = document.getElementById('focus');"
            f"box.value = [...box.options].find((o) => o.text === '{measure}').value;"
            "box.dispatchEvent(new Event('change')); }"
        )

    def panel(self, selector):
        """Scroll a panel to the middle of the window; return the conversion from levels to pixels of the window."""
        self.do(f"document.querySelector('{selector}').scrollIntoView({{block: 'center'}})")
        frame = json.loads(self.do(f"JSON.stringify(document.querySelector('{selector}').getBoundingClientRect())"))
        width, height = frame["width"] - _LEFT - _RIGHT, frame["height"] - _TOP - _BOTTOM

        def place(x, y):
            across, up = ((level + _ROOM) / (1.0 + 2.0 * _ROOM) for level in (x, y))
            return frame["x"] + _LEFT + across * width, frame["y"] + _TOP + (1.0 - up) * height

        return place


@pytest.fixture(scope="session")
def whole(surrogate):
    return surrogate()


@pytest.fixture(scope="session")
def chosen(whole, certain):
    return certain(whole)


@pytest.fixture(scope="session")
def small(surrogate):
    return surrogate(("AA/AA", "C/C", "B/B"))


@pytest.fixture(scope="session")
def ties(small, certain):
    return certain(small)


def _written(result, certainty, lap, folder):
    best, baseline = (int(result.setups[row]) for row in (result.ranking()[0], result.baseline_row))
    extras = Extras(
        traces={best: lap(1), baseline: lap(2)},
        sensitivities=available_sensitivities(result),
        selection=select(result, [FRONT, TIRE, HUB], total=20).chosen,
    )
    sheet = sheet_of(result, certainty=certainty, trace_command="eightpost study --trace {setup}")
    (folder / "report.html").write_text(page(sheet, extras), encoding="utf-8")
    return folder / "report.html"


@pytest.fixture(scope="session")
def written(whole, chosen, lap, tmp_path_factory):
    return _written(whole, chosen, lap, tmp_path_factory.mktemp("page"))


@pytest.fixture(scope="session")
def small_page(small, ties, lap, tmp_path_factory):
    return _written(small, ties, lap, tmp_path_factory.mktemp("small"))


def _open(browser, path):
    """Open the page; after the test, check that it loaded nothing and reported no error."""
    browser.events.clear()
    yield _Page(browser, path)
    urls = [e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"]
    assert [url for url in urls if not url.startswith(("data:", "blob:"))] == [path.as_uri()]
    trouble = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
    assert [event for event in browser.events if event["method"] in trouble] == []


@pytest.fixture
def opened(browser, written):
    """The page of 2401 setups."""
    yield from _open(browser, written)


@pytest.fixture
def light(browser, small_page):
    """The page of 81 setups."""
    yield from _open(browser, small_page)


#: Counts the rows at the print, after the page's own listener.
_COUNT = """addEventListener('beforeprint', () => {
  window.rows = document.querySelectorAll('#ranking tbody tr[data-row]').length; })"""


def _levels(values):
    return (values - np.nanmin(values)) / (np.nanmax(values) - np.nanmin(values))


@pytest.mark.slow
def test_the_page_opens_with_the_best_setup_and_a_click_on_a_header_sorts_all_with_the_failed_one_last(opened, whole):
    best = int(whole.setups[whole.ranking()[0]])
    rows = opened.rows()
    assert [row[1] for row in rows[:3]] == ["1", "2", "3"] and rows[0][2] == str(best)
    assert opened.shown() == 2401 and len(rows) < 60  # the document contains only the visible rows
    assert opened.text("#pickings") == "20"
    assert f"Setup {best} has rank 1 of 2400" in opened.text("#standing")
    assert opened.do("document.documentElement.scrollWidth <= window.innerWidth")
    assert opened.do(
        "document.getElementById('ranking-pane').scrollWidth <= document.getElementById('ranking-pane').clientWidth"
    )
    assert opened.do("document.getElementById('trouble').hidden")
    front = whole.values(FRONT)
    place = opened.column(FRONT)
    assert opened.sort(FRONT)[0][place] == f"{np.nanmin(front) / IN:.4f}"
    assert opened.sort(FRONT)[0][place] == f"{np.nanmax(front) / IN:.4f}"
    opened.do("document.getElementById('ranking-pane').scrollTop = 1e6")
    last = opened.rows()[-1]
    assert last[2] == "40" and "discards the step" in last[-1]


@pytest.mark.slow
def test_the_ranking_has_the_probability_of_being_best_and_the_interval_of_what_it_is_ranked_by(opened, whole, chosen):
    place, objective = opened.column("probability of being best"), opened.column("objective (95 % interval)")
    row = opened.rows()[0]
    best = whole.setups.tolist().index(int(row[opened.column("setup")]))
    assert row[place] == f"{100 * chosen.best[best]:.1f} %"
    low, high = (ends[best] for ends in chosen.levels["objective"].interval())
    assert row[objective] == f"{whole.objective[best]:.1f} ({low:.1f} to {high:.1f})"
    opened.click("#kept [value=tied]")
    listed = {int(row[opened.column("setup")]) for row in opened.rows()}
    assert listed == set(chosen.ties) and len(listed) > 1  # whatever measure is drawn


@pytest.mark.slow
def test_a_print_is_two_sheets_with_twelve_rows_of_the_ranking(light):
    light.browser.call("Emulation.setEmulatedMedia", media="")
    light.do(_COUNT)
    printed = light.browser.call("Page.printToPDF", preferCSSPageSize=True, printBackground=True)["data"]
    assert len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(printed))) == 2
    assert light.do("window.rows") == 12


@pytest.mark.slow
def test_the_tied_setups_are_compared_side_by_side_with_one_click(light, ties):
    light.click("#unpick")
    light.click("#compare-ties")
    light.browser.until("document.querySelector('#side-by-side thead th')")
    heads = light.do("[...document.querySelectorAll('#side-by-side th')].map((h) => h.textContent).join()")
    assert len(ties.ties) > 1 and all(f"setup {number}" in heads for number in ties.ties[:5])


@pytest.mark.slow
def test_setups_are_filtered_by_corner_and_build_by_words_by_limits_and_by_being_picked(opened, whole):
    opened.click('[data-all="0"]')
    assert opened.shown() == 0
    opened.click('#builds [data-corner="0"][data-build="6"]')
    assert opened.shown() == 7**3 and {row[3] for row in opened.rows()} == {"C/C"}
    opened.do(
        "{ const box = document.getElementById('find'); box.value = 'B/AA'; box.dispatchEvent(new Event('input')); }"
    )
    assert opened.shown() == 7**3 - 6**3  # at one of the other three corners
    opened.click("#clear")
    opened.click('#kept [value="allowed"]')
    assert opened.shown() == whole.feasible.sum()
    opened.click("#clear")
    opened.click('#kept [value="picked"]')
    assert opened.shown() == 20
    opened.click('#ranking tbody input[type="checkbox"]')
    assert opened.shown() == 19


@pytest.mark.slow
def test_a_drag_in_one_plot_chooses_setups_in_all_plots_and_in_the_table(opened, whole):
    front = _levels(whole.values(FRONT))
    opened.focus(FRONT)
    place = opened.panel("#trends .panel")
    before = opened.do(_COLORED)
    opened.browser.drag(place(-0.02, 0.99), place(0.25, 0.01))
    # The mouse moves by whole pixels: a setup on the edge may be on either side.
    assert np.sum(front <= 0.247) <= opened.shown() <= np.sum(front <= 0.253)
    assert before > 500 and opened.do(_COLORED) == 0  # setups outside are not coloured in another plot
    limit = (np.nanmin(whole.values(FRONT)) + 0.253 * np.ptp(whole.values(FRONT)[whole.done])) / IN
    opened.sort(FRONT)
    assert all(float(row[opened.column(FRONT)]) <= limit for row in opened.sort(FRONT))
    opened.do("document.dispatchEvent(new KeyboardEvent('keydown', {key: 'Escape'}))")
    assert opened.shown() == 2401


@pytest.mark.slow
def test_a_click_on_a_dot_shows_its_setup_with_traces_or_the_command_that_makes_them(opened, whole):
    opened.focus(FRONT)
    row = int(np.nanargmax(whole.values(TIRE)))
    number = whole.setups[row]
    dot = opened.panel("#trades .panel")(_levels(whole.values(FRONT))[row], 1.0)
    opened.browser.drag(dot, dot)
    assert f"Setup {number} has rank" in opened.text("#standing")
    assert opened.text("#command") == f"eightpost study --trace {number}"
    percent = 100.0 * (whole.values(TIRE)[row] / whole.values(TIRE)[whole.baseline_row] - 1.0)
    assert f"+{percent:.2f} %" in opened.text("#compared")

    opened.do("document.getElementById('ranking-pane').scrollTop = 0")
    opened.click("#ranking tbody tr[data-row]")  # the best one, which has traces
    opened.do("document.getElementById('traces').scrollIntoView()")
    opened.browser.until(
        "document.querySelector('#traces .js-plotly-plot')?.data.length === 4"
    )  # including the baseline
    opened.click("#with-baseline")
    opened.browser.until("document.querySelector('#traces .js-plotly-plot').data.length === 2")
    opened.click("#whole")
    opened.browser.until("document.querySelector('#traces .js-plotly-plot').layout.xaxis.range[1] === 10")


@pytest.mark.slow
def test_the_switch_changes_the_units_of_all_numbers_and_axes(light, small):
    best = int(small.ranking()[0])
    light.do("document.getElementById('traces').scrollIntoView()")
    light.browser.until("document.querySelectorAll('#traces .js-plotly-plot').length === 2")
    assert light.do(_AXIS) == "velocity [in/s]"
    assert light.rows()[0][light.column(FRONT)] == f"{small.values(FRONT)[best] / IN:.4f}"
    light.click("input[value=si]")
    shown = f"{1e3 * small.values(FRONT)[best]:.3f}"
    assert light.rows()[0][light.column(f"{FRONT} [mm]")] == shown
    assert shown in light.text("#compared")
    light.browser.until(
        "document.querySelector('#traces .js-plotly-plot').layout.yaxis.title.text === 'velocity [mm/s]'"
    )
    # The objective and its weights are written in the units of the study file.
    light.do("document.querySelector('.question').remove(), document.querySelector('#weights').remove()")
    seen = light.do("document.body.innerText")
    assert "mm" in seen and "lbf" not in seen and "[in" not in seen


@pytest.mark.slow
def test_sensitivities_follow_the_chosen_measure(light):
    light.click('nav a[href="#sensitivity"]')  # which unfolds it
    light.browser.until("document.querySelector('#effects.js-plotly-plot')")
    assert light.do("document.querySelector('#effects').data.map((line) => line.name).join()") == "LF,RF,LR,RR"
    light.focus(HUB)
    light.browser.until("document.querySelector('#effects').layout.yaxis.title.text.includes('rf hub')")
    assert light.text("#shares tr.current td") == HUB
    effects = json.loads(light.do(_EFFECTS))
    spans = [np.ptp(effect) for effect in effects]
    assert int(np.argmax(spans)) == 1  # the right front shock, at the right front hub


_KEY = "{}.dispatchEvent(new KeyboardEvent('keydown', {{ key: '{}', bubbles: true }}))"
_TYPE = "{{ const box = {}; box.value = '{}'; box.dispatchEvent(new Event('input', {{ bubbles: true }})); }}"


@pytest.mark.slow
def test_the_page_has_no_serious_finding_of_axe_in_light_and_dark(light):
    axe = (files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8")
    for scheme in ("light", "dark"):
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        light.browser.call("Emulation.setEmulatedMedia", media="screen", features=features)
        light.do("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        light.do(axe)
        found = json.loads(light.do("axe.run().then(({ violations }) => JSON.stringify(violations))"))
        assert [(one["id"], one["nodes"][0]["html"]) for one in found if one["impact"] in ("serious", "critical")] == []


@pytest.mark.slow
def test_the_keyboard_steps_from_setup_to_setup_in_a_plot_and_in_the_table(light, small):
    panel = "document.querySelector('#trades .panel')"
    light.do(f"{panel}.focus()")
    light.do(_KEY.format(panel, "ArrowRight"))
    start = int(light.text("#spoken").split()[1].rstrip(","))
    light.do(_KEY.format(panel, "ArrowRight"))
    after = int(light.text("#spoken").split()[1].rstrip(","))
    values, numbers = small.values(TIRE), small.setups.tolist()
    above = np.sort(values[values > values[numbers.index(start)]])
    assert values[numbers.index(after)] == above[0]
    light.do(_KEY.format(panel, "Enter"))
    assert light.text("#chosen").startswith(f"{after}:")
    ranked = [int(row[light.column("setup")]) for row in light.rows()]
    light.click("#ranking tbody tr[data-row]")
    light.do(_KEY.format("document.getElementById('ranking-pane')", "ArrowDown"))
    assert light.text("#chosen").startswith(f"{ranked[1]}:")


@pytest.mark.slow
def test_other_weights_and_limits_rank_the_setups_again_and_the_page_says_so(opened, whole):
    inputs = "document.querySelectorAll('#weights input[data-field={}]')"
    opened.do(_TYPE.format(inputs.format("weight") + "[1]", "0"))  # the front ride height: total tire force remains
    feasible = np.flatnonzero(whole.feasible)
    lightest = int(whole.setups[feasible[np.argmin(whole.values(TIRE)[feasible])]])
    assert int(opened.rows()[0][opened.column("setup")]) == lightest
    assert "for those of the study" in opened.text("#reweighed")
    cost = opened.column("objective (what if)")  # the sum with these weights, without the study's probabilities
    assert float(opened.rows()[0][cost]) == pytest.approx(np.min(whole.values(TIRE)[feasible]) / LBF, rel=1e-3)
    assert "probability" not in opened.text("#ranking thead")
    limit = float(np.quantile(whole.values(TIRE)[feasible], 0.9)) / LBF
    opened.do(_TYPE.format(inputs.format("low") + "[0]", f"{limit:.6f}"))
    assert float(opened.rows()[0][opened.column(TIRE)]) == pytest.approx(limit, rel=2e-3)
    opened.click("#own-weights")
    assert int(opened.rows()[0][opened.column("setup")]) == whole.setups[whole.ranking()[0]]
    assert opened.do("document.getElementById('reweighed').hidden")
    assert float(opened.rows()[0][opened.column("objective")].split()[0]) == pytest.approx(
        whole.objective[whole.ranking()[0]], rel=1e-3
    )


@pytest.mark.slow
def test_a_range_on_an_axis_of_the_parallel_coordinates_filters_the_setups(opened, whole):
    opened.do("document.querySelector('#parallel details').open = true")
    opened.do("document.getElementById('parallel').scrollIntoView()")
    frame = json.loads(opened.do("JSON.stringify(document.querySelector('#parallel .panel').getBoundingClientRect())"))
    middle, low = frame["y"] + 58 + 0.5 * (frame["height"] - 80), frame["y"] + frame["height"] - 22
    opened.browser.drag((frame["x"] + 60, middle), (frame["x"] + 60, low + 5))
    objective = whole.objective
    span = np.nanmin(objective) + 0.5 * np.ptp(objective[np.isfinite(objective)])
    assert opened.shown() == pytest.approx(np.sum(objective <= span), abs=0.02 * len(whole))
    opened.click("#unbrush")
    assert opened.shown() == len(whole)


@pytest.mark.slow
def test_every_build_of_a_bank_of_three_has_its_filter(light):
    assert light.do("document.querySelectorAll('#builds input').length") == 12
    names = light.do("[...document.querySelectorAll('#builds .corner')].map((c) => c.innerText).join()")
    assert names.count("C/C") == 4
