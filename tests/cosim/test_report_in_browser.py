"""The report page in a browser: it draws, answers to clicks, loads nothing, and complains of nothing."""

import json
import os
import shutil
import subprocess
import sys
import time

import numpy as np
import pytest

from cosim import Result, Scenario, System
from cosim.report import write_report
from eightpost.signals import TimeSeries

# Chromium reads commands from descriptor 3 and answers on 4, so that no port and no package is needed.
_LAUNCH = (
    "import fcntl, os, sys\n"
    "ends = [fcntl.fcntl(int(n), fcntl.F_DUPFD, 10) for n in sys.argv[1:3]]\n"
    "os.dup2(ends[0], 3), os.dup2(ends[1], 4), os.execv(sys.argv[3], sys.argv[3:])"
)
_NAMES = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
            "--remote-debugging-pipe", "--window-size=1440,900")  # fmt: skip
_PATIENCE = 30.0


class _Browser:
    """A page in headless Chromium, by the DevTools protocol over a pipe."""

    def __init__(self, program, profile):
        commands, self._to = os.pipe()
        self._from, answers = os.pipe()
        command = [sys.executable, "-c", _LAUNCH, str(commands), str(answers), program, *_OPTIONS]
        self._process = subprocess.Popen(
            [*command, f"--user-data-dir={profile}", "about:blank"],
            pass_fds=(commands, answers), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        os.close(commands)
        os.close(answers)
        self._count, self._unread, self._session, self.events = 0, b"", None, []
        pages = [t for t in self.call("Target.getTargets")["targetInfos"] if t["type"] == "page"]
        self._session = self.call("Target.attachToTarget", targetId=pages[0]["targetId"], flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method, **parameters):
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while (answer := self._message()).get("id") != self._count:
            self.events.append(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _message(self):
        while b"\0" not in self._unread:
            content = os.read(self._from, 1 << 20)
            assert content, "the browser ended"
            self._unread += content
        message, _, self._unread = self._unread.partition(b"\0")
        return json.loads(message)

    def evaluate(self, code):
        found = self.call("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def until(self, code):
        end = time.monotonic() + _PATIENCE
        while not self.evaluate(f"Boolean({code})"):
            assert time.monotonic() < end, f"still not true: {code}"
            time.sleep(0.02)

    def drag(self, start, end):
        for kind, (x, y), buttons in (("mousePressed", start, 1), ("mouseMoved", end, 1), ("mouseReleased", end, 0)):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1)

    def close(self):
        self._session = None
        self.call("Browser.close")
        self._process.wait(_PATIENCE)
        os.close(self._to)
        os.close(self._from)


@pytest.fixture
def browser(tmp_path):
    """Headless Chromium, ended with the test."""
    program = next(filter(None, map(shutil.which, _NAMES)), None)
    if program is None or sys.platform == "win32":
        pytest.skip(f"needs {' or '.join(_NAMES)} on the PATH, and a system with inherited file descriptors")
    opened = _Browser(program, tmp_path / "profile")
    yield opened
    opened.close()


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
def test_the_page_draws_answers_to_clicks_and_loads_nothing(browser, page, series):
    browser.call("Page.navigate", url=page.as_uri())
    browser.until("document.querySelector('#signals')")
    browser.evaluate("document.querySelector('#signals').scrollIntoView()")  # plots are drawn when they come near
    browser.until("document.querySelectorAll('.js-plotly-plot').length === 4")
    assert browser.evaluate("document.getElementById('trouble').hidden")
    assert browser.evaluate("document.documentElement.scrollWidth <= window.innerWidth")

    # What is drawn is what was recorded, in in/s at first.
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
    assert browser.evaluate(f"{_FIRST}.layout.annotations[0].text") == "no channel is chosen"
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
    assert shown < 2000  # as many as the screen can show
    peak = browser.evaluate(f"Math.max(...{_FIRST}.data[0].y)")
    assert peak == pytest.approx(series.values[0].max(), abs=1e-4)

    # The browser asked for this file alone and has nothing to complain of.
    asked = [e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"]
    assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [page.as_uri()]
    trouble = ("Runtime.exceptionThrown", "Runtime.consoleAPICalled", "Log.entryAdded")
    assert [event for event in browser.events if event["method"] in trouble] == []
