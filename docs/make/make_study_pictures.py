"""Pictures of a study's page in docs/how_to/study_report.md, and the time from opening it to the answer.

    eightpost study examples/identified/study.toml -o out/
    eightpost study shapes examples/identified/study.toml -o out/ --at lr
    python docs/make/make_study_pictures.py out/            # pictures of the page

Headless Chromium opens the page from a file, in a new profile. The pictures: the first screen at 1400 x 900, its dark
form, a telephone, and print. Times are those of the browser's own clock, from the start of the navigation: the first
paint of content, which has the answer, and the moment when the ranking and the plots are drawn too.
"""

from __future__ import annotations

import argparse
import base64
import sys
import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests"))
from chromium import Browser, program  # noqa: E402 - the browser of the tests

PAGE = ROOT / "docs" / "how_to" / "study_report.md"

#: Pictures: size of the window, factor of the pixels, color scheme, medium, and whether the whole page is taken.
VIEWS = {
    "study_report": (1400, 900, 1.0, "light", "screen"),
    "study_report_dark": (1400, 900, 1.0, "dark", "screen"),
    "study_report_phone": (390, 844, 2.0, "light", "screen"),
    "study_report_print": (794, 1123, 1.0, "light", "print"),
}

#: When the page's script has drawn the ranking and the plots on the screen.
_READY = "document.body && document.body.dataset.ready"


def main() -> None:
    """Take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="output folder of eightpost study")
    options = parser.parse_args()
    for name in VIEWS:
        picture(options.folder / "report.html", name, ROOT / "docs" / "pictures" / f"{name}.png")


# ---- Pictures -------------------------------------------------------------------------------------------------------


def picture(page: Path, name: str, target: Path) -> None:
    """Take a picture of the first screen of a page, or of its first printed sheet."""
    width, height, factor, scheme, medium = VIEWS[name]
    with tempfile.TemporaryDirectory() as profile:
        browser = Browser(program(), profile)
        size = {"width": width, "height": height, "deviceScaleFactor": factor, "mobile": width < 600}
        browser.call("Emulation.setDeviceMetricsOverride", **size)
        browser.call("Emulation.setScrollbarsHidden", hidden=True)
        features = [{"name": "prefers-color-scheme", "value": scheme}]
        browser.call("Emulation.setEmulatedMedia", media="screen", features=features)
        browser.call("Page.navigate", url=page.resolve().as_uri())
        browser.until(_READY)
        browser.call("Emulation.setEmulatedMedia", media=medium, features=features)
        if medium == "print":
            browser.evaluate("window.dispatchEvent(new Event('beforeprint'))")
        taken = browser.call("Page.captureScreenshot", format="png")["data"]
        browser.close()
    image = Image.open(BytesIO(base64.b64decode(taken))).convert("P", palette=Image.Palette.ADAPTIVE, colors=128)
    image.save(target, optimize=True)
    print(f"{target.relative_to(ROOT)}: {image.width} x {image.height}, {target.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
