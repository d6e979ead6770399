"""Picture of the top of a dynamometer report in docs/how_to/dyno_report.md: python docs/make/make_report_picture.py."""

from __future__ import annotations

import base64
import sys
import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image

from eightpost.ident.dyno_report.builds import Reading, dyno_report, read_entries, read_limits
from eightpost.ident.dyno_report.page import write_report

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from chromium import Browser, program  # noqa: E402 - the browser of the tests

#: Size of the window [px].
WIDTH, HEIGHT = 1064, 1000


def main() -> None:
    """Write the report of three records, with 15 % and 40 N about the first one as limits, and take the picture."""
    records = [ROOT / "examples" / "data" / f"dyno_{build}.csv" for build in "ABC"]
    limits = read_limits(records[0], Reading(), [(15.0, "%"), (40.0, "N")])
    report = dyno_report(read_entries(records, Reading()), limits=limits)
    with tempfile.TemporaryDirectory() as folder:
        page = write_report(Path(folder) / "report.html", report)
        browser = Browser(program(), str(Path(folder) / "profile"))
        size = {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": 1.0, "mobile": False}
        browser.call("Emulation.setDeviceMetricsOverride", **size)
        browser.call("Emulation.setScrollbarsHidden", hidden=True)
        browser.call("Page.navigate", url=page.as_uri())
        browser.until("document.body && document.body.dataset.drawn === 'all'")
        taken = browser.call("Page.captureScreenshot", format="png")["data"]
        browser.close()
    image = Image.open(BytesIO(base64.b64decode(taken))).convert("P", palette=Image.Palette.ADAPTIVE, colors=128)
    image.save(ROOT / "docs" / "pictures" / "dyno_report.png", optimize=True)


if __name__ == "__main__":
    main()
