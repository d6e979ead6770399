"""The dyno report in a browser: it prints whole tables, and a phone shows it without scrolling sideways."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from eightpost.__main__ import main

ROOT = Path(__file__).parents[3]

#: Width of A4 landscape without margins, and of a phone [px].
PRINTED, PHONE = 1040, 390

_CUT = """(() => [...document.querySelectorAll('table')].filter((table) => {
  const box = table.getBoundingClientRect();
  let around = table.parentElement;
  while (around && getComputedStyle(around).overflowX === 'visible') around = around.parentElement;
  const frame = around && around !== document.documentElement ? around.getBoundingClientRect().right : innerWidth;
  return box.width > 0 && box.right > Math.min(frame, innerWidth) + 1;
}).length)()"""
_ROWS_CUT = """(() => [...document.querySelectorAll('tr')].filter(
  (row) => getComputedStyle(row).breakInside !== 'avoid').length)()"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    shocks = sorted((ROOT / "examples" / "bank").glob("*.json"))[:3]
    record = ROOT / "examples" / "data" / "dyno_B.csv"
    words = ["report", str(record), *map(str, shocks), "-o", str(path), "--car", str(ROOT / "examples" / "car.toml")]
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 0, done.output
    return path


def size(browser, width, *, media="", phone=False):
    browser.call("Emulation.setEmulatedMedia", media=media)
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=800, deviceScaleFactor=1, mobile=phone)


@pytest.mark.slow
def test_the_page_prints_whole_tables_and_fits_on_a_phone(browser, page):
    browser.call("Page.navigate", url=page.as_uri())
    browser.until("document.readyState === 'complete' && document.querySelectorAll('table').length > 5")

    size(browser, PRINTED, media="print")
    assert browser.evaluate("document.querySelectorAll('table').length") > 5
    assert browser.evaluate(_CUT) == 0
    assert browser.evaluate(_ROWS_CUT) == 0

    size(browser, 200, media="print")
    assert browser.evaluate(_CUT) > 0, "the check finds tables that the paper is too narrow for"

    size(browser, PHONE, phone=True)
    assert browser.evaluate("document.documentElement.scrollWidth") <= PHONE
    # A wide table scrolls within its own frame.
    assert browser.evaluate("[...document.querySelectorAll('table')].some((table) => table.scrollWidth > innerWidth)")
