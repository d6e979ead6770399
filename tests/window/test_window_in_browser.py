"""The window in a real browser: drop a record, see its loop and the verdict, save the FMU, couple it, lose nothing."""

import json
import re
import shutil
import subprocess
import time
import urllib.request
from importlib.resources import files
from pathlib import Path
from urllib.error import HTTPError

import fmpy
import pytest

from eightpost.workers.process import python_command

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    """A running window: its folder and its link."""
    folder = tmp_path_factory.mktemp("work")
    shutil.copy(EXAMPLES / "car.toml", folder)
    command = python_command("eightpost", "app", str(folder), "--set", "browser=no")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    link = re.search(r"http\S+", process.stdout.readline())[0]
    yield folder, link
    process.terminate()
    process.communicate(timeout=20)


@pytest.fixture
def page(browser, window):
    """The window in a browser that has just been opened."""
    browser.call("Emulation.setDeviceMetricsOverride", width=1400, height=1000, deviceScaleFactor=1, mobile=False)
    browser.call("Page.navigate", url=window[1])
    browser.until("document.querySelectorAll('.q-tab').length == 4")
    return _Page(browser)


class _Page:
    def __init__(self, browser):
        self.browser, self.until, self.evaluate = browser, browser.until, browser.evaluate

    def press(self, found):
        self.until(found)
        self.evaluate(f"({found}).scrollIntoView({{block: 'center'}})")
        box = f"(({found}).getBoundingClientRect())"
        x, y = self.evaluate(f"[{box}.x + {box}.width / 2, {box}.y + {box}.height / 2]")
        for kind in ("mousePressed", "mouseReleased"):
            self.browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def click(self, found):
        self.until(found)
        self.evaluate(f"({found}).click()")

    def screen(self, name):
        self.click(_with_text(".q-tab", name))

    def button(self, name):
        self.click(_with_text(".content button", name))

    def choose(self, label, option):
        self.press(f"[...document.querySelectorAll('.q-field')].find(e => e.innerText.startsWith({label!r}))")
        self.press(_with_text(".q-menu .q-item", option))

    def write(self, label, value):
        field = f"document.querySelector('input[aria-label={json.dumps(label)}]')"
        self.until(field)
        self.evaluate(f"(e => {{ e.value = {value}; e.dispatchEvent(new Event('input')) }})({field})")

    def drop(self, kind, *paths):
        area = f"[data-kind={kind}] input[type=file]"
        self.until(f"document.querySelector({area!r})")
        root = self.browser.call("DOM.getDocument")["root"]["nodeId"]
        node = self.browser.call("DOM.querySelector", nodeId=root, selector=area)["nodeId"]
        self.browser.call("DOM.setFileInputFiles", files=[str(path) for path in paths], nodeId=node)


def _with_text(selector, text):
    return f"[...document.querySelectorAll({selector!r})].find(e => e.innerText.trim() == {text!r})"


def test_a_dropped_record_becomes_a_loop_a_verdict_and_an_fmu_that_fmpy_simulates(page, window):
    folder, _ = window
    page.drop("dyno", EXAMPLES / "data" / "dyno_A.csv")
    page.until("document.querySelector('.figure .main-svg .scatterlayer path')")
    page.choose("Law", "LPF1")
    page.button("Fit")
    page.until("document.querySelector('.verdict')?.innerText == 'usable'")
    page.button("Save FMU")
    page.until("[...document.querySelectorAll('a.product')].some(e => e.innerText == 'FMU')")
    result = fmpy.simulate_fmu(folder / "fmus" / "dyno_A.fmu", stop_time=0.1, start_values={"velocity": 0.2})
    assert 500.0 < result["force"][-1] < 3000.0
    assert (folder / "shocks" / "dyno_A.json").is_file()


def test_a_record_with_the_wrong_sign_is_readable_after_one_click(page, tmp_path):
    lines = (EXAMPLES / "data" / "dyno_B.csv").read_text().splitlines()
    head = next(k for k, line in enumerate(lines) if "force" in line.lower())
    column = [name.split(" ")[0].split("[")[0].lower() for name in lines[head].split(",")].index("force")
    rows = [line.split(",") for line in lines[head + 1 :]]
    flipped = [",".join([*row[:column], str(-float(row[column])), *row[column + 1 :]]) for row in rows]
    (tmp_path / "other_sign.csv").write_text("\n".join([*lines[: head + 1], *flipped]))
    page.drop("dyno", tmp_path / "other_sign.csv")
    page.until("document.querySelector('.error')?.innerText.includes('wrong sign')")
    page.button("Reverse the force")
    page.until("!document.querySelector('.error') && document.querySelector('.figure .main-svg')")


def test_a_run_that_is_left_by_the_browser_is_there_when_it_is_opened_again(page, window):
    folder, link = window
    page.screen("Run")
    page.drop("tracks", EXAMPLES / "data" / "track.parquet")
    page.until("[...document.querySelectorAll('.q-field')].some(e => /^Drive file\\s+track.parquet/.test(e.innerText))")
    page.write("Length [s]", 1)
    page.button("Run")
    page.until("[...document.querySelectorAll('.job')].some(e => e.innerText.includes('running'))")
    page.browser.call("Page.navigate", url="about:blank")
    end = time.monotonic() + 200.0
    while not (folder / "runs" / "run" / "report.html").is_file():
        assert time.monotonic() < end
        time.sleep(0.5)
    page.browser.call("Page.navigate", url=link)
    page.until("document.querySelector('.verdict') && document.querySelector('.figure .main-svg')")
    rows = page.evaluate("[...document.querySelectorAll('tbody tr')].map(e => e.innerText)")
    assert any("car.lf.velocity" in row for row in rows)


@pytest.mark.repeated("Study-390")
@pytest.mark.parametrize("width", [1400, 390])
@pytest.mark.parametrize("name", ["Dyno", "Car", "Run", "Study"])
def test_axe_finds_nothing_serious(page, name, width):
    page.browser.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
    page.screen(name)
    page.until(f"document.querySelector('.q-tab--active').innerText.trim() == {name!r}")
    time.sleep(1.0)  # the change of screens is animated
    page.evaluate((files("axe_core_python") / "axe.min.js").read_text(encoding="utf-8"))
    found = json.loads(page.evaluate("axe.run().then(({ violations }) => JSON.stringify(violations))"))
    serious = [(v["id"], v["nodes"][0]["html"]) for v in found if v["impact"] in ("serious", "critical")]
    assert serious == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth + 1")


def test_another_client_of_this_machine_gets_nothing(window):
    address = window[1].partition("?")[0]
    for request in (address, f"{address}file/car.toml", f"{address}?token=guess"):
        with pytest.raises(HTTPError, match="403"):
            urllib.request.urlopen(request)
