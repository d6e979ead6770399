"""`eightpost report` writes a page of the examples; its exit codes are those of the other verbs."""

import json
import os
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

from eightpost.__main__ import main
from eightpost.ident.dyno_report.builds import Reading, dyno_report, read_entries
from eightpost.ident.dyno_report.cycles import crossings_of
from eightpost.ident.dyno_report.entry import entry_of_test
from eightpost.ident.dyno_report.page import explained, sections_of
from eightpost.rig import DynoTest
from eightpost.signals import TimeSeries

ROOT = Path(__file__).parents[3]
DATA, BANK = ROOT / "examples" / "data", sorted((ROOT / "examples" / "bank").glob("*.json"))
RECORDS = [DATA / f"dyno_{build}.csv" for build in "ABC"]


def eightpost(*words):
    return CliRunner().invoke(main, ["report", *(str(word) for word in words)])


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """The page of the examples: three records, and a bank of seven laws."""
    page = tmp_path_factory.mktemp("report") / "report.html"
    corners = [word for pair in ("lf=B_C", "rf=B_C", "lr=dyno_A", "rr=dyno_A") for word in ("--corner", pair)]
    done = eightpost(*RECORDS, *BANK, "-o", page, "--car", ROOT / "examples" / "car.toml", *corners)
    assert done.exit_code == 0, done.output
    return page


def test_the_report_of_the_examples_has_every_section(examples):
    html = examples.read_text(encoding="utf-8")
    found = re.findall(r'<section id="([\w-]+)">', html)
    assert found == ["curves", "differences", "branches", "knees", "damping", "runs", "notes", "words"]
    for name in ("dyno_A", "AA_AA", "C_C"):
        assert f">{name}</td>" in html
    assert not re.search("https?://", re.sub(r"<script.*?</script>", "", html, flags=re.DOTALL))


def test_columns_without_values_are_left_out_and_tables_without_rows_too():
    (table,) = explained("", ("a", "b [N]"), [("x", None), ("y", None)])
    assert [head for head, _ in table.heads] == ["a"]
    assert explained("", ("a",), []) == []
    (table,) = explained("", ("a", "basis"), [("x", "measured"), ("y", "measured")])
    assert [head for head, _ in table.heads] == ["a"]


def test_a_page_of_one_shock_without_records_is_complete(tmp_path):
    done = eightpost(BANK[0], "-o", tmp_path / "one.html", "--corner-mass", "306 kg", "--wheel-rate", "40 N/mm")
    assert done.exit_code == 0, done.output
    html = (tmp_path / "one.html").read_text(encoding="utf-8")
    assert "Damping ratio c r²" in html
    assert 'id="branches"' not in html and 'id="differences"' not in html


@pytest.mark.nightly
def test_a_record_that_is_not_usable_exits_1_and_the_page_is_written(tmp_path):
    lines = (DATA / "dyno_A.csv").read_text(encoding="utf-8").splitlines()
    cells = [line.split(",") for line in lines[4:]]
    rows = [",".join([*row[:3], str(abs(float(row[3]))), *row[4:]]) for row in cells]
    (tmp_path / "rectified.csv").write_text("\n".join([*lines[:4], *rows]) + "\n")
    done = eightpost(tmp_path / "rectified.csv", "-o", tmp_path / "out.html")
    assert done.exit_code == 1, done.output
    assert "Not usable" in done.output
    assert 'class="verdict not-usable"' in (tmp_path / "out.html").read_text(encoding="utf-8")


#: Page that was there before.
OLD = "<html>old</html>"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("none.csv",), "none.csv"),
        (("{bank}", "-o", "page.pdf"), "a page ends in .html or .htm; write -o page.html"),
        (("{bank}", "--tolerance", "5 %"), "add --limits FILE"),
        (("{data}", "--set", "cycle=first"), "--set cycle=first: write last, mean, or the number"),
        (("{data}", "--limits", "{bank}", "--set", "tolerance=5"), "tolerance '5' has no unit; write it as '5 %' or"),
        (("{bank}", "--car", "{car}", "--set", "corner-mass=300 kg"), "omit corner-mass and wheel-rate"),
        (("{bank}", "--speed", "5 in"), "--speed"),
        (("{data}", "--flip", "force"), "positive"),
    ],
)
def test_wrong_input_exits_2_with_a_message_and_keeps_the_old_page(tmp_path, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "report.html").write_text(OLD)
    places = {"bank": BANK[0], "data": RECORDS[0], "car": ROOT / "examples" / "car.toml"}
    done = eightpost(*(word.format(**places) for word in words))
    assert done.exit_code == 2, done.output
    assert message in " ".join(done.output.split())
    assert "Traceback" not in done.output
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("report.html", OLD)]


def test_an_interrupted_report_keeps_the_old_page(tmp_path, monkeypatch):
    page = tmp_path / "report.html"
    page.write_text(OLD)
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    assert eightpost(BANK[0], "-o", page).exit_code != 0
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("report.html", OLD)]


def test_names_are_escaped(tmp_path):
    page = tmp_path / "page.html"
    done = eightpost(BANK[0], "-o", page, "--build", f"{BANK[0].name}=</script><b>x", "--title", "a < b")
    assert done.exit_code == 0, done.output
    html = page.read_text(encoding="utf-8")
    assert "<b>x" not in html and "a &lt; b" in html


