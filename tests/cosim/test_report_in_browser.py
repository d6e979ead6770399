"""The report page in a browser: it draws its plots, responds to clicks, loads nothing, and logs no errors."""

import json

import numpy as np
import pytest

from cosim import Result, Scenario, System
from cosim.report import write_report
from eightpost.signals import TimeSeries


@pytest.fixture
def series():
    time_, rng = np.arange(0.0, 20.001, 0.002), np.random.default_rng(2)
    channels = {f"car.{corner}.velocity": ("m/s", rng.standard_normal(time_.size)) for corner in ("lf", "rf")}
    return TimeSeries.from_channels(time_, channels | {'<b>"x"&.force': ("N", np.sin(9.0 * time_))})


@pytest.fixture
def page(make, series, tmp_path):
    result = Result(series=series, converged=True, notes=(), algorithm="gauss-seidel", order=("part",), step=1e-3,
                    steps=20000, seconds=0.1, equilibrium_sweeps=1, energy={}, held_direct=(),
                    identities={"part": "guid"}, settling=1.0,
                    stated_error=dict.fromkeys(series.names, 0.1))  # fmt: skip
    system = System({"part": make.gain()}, constants={"part.u": 1.0})
    return write_report(tmp_path / "report.html", result, system, Scenario(20.0, settling=1.0))


_PLOTS = "[...document.querySelectorAll('.js-plotly-plot')]"
_FIRST = "document.querySelector('.time-plot')"
_RANGES = "JSON.stringify([...document.querySelectorAll('.time-plot')].map((p) => p.layout.xaxis.range))"
_FIND = "{{ const box = document.getElementById('find'); box.value = '{}'; box.dispatchEvent(new Event('input')); }}"


def _ranges(browser):
    return json.loads(browser.evaluate(_RANGES))


@pytest.mark.slow
def test_the_page_draws_its_plots_responds_to_clicks_and_loads_nothing(browser, page, series):
    browser.call("Page.navigate", url=page.as_uri())
    browser.until("document.querySelector('#signals')")
    # Plots are drawn when they are scrolled near the view.
    browser.evaluate("document.querySelector('#signals').scrollIntoView()")
    browser.until("document.querySelectorAll('.js-plotly-plot').length === 4")
    assert browser.evaluate("document.getElementById('trouble').hidden")
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")

    # The plots show the recorded values, initially in in/s.
    x, y = json.loads(browser.evaluate(f"JSON.stringify([{_FIRST}.data[0].x, {_FIRST}.data[0].y])"))
    rows = np.searchsorted(series.time, np.array(x) - 1e-9)
    np.testing.assert_allclose(np.array(y) * 0.0254, series.values[0][rows], atol=1e-4)
    assert browser.evaluate(f"{_FIRST}.layout.yaxis.title.text") == "in/s"
    assert np.ptp(_ranges(browser)[0]) == pytest.approx(4.0)

    # Units: axes, spectra and tables.
    browser.evaluate("document.querySelector('input[value=si]').click()")
    assert browser.evaluate(f"{_PLOTS}.map((p) => p.layout.yaxis.title.text).join(' ')") == "m/s (m/s)²/Hz N N²/Hz"
    assert "in/s" not in browser.evaluate("document.getElementById('statistics').innerText")

    # Channels: one off, all off, all on.
    browser.evaluate("document.querySelector('.chips input').click()")
    assert browser.evaluate(f"{_PLOTS}.map((p) => p.data.length).join()") == "1,1,1,1"
    browser.evaluate("document.querySelector('[data-choose=\"0\"]').click()")
    assert browser.evaluate(f"{_FIRST}.layout.annotations[0].text") == "no channel is selected"
    browser.evaluate("document.querySelector('[data-choose]').click()")
    assert browser.evaluate(f"{_FIRST}.data.length") == 2
    browser.evaluate(_FIND.format("RF vel"))
    assert browser.evaluate("[...document.querySelectorAll('.panel')].map((p) => p.hidden).join()") == "false,true"
    assert browser.evaluate("document.querySelectorAll('#statistics tbody tr:not([hidden])').length") == 1
    browser.evaluate(_FIND.format(""))

    # Zoom: a drag over half of a trace zooms all of them; "all" undoes it.
    browser.evaluate(f"{_FIRST}.scrollIntoView({{block: 'center'}})")
    box = json.loads(browser.evaluate(f"JSON.stringify({_FIRST}.querySelector('.nsewdrag').getBoundingClientRect())"))
    middle = box["y"] + 0.5 * box["height"]
    browser.drag((box["x"] + 0.25 * box["width"], middle), (box["x"] + 0.75 * box["width"], middle))
    browser.until(f"{_FIRST}.layout.xaxis.range[1] - {_FIRST}.layout.xaxis.range[0] < 2.1")
    assert _ranges(browser)[0] == _ranges(browser)[1] == pytest.approx([9.0, 11.0], abs=0.05)
    browser.evaluate("document.querySelector('[data-span=all]').click()")
    assert _ranges(browser) == [[0, 20], [0, 20]]
    shown = browser.evaluate(f"{_FIRST}.data[0].y.length")
    assert shown < 2000  # limited to what the screen can show
    peak = browser.evaluate(f"Math.max(...{_FIRST}.data[0].y)")
    assert peak == pytest.approx(series.values[0].max(), abs=1e-4)

    # The browser requested this file only and logged no errors.
    requested = [e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"]
    assert [url for url in requested if not url.startswith(("data:", "blob:"))] == [page.as_uri()]
    errors = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
    assert [event for event in browser.events if event["method"] in errors] == []
