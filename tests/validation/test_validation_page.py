"""The report in a browser and in print: it draws every figure, changes units, loads nothing and logs no errors."""

import base64
import json
import re
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from eightpost.__main__ import main
from eightpost.ident.validation.records import dyno_record
from eightpost.ident.validation.shock_page import _over_frequency, write_shock_page
from eightpost.ident.validation.shocks import validate_shocks
from eightpost.shock import write_shock
from eightpost.signals import write_csv
from tests.drawn import figures_of, rows_of_page

from .conftest import INCH, shock_of


@pytest.fixture(scope="module")
def study(lagged, static_curve, random_test, sine_test, static_test, bump_test):
    records = [dyno_record(random_test(1), name="random"), dyno_record(bump_test, name="bump")]
    records += [dyno_record(sine_test(a, v), name=f"sine {a} {v}") for a, v in ((0.5, 5.0), (0.25, 10.0), (0.1, 5.0))]
    records += [dyno_record(static_test, name=name) for name in ("static", "again")]
    return validate_shocks([static_curve, lagged], records)


def test_the_page_and_its_figures(study, tmp_path, unchanged):
    path = write_shock_page(tmp_path / "report.html", study, limit=10.0)
    unchanged(rows_of_page(path), "text", relative=1e-3)
    unchanged(figures_of(path), "figures", relative=1e-3)


_PLOTS = "[...document.querySelectorAll('.js-plotly-plot')]"


