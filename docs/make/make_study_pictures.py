"""Pictures of a study's page in docs/how_to/study_report.md, and the time from opening it to the answer.

    eightpost study examples/identified/study.toml -o out/
    eightpost shapes examples/identified/study.toml -o out/ --at lr
    python docs/make/make_study_pictures.py out/            # pictures of the page
    python docs/make/make_study_pictures.py out/ --times    # and times of pages of 2401 and 104 976 constructed setups

Headless Chromium opens the page from a file, in a new profile. The pictures: the first screen at 1400 x 900, its dark
form, a telephone, and print. Times are those of the browser's own clock, from the start of the navigation: the first
paint of content, which has the answer, and the moment when the ranking and the plots are drawn too.
"""

from __future__ import annotations

import argparse
import base64
import sys
import tempfile
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from page_parts import placed  # beside this file
from PIL import Image

from cosim.study.certainty import Certainty
from cosim.study.certainty.assess import certainty_of
from cosim.study.measures import Measure
from cosim.study.report import write_study_report
from cosim.study.result import StudyResult
from cosim.study.study import Build, Drive, Study, Term, Vehicle
from cosim.study.table import Provenance, result_table, study_schema
from eightpost.corners import CORNERS
from eightpost.uncertainty import MeasureUncertainty
from eightpost.validity import ModelUncertainty, Validity
from eightpost.verdict import Verdict

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

#: Builds at each corner of the constructed studies, and how often each page is opened.
TIMED, OPENED = (7, 18), 3

#: When the page's script has drawn the ranking and the plots on the screen.
_READY = "document.body && document.body.dataset.ready"


def main() -> None:
    """Take the pictures, and write the times into the page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="output folder of eightpost study")
    parser.add_argument("--times", action="store_true", help="also measure the times")
    options = parser.parse_args()
    for name in VIEWS:
        picture(options.folder / "report.html", name, ROOT / "docs" / "pictures" / f"{name}.png")
    if options.times:
        rows = [time_of(options.folder / "report.html", "the example")]
        with tempfile.TemporaryDirectory() as folder:
            rows += [time_of(write_constructed(Path(folder) / str(count), count), "constructed") for count in TIMED]
        lines = ["| page | setups | size | answer visible | ranking and plots drawn |", "|---|---|---|---|---|"]
        PAGE.write_text(placed(PAGE.read_text(encoding="utf-8"), "times", "\n".join(lines + rows)), encoding="utf-8")


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
        taken = browser.call("Page.captureScreenshot", format="png")["data"]
        browser.close()
    image = Image.open(BytesIO(base64.b64decode(taken))).convert("P", palette=Image.Palette.ADAPTIVE, colors=128)
    image.save(target, optimize=True)
    print(f"{target.relative_to(ROOT)}: {image.width} x {image.height}, {target.stat().st_size / 1000:.0f} kB")


# ---- Times ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Opening:
    """Times of one opening of a page, from the start of the navigation [s]: answer visible, and everything drawn."""

    answer: float
    drawn: float


def time_of(page: Path, words: str) -> str:
    """Return the line of a page: the median of three openings, each in a new profile."""
    found = [opening(page) for _ in range(OPENED)]
    answer, drawn = (float(np.median([getattr(one, name) for one in found])) for name in ("answer", "drawn"))
    count, size = setups_of(page), page.stat().st_size / 1e6
    print(f"{words}, {count} setups: {answer:.2f} s, {drawn:.2f} s", flush=True)
    return f"| {words} | {count} | {size:.1f} MB | {answer:.1f} s | {drawn:.1f} s |"


def opening(page: Path) -> Opening:
    """Open a page in a new profile and return its times."""
    with tempfile.TemporaryDirectory() as profile:
        browser = Browser(program(), profile)
        browser.call("Page.navigate", url=page.resolve().as_uri())
        browser.until(_READY)
        drawn = browser.evaluate("performance.now()")
        paint = browser.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
        is_there = browser.evaluate("document.querySelector('#answer').getBoundingClientRect().bottom")
        browser.close()
    assert 0.0 < is_there < 900.0, "the answer must be on the first screen"
    return Opening(1e-3 * paint, 1e-3 * drawn)


def setups_of(page: Path) -> int:
    """Return the number of setups of the study that a page was written for."""
    return len((page.parent / "ranking.csv").read_text(encoding="utf-8").partition('"rank"')[2].splitlines()) - 2


def write_constructed(folder: Path, count: int) -> Path:
    """Write the page of a study whose measures are formulas, with `count` builds at four corners and its certainty."""
    result = constructed(count)
    certainty: Certainty = certainty_of(result)
    return write_study_report(result, folder, certainty=certainty).page


def constructed(count: int) -> StudyResult:
    """Return a study of six measures, smooth functions of the damping at the corners, of a car with uncertainty."""
    builds = tuple(f"build {k + 1}" for k in range(count))
    outputs = ("front.ride_height", "rear.ride_height", *(f"{corner}.hub_acceleration" for corner in CORNERS))
    measures = tuple(Measure(f"{name.replace('.', ' ').replace('_', ' ')}, RMS", (f"car.{name}",)) for name in outputs)
    study = Study(
        f"{count**4} constructed setups",
        Vehicle(Path("car.fmu")),
        {name: Build(Path(f"{name}.fmu")) for name in builds},
        dict.fromkeys(CORNERS, builds),
        (Drive("lap", Path("lap.parquet"), 30.0),),
        measures,
        (Term(measures[0].name, 1.0, "m"), Term(measures[1].name, 0.7, "m")),
        baseline=dict.fromkeys(CORNERS, builds[count // 2]),
    )
    damping = study.space.digits(study.space.indices) / (count - 1.0)
    front, rear = damping[:, :2].mean(axis=1), damping[:, 2:].mean(axis=1)
    heights = [1.0 + (front - 0.8) ** 2 + 0.2 * rear, 1.0 + (rear - 0.3) ** 2 + 0.2 * (1.0 - front)]
    levels = np.column_stack([*heights, *(1.0 + (damping[:, k] - 0.4) ** 2 for k in range(4))]) * 1e-2
    state = {"status": "done", "message": "", "coupling_error_percent": 0.1, "marks": "", "seconds": 0.03}
    names = [measure.name for measure in measures]
    rows = [
        {"setup": index, **study.space.setup(index).builds, **dict(zip(names, values, strict=True)), **state}
        for index, values in zip(study.space.indices.tolist(), levels.tolist(), strict=True)
    ]
    units = dict(zip(names, ("m", "m", *("m/s2",) * 4), strict=True))
    stated = ModelUncertainty(measures={name: MeasureUncertainty(0.002, 0.02) for name in outputs})
    models = {"car.fmu": Validity(Verdict([]), (), stated).to_json()}
    source = Provenance("c" * 64, {}, {}, {}, units, models=models)
    return StudyResult(study, result_table(rows, study_schema(study, units)), source)


if __name__ == "__main__":
    main()
