"""A document of the report kit in a browser: light, dark, on a telephone and in print."""

import json
from importlib.resources import files

import numpy as np
import pytest

from eightpost.report.charts import COLORS, Axis, grid_figure
from eightpost.report.page import Section, document, write_page
from eightpost.report.tables import ResultTable
from eightpost.verdict import Verdict

_SERIOUS = ("serious", "critical")
_DRAWN = "document.querySelector('.plot')._fullLayout"
# What a print sees: the page's own listener has run when this one runs.
_LISTEN = f"addEventListener('beforeprint', () => {{ window.printed = [{_DRAWN}.paper_bgcolor, {_DRAWN}.width]; }})"


@pytest.fixture
def opened(browser, tmp_path):
    figure = grid_figure("curve", 300, [(Axis("velocity", "m/s"), Axis("force", "N"), "one")], 1, gap=(0.0, 0.0))
    figure.line(0, np.array([-1.0, 1.0]), np.array([-5.0, 9.0]), name="target", color=COLORS[0])
    row = tuple(float(k) for k in range(20))
    wide = ResultTable.of("wide", [f"long heading number {k}" for k in range(20)], [row])
    html = document("Curves", Verdict(), [Section("one", "One", ["text", figure, wide])], links={"x.html": "The study"})
    path = write_page(tmp_path / "page.html", html)

    def on(width, scheme, media="screen"):
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        browser.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
        browser.call("Emulation.setEmulatedMedia", media=media, features=features)
        browser.call("Page.navigate", url=path.as_uri())
        browser.until("document.body && document.body.dataset.drawn === 'all'")
        return browser

    yield on
    browser.call("Emulation.setEmulatedMedia", media="", features=[])


def _brightness(browser, code):
    red, green, blue = json.loads(browser.evaluate(f"JSON.stringify({code}.match(/[0-9]+/g).slice(0, 3).map(Number))"))
    return (red + green + blue) / (3.0 * 255.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("width", "scheme"),
    [
        (400, "dark"),
        pytest.param(1400, "light", marks=pytest.mark.nightly),
        pytest.param(1400, "dark", marks=pytest.mark.nightly),
        pytest.param(400, "light", marks=pytest.mark.nightly),
    ],
)
def test_axe_has_no_serious_finding_and_nothing_is_wider_than_the_screen(opened, width, scheme):
    shown = opened(width, scheme)
    shown.evaluate((files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8"))
    found = json.loads(shown.evaluate("axe.run().then(({ violations }) => JSON.stringify(violations))"))
    assert [(one["id"], one["nodes"][0]["html"]) for one in found if one["impact"] in _SERIOUS] == []
    assert shown.evaluate("document.documentElement.scrollWidth") <= width


@pytest.mark.slow
def test_page_and_plots_follow_the_colour_scheme_and_the_width_of_the_screen(opened):
    paper, ink = "getComputedStyle(document.body).backgroundColor", "getComputedStyle(document.body).color"
    for scheme, low, high in (("light", 0.9, 1.0), ("dark", 0.0, 0.15)):
        shown = opened(1400, scheme)
        assert low <= _brightness(shown, paper) <= high
        assert shown.evaluate(f"{_DRAWN}.paper_bgcolor") == {"light": "#fff", "dark": "#14181e"}[scheme]
        assert abs(_brightness(shown, paper) - _brightness(shown, ink)) > 0.6
        assert shown.evaluate("document.querySelector('.plot').data[0].line.color") in ("#0072b2", "#4aa3dc")
    assert shown.evaluate("document.querySelector('.plot').data[0].line.color") == "#4aa3dc"
    assert shown.evaluate(f"{_DRAWN}.width") > 600
    shown.call("Emulation.setDeviceMetricsOverride", width=400, height=900, deviceScaleFactor=1, mobile=False)
    shown.until(f"{_DRAWN}.width < 400")


@pytest.mark.slow
def test_a_dark_telephone_prints_light_and_as_wide_as_the_paper(opened):
    shown = opened(400, "dark", media="")
    assert shown.evaluate(f"{_DRAWN}.width") < 400
    shown.evaluate(_LISTEN)
    shown.call("Page.printToPDF", printBackground=True, preferCSSPageSize=True)
    assert json.loads(shown.evaluate("JSON.stringify(window.printed)")) == ["#fff", 1000]
    shown.until(f"{_DRAWN}.paper_bgcolor === '#14181e' && {_DRAWN}.width < 400")  # the screen is as before