@pytest.mark.slow
def test_the_page_draws_all_its_figures_in_both_unit_systems_loads_nothing_and_fits_on_paper(browser, study, tmp_path):
    path = write_shock_page(tmp_path / "report.html", study, limit=10.0)
    browser.call("Page.navigate", url=path.as_uri())
    browser.until("document.body && document.body.dataset.drawn === 'all'")
    assert browser.evaluate("document.getElementById('trouble').hidden")
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    browser.evaluate("document.querySelectorAll('details').forEach((folded) => { folded.open = true; })")
    browser.until(f"{_PLOTS}.length === document.querySelectorAll('.plot').length")
    # random 1, sines 2 (loops; each amplitude has one frequency), static 2 and their overlay, bump 1
    assert browser.evaluate(f"{_PLOTS}.length") == 7
    assert browser.evaluate(f"{_PLOTS}.every((p) => p.querySelectorAll('.trace').length === p.data.length)")

    loops = "document.querySelector('#sine').querySelectorAll('.plot')[0]"
    x = json.loads(browser.evaluate(f"JSON.stringify({loops}.data[0].x)"))
    case = next(case for case in study.cases if case.record.name == "sine 0.5 5.0")
    assert max(x) == pytest.approx(case.outcome.measured.velocity.max() / INCH, rel=0.01)
    assert browser.evaluate(f"{loops}.layout.yaxis.title.text") == "force [lbf]"
    browser.evaluate("document.querySelector('input[value=si]').click()")
    assert browser.evaluate(f"{loops}.layout.yaxis.title.text") == "force [N]"
    assert "lbf" not in browser.evaluate("document.querySelector('#random table').innerText")

    pdf = base64.b64decode(browser.call("Page.printToPDF", preferCSSPageSize=True)["data"])
    assert 5 <= len(re.findall(rb"/Type\s*/Page\b", pdf)) <= 20

    browser.call("Emulation.setEmulatedMedia", media="print")
    # A4 landscape within 12 mm margins, at 96 pixels to the inch
    width = int((297 - 24) / 25.4 * 96)
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=700, deviceScaleFactor=1, mobile=False)
    wide = "[...document.querySelectorAll('table, .plot svg.main-svg')].map((e) => e.getBoundingClientRect().right)"
    assert browser.evaluate(f"Math.max(...{wide})") <= width + 1
    assert browser.evaluate("getComputedStyle(document.querySelector('nav')).display") == "none"

    requested = [e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"]
    assert [url for url in requested if not url.startswith(("data:", "blob:"))] == [path.as_uri()]
    trouble = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
    assert [event for event in browser.events if event["method"] in trouble] == []


def traces(figure):
    """Return the panel, x, y and the name of each trace of a figure."""
    return [(trace["xaxis"], list(trace["x"]), list(trace["y"]), trace["name"]) for trace in figure._traces]


def sines(*motions):
    """Return stand-ins for cases of two shocks on sines, given amplitudes [m], speeds [m/s] and errors [N]."""
    return [
        tuple(
            SimpleNamespace(
                label=label,
                shock=SimpleNamespace(law_name=label),
                sine=SimpleNamespace(amplitude=amplitude, speed=speed, frequency=speed / (2.0 * np.pi * amplitude)),
                outcome=SimpleNamespace(rms=error),
            )
            for label, error in zip(("polylinear", "lpf1"), errors, strict=True)
        )
        for amplitude, speed, errors in motions
    ]


def test_the_errors_over_frequency_have_a_panel_for_each_amplitude_the_largest_first():
    """Amplitudes of 20 and 19 mm are one, because the actuator does not follow its command exactly."""
    rows = sines((0.01, 0.2, (3.0, 4.0)), (0.019, 0.4, (5.0, 6.0)), (0.02, 0.1, (1.0, 2.0)))
    figure = _over_frequency(rows)
    assert [panel.title for panel in figure.panels] == ["0.79 in (20 mm)", "0.39 in (10 mm)"]
    low, high = 0.1 / (2.0 * np.pi * 0.02), 0.4 / (2.0 * np.pi * 0.019)
    found = [(panel, x, y) for panel, x, y, _ in traces(figure)]
    assert [(panel, y) for panel, _, y in found] == [("x", [1.0, 5.0]), ("x", [2.0, 6.0]), ("x2", [3.0]), ("x2", [4.0])]
    assert found[0][1] == pytest.approx([low, high], rel=1e-3)


def test_names_are_escaped_and_the_verdict_says_what_is_wrong(truth, random_test, tmp_path):
    named = validate_shocks([shock_of(truth, name="<b>x")], [dyno_record(random_test(1), name="</script><i>")])
    html = write_shock_page(tmp_path / "page.html", named, limit=0.0001, title="a < b").read_text(encoding="utf-8")
    assert "<b>x" not in html
    assert "</script><i>" not in html
    assert 'class="verdict not-usable"' in html
    assert "limit 0.0001 %" in html


def test_a_good_validation_has_a_good_verdict(lagged, random_test, tmp_path):
    study = validate_shocks([lagged], [dyno_record(random_test(1))])
    for limit in (1.0, None):
        html = write_shock_page(tmp_path / "page.html", study, limit=limit).read_text(encoding="utf-8")
        assert 'class="verdict usable"' in html
        assert f"limit{'s 5 and 15' if limit is None else ' 1'} %" in html


@pytest.fixture(scope="module")
def written(tmp_path_factory, lagged, static_curve, random_test, bump_test, sine_test):
    place = tmp_path_factory.mktemp("written")
    (place / "data").mkdir()
    write_shock(lagged, place / "lpf1.json")
    write_shock(static_curve, place / "static.json")
    for name, test in {"random": random_test(1), "bump": bump_test, "sine": sine_test(0.25, 10.0)}.items():
        write_csv(test.series, place / "data" / f"{name}.csv")
    return place


@pytest.fixture
def folder(written, tmp_path):
    return shutil.copytree(written, tmp_path / "here")


@pytest.fixture
def run(folder, monkeypatch):
    monkeypatch.chdir(folder)
    return lambda *words: CliRunner().invoke(main, ["validate", *words], env={"COLUMNS": "180"})


@pytest.mark.slow
def test_a_folder_of_records_and_two_laws_give_tables_and_a_page(run, folder):
    done = run("lpf1.json", "static.json", "data", "--limit", "30", "-o", "out/page.html", "-v")
    assert done.exit_code == 0, done.output
    for text in ("random: random", "bump: bump", "sine: sine", "Random records", "Sines of known", "Bump records"):
        assert text in done.output
    page = (folder / "out" / "page.html").read_text(encoding="utf-8")
    assert "known LPF1" in page
    assert "@media print" in page


@pytest.mark.nightly
def test_an_error_over_the_limit_exits_1_and_is_named(run):
    done = run("static.json", "data/random.csv", "--limit", "1")
    assert done.exit_code == 1
    assert done.output.count("Not usable: ") == 1
    assert "limit 1 %" in done.output
    assert run("lpf1.json", "data/random.csv", "--limit", "1").exit_code == 0


@pytest.mark.repeated(2)
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("data",), "no shock file"),
        (("lpf1.json",), "no record"),
        (("none.json", "data"), "none.json"),
        (("lpf1.json", "none.csv"), "none.csv"),
        (("lpf1.json", "data", "--kind", "fast"), "fast"),
        (("lpf1.json", "data", "--kind", "run9=sine"), "run9"),
        (("lpf1.json", "data/random.csv", "--kind", "sine"), "no single frequency"),
        (("lpf1.json", "data", "--report", "page.pdf"), "page.html"),
        (("lpf1.json", "data", "--channel", "force=[]"), "there is no column '[]'"),
        (("lpf1.json", "data/random.csv", "--set", "segment=900 s, 901 s"), "is not within it"),
    ],
)
def test_wrong_input_exits_2_with_a_message_and_writes_nothing(run, folder, words, message):
    before = sorted(folder.rglob("*"))
    done = run(*words)
    assert done.exit_code == 2, done.output
    assert message in done.output
    assert sorted(folder.rglob("*")) == before