MOTIONS = {
    "noise": lambda random, time: 0.01 * random.normal(size=time.size),
    "walk": lambda random, time: 0.001 * np.cumsum(random.normal(size=time.size)),
    "one way": lambda _random, time: 0.01 * time + 1e-5 * time**2,
    "steps": lambda random, time: np.repeat(0.01 * random.normal(size=time.size // 100 + 1), 100)[: time.size],
    "triangle": lambda _random, time: 0.02 * np.arcsin(np.sin(2.0 * np.pi * time)),
}


@pytest.mark.nightly
@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6), st.sampled_from(sorted(MOTIONS)), st.booleans(), st.integers(200, 2000))
def test_every_motion_has_a_page_whose_figures_are_finite_or_unknown(seed, motion, has_displacement, count):
    random, time = np.random.default_rng(seed), np.arange(count) / 500.0
    path = MOTIONS[motion](random, time)
    velocity = np.gradient(path, time)
    channels = {"velocity": ("m/s", velocity), "force": ("N", 2e3 * velocity + random.normal(size=count))}
    channels |= {"displacement": ("m", path)} if has_displacement else {}
    entry = entry_of_test(DynoTest(TimeSeries.from_channels(time, channels)), "run", "A")
    assert not re.search(r"\b(nan|inf)\b", "".join(map(str, sections_of(dyno_report([entry])))))


def test_the_energy_of_a_measured_cycle_is_the_area_of_its_loop():
    """The polygon of force over measured displacement is independent of the derived velocity."""
    folder = os.environ.get("EIGHTPOST_DATA")
    if not folder:
        pytest.skip("needs measured records: set EIGHTPOST_DATA to their folder")
    path = Path(folder) / "ohlins" / "ohlins_t1_1_1_18_18_s5_n10_150psi.csv"
    (entry,) = read_entries([path], Reading(flip={"": ("force",)}))
    series = entry.test.series
    starts = [one.time for one in crossings_of(series) if one.upward]
    areas = []
    for a, b in pairwise(starts[2:9]):
        loop = series.window(a, b)
        x, f = loop["displacement"], loop["force"]
        areas.append(0.5 * float(np.sum(f * (np.roll(x, -1) - np.roll(x, 1)))))
    assert entry.cycles.energy == pytest.approx(np.mean(areas), rel=0.01)


@pytest.mark.slow
def test_the_page_is_readable_on_a_screen_a_phone_and_paper(browser, examples):
    def open_page(width, mobile):
        browser.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=mobile)
        browser.call("Page.navigate", url=examples.as_uri())
        browser.until("document.body && document.body.dataset.drawn === 'all'")

    plots = "[...document.querySelectorAll('.js-plotly-plot')]"
    for width, mobile in ((400, True), (1400, False)):
        open_page(width, mobile)
        assert browser.evaluate("document.getElementById('trouble').hidden")
        assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        assert browser.evaluate(f"{plots}.length") == 3
        widest = browser.evaluate(f"Math.max(...{plots}.map((p) => p.layout.width))")
        assert widest <= width
    # Letter and A4 in landscape with margins of 7 mm
    browser.call("Emulation.setEmulatedMedia", media="print")
    for paper in (279.4, 297.0):
        width = int((paper - 14.0) / 25.4 * 96)
        browser.call("Emulation.setDeviceMetricsOverride", width=width, height=700, deviceScaleFactor=1, mobile=False)
        wide = "[...document.querySelectorAll('table, .plot svg.main-svg')].map((e) => e.getBoundingClientRect().right)"
        assert browser.evaluate(f"Math.max(...{wide})") <= width + 1
    cut = "[...document.querySelectorAll('tr')].filter((row) => getComputedStyle(row).breakInside !== 'avoid').length"
    assert browser.evaluate(cut) == 0
    browser.call("Emulation.setEmulatedMedia", media="")
    trouble = ("Runtime.exceptionThrown", "Log.entryAdded")
    assert [event for event in browser.events if event["method"] in trouble] == []


@pytest.mark.slow
def test_a_table_is_copied_with_tabs_in_the_units_that_are_shown(browser, examples):
    browser.call("Emulation.setDeviceMetricsOverride", width=1400, height=900, deviceScaleFactor=1, mobile=False)
    browser.call("Page.navigate", url=examples.as_uri())
    browser.until("document.body && document.body.dataset.drawn === 'all'")
    browser.evaluate("navigator.clipboard.writeText = async (text) => { window.copiedText = text; }")
    copied = {}
    for units in ("us", "si"):
        browser.evaluate(f"document.querySelector('input[value={units}]').click()")
        browser.evaluate("delete window.copiedText; document.querySelector('#knees button.copy').click()")
        browser.until("window.copiedText")
        copied[units] = json.loads(browser.evaluate("JSON.stringify(window.copiedText)")).splitlines()
    for units, unit in (("us", "in/s"), ("si", "m/s")):
        head, first, *_ = (line.split("\t") for line in copied[units])
        assert head[3] == f"knee at [{unit}]"
        assert len(first) == len(head)
    knees = [float(copied[units][1].split("\t")[3]) for units in ("us", "si")]
    assert knees[0] == pytest.approx(knees[1] / 0.0254, rel=0.01)
