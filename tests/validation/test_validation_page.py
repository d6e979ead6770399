"""The report in a browser and in print: it draws every figure, changes units, loads nothing and logs no errors."""

import base64
import json
import re

import numpy as np
import pytest

from eightpost.ident.validation.dyno_record import dyno_record
from eightpost.ident.validation.shock_page import write_shock_page
from eightpost.ident.validation.shocks import validate_shocks

from .conftest import INCH, POUND, shock_of


@pytest.fixture(scope="module")
def study(lagged, static_curve, random_test, sine_test, static_test, bump_test):
    records = [dyno_record(random_test(1), name="random", configuration=1), dyno_record(bump_test, name="bump")]
    records += [dyno_record(sine_test(a, v), name=f"sine {a} {v}") for a, v in ((0.5, 5.0), (0.25, 10.0), (0.1, 5.0))]
    records += [dyno_record(static_test, name=name) for name in ("static", "again")]
    return validate_shocks([static_curve, lagged], records)


_PLOTS = "[...document.querySelectorAll('.js-plotly-plot')]"


@pytest.mark.slow
def test_the_page_draws_all_its_figures_in_both_unit_systems_and_loads_nothing(browser, study, tmp_path):
    path = write_shock_page(tmp_path / "report.html", study, limit=10.0)
    browser.call("Page.navigate", url=path.as_uri())
    browser.until("document.body && document.body.dataset.drawn === 'all'")
    assert browser.evaluate("document.getElementById('trouble').hidden")
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    # random 1, sines 4 (map, over frequency, two of loops), static 2 and their overlay, bump 1
    assert browser.evaluate(f"{_PLOTS}.length") == 9
    assert browser.evaluate(f"{_PLOTS}.every((p) => p.querySelectorAll('.trace').length === p.data.length)")

    loops = "document.querySelector('#sine').querySelectorAll('.plot')[2]"
    x = json.loads(browser.evaluate(f"JSON.stringify({loops}.data[0].x)"))
    case = next(case for case in study.cases if case.record.name == "sine 0.5 5.0")
    assert max(x) == pytest.approx(case.outcome.measured.velocity.max() / INCH, rel=0.01)
    bubbles = "document.querySelector('#sine .plot').data[0].text"
    errors = [c.outcome.rms for c in study.cases if c.record.kind == "sine" and c.shock.law_name == "polylinear"]
    np.testing.assert_allclose(
        [float(text) for text in json.loads(browser.evaluate(f"JSON.stringify({bubbles})"))],
        np.array(errors) / POUND,
        rtol=0.01,
    )
    assert browser.evaluate(f"{loops}.layout.yaxis.title.text") == "force [lbf]"
    browser.evaluate("document.querySelector('input[value=si]').click()")
    assert browser.evaluate(f"{loops}.layout.yaxis.title.text") == "force [N]"
    assert "lbf" not in browser.evaluate("document.querySelector('#random table').innerText")

    pdf = base64.b64decode(browser.call("Page.printToPDF", preferCSSPageSize=True)["data"])
    assert 5 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 20

    requested = [e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"]
    assert [url for url in requested if not url.startswith(("data:", "blob:"))] == [path.as_uri()]
    trouble = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
    assert [event for event in browser.events if event["method"] in trouble] == []


@pytest.mark.slow
def test_on_paper_nothing_is_wider_than_the_page(browser, study, tmp_path):
    path = write_shock_page(tmp_path / "report.html", study)
    browser.call("Page.navigate", url=path.as_uri())
    browser.until("document.body && document.body.dataset.drawn === 'all'")
    browser.call("Emulation.setEmulatedMedia", media="print")
    # A4 landscape within 12 mm margins, at 96 pixels to the inch
    width = int((297 - 24) / 25.4 * 96)
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=700, deviceScaleFactor=1, mobile=False)
    wide = "[...document.querySelectorAll('table, .plot svg.main-svg')].map((e) => e.getBoundingClientRect().right)"
    assert browser.evaluate(f"Math.max(...{wide})") <= width + 1
    assert browser.evaluate("getComputedStyle(document.querySelector('nav')).display") == "none"


def test_names_are_escaped_and_the_verdict_says_what_is_wrong(truth, random_test, tmp_path):
    named = validate_shocks([shock_of(truth, name="<b>x")], [dyno_record(random_test(1), name="</script><i>")])
    html = write_shock_page(tmp_path / "page.html", named, limit=0.0001, title="a < b").read_text(encoding="utf-8")
    assert "<b>x" not in html
    assert "</script><i>" not in html
    assert 'class="verdict not-usable"' in html
    assert "limit 0.0001 %" in html
    assert "No record of this validation does" in html


def test_a_good_validation_has_a_good_verdict(lagged, random_test, tmp_path):
    study = validate_shocks([lagged], [dyno_record(random_test(1))])
    for limit in (1.0, None):
        html = write_shock_page(tmp_path / "page.html", study, limit=limit).read_text(encoding="utf-8")
        assert 'class="verdict usable"' in html
        assert f"limit{'s 10 and 30' if limit is None else ' 1'} %" in html
