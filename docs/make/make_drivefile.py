"""The complete workflow: track record, identification, drive file, study, confirmation on the rig and on the track.

    python docs/make/make_drivefile.py FOLDER [--duration '400 s']

The track is a lap of the stand-in on roads that the rig does not know: of its record, only the four hub accelerations
and the four shock displacements are kept. The script calls the commands of `eightpost` one after the other and prints
each. Files that exist in FOLDER are not created again. It writes the tables in docs/how_to/drivefile.md and its
picture; all data are SYNTHETIC. It takes about 10 minutes on one core.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from page_parts import call, placed  # beside this file

from eightpost import units
from eightpost.corners import CORNERS
from eightpost.signals import Drivefile, read_series
from eightpost.signals.formats import write_series
from eightpost.virtual.program import Bench

ROOT = Path(__file__).resolve().parents[2]
PAGE, PICTURE = ROOT / "docs" / "how_to" / "drivefile.md", ROOT / "docs" / "pictures" / "drivefile.png"

BASELINE, ALTERNATE = "B/B", "AA/AA"
#: Builds of the study, by corner: sixteen setups.
BUILDS = ("B/B", "C/C")

#: Seeds of the identification, of the lap and its record, of the iteration, and of the confirmation.
DRIVE, RUNS, LAP, TRACK_RUN, PASSES, TESTS = 21, 2100, 91, 4000, 5000, 6000

#: Target channels.
TARGETS = [f"{corner}.{what}" for what in ("hub_acceleration", "displacement") for corner in CORNERS]

#: Measures of the tables and their units.
SHOWN = {
    "total tire force, RMS": "lbf", "front ride height, RMS": "in", "rear ride height, RMS": "in",
    "lf tire force, RMS": "lbf", "rf hub acceleration, RMS": "g", "lr hub acceleration, RMS": "g",
    "lf shock velocity, RMS": "in/s",
}  # fmt: skip

STUDY = """schema = 1
name = "sixteen setups on the drive file of a lap (synthetic data)"
families = ["ride", "numbers"]
baseline = "{baseline}"

[vehicle]
fmu = "car.json"

[bank]
{bank}

[[drive]]
file = "drive.parquet"
start = "3 s"
stop = "33 s"

[drive.targets]
{targets}

[[objective]]
measure = "total tire force, RMS"
weight = 1.0
unit = "lbf"
"""


def main() -> None:
    """Run the workflow and write its page."""
    options = _options()
    folder: Path = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    _identify(folder, options.duration)
    _iterate(folder)
    _predict(folder)
    found = {place: _confirm(folder, place) for place in ("rig", "track")}
    page = placed(PAGE.read_text(encoding="utf-8"), "passes", _passes_table(folder / "lap"))
    PAGE.write_text(placed(page, "confirmed", _confirmed_table(found)), encoding="utf-8")
    _draw(folder / "lap")


def _identify(folder: Path, duration: str) -> None:
    rig, car = folder / "identification", folder / "car.json"
    if not rig.exists():
        call("virtual", "rig", "--program", "identification", "--shock", f"build:{BASELINE}",
             "--set", f"alternate=build:{ALTERNATE}", "--set", f"duration={duration}",
             "--set", f"seed={DRIVE}", "--set", f"run={RUNS}", "-o", rig)  # fmt: skip
    if not car.exists():
        call("identify", *sorted(rig.glob("*.parquet")), "-o", car, "--plot", "none", may_fail=True)


def _iterate(folder: Path) -> None:
    """Record a lap on the track, keep only its target channels, and iterate the drive file on the rig."""
    whole, track = folder / "track_whole.parquet", folder / "track.parquet"
    if not track.exists():
        call(
            "virtual",
            "rig",
            "--test",
            "track",
            "--set",
            f"seed={LAP}",
            "--set",
            f"run={TRACK_RUN}",
            "--shock",
            f"build:{BASELINE}",
            "-o",
            whole,
        )
        write_series(read_series(whole).select(TARGETS), track)
    if not (folder / "lap").exists():
        call("drivefile", "start", track, "--car", folder / "car.json", "-o", folder / "lap")
    call(
        "drivefile",
        "simulate",
        folder / "lap",
        "--shock",
        f"build:{BASELINE}",
        "--set",
        f"seed={PASSES}",
        may_fail=True,
    )


def _predict(folder: Path) -> None:
    """Predict sixteen setups with the roads and loads that the rig measured in the best pass."""
    study = folder / "study.toml"
    best = _errors(folder / "lap")[-1]["best"]
    record = read_series(folder / "lap" / f"pass_{best:02d}" / "rig.parquet")
    inputs = [f"{c}.{what}" for c in CORNERS for what in ("road", "aero")]
    write_series(record.select(inputs), folder / "drive.parquet")
    bank = "\n".join(f'"{b}" = "{ROOT / "examples" / "bank" / b.replace("/", "_")}.json"' for b in BUILDS)
    targets = "\n".join(f'"{name}" = "car.{name}"' for name in inputs)
    study.write_text(STUDY.format(baseline=BASELINE, bank=bank, targets=targets), encoding="utf-8")
    if not (folder / "study" / "results.parquet").exists():
        call("study", study, "-o", folder / "study")
    if not (folder / "study" / "selection.csv").exists():
        call("study", "select", folder / "study", "--measure", "total tire force, RMS=6", "--measure",
              "front ride height, RMS=2")  # fmt: skip


def _confirm(folder: Path, place: str) -> list[dict[str, Any]]:
    """Test the selected setups on the rig with the drive file, or on the track, and compare with the prediction."""
    tested = folder / f"tested_on_{place}"
    tested.mkdir(exist_ok=True)
    with (folder / "study" / "selection.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    shutil.copy(folder / "study" / "selection.csv", tested)
    bench = Bench.of("eight_post", run=TESTS + (1000 if place == "track" else 0))
    track = bench.drivefile("track", LAP)
    best = Drivefile(read_series(folder / "lap" / "best_drive.parquet"))
    for row in rows:
        target = tested / row["file"]
        if not target.exists():
            names = tuple(f"build:{row[corner]}" for corner in CORNERS)
            record = bench.record(track if place == "track" else best, names, place, int(row["run"]))
            if place == "rig":  # the lap without the rests before and after it
                record = type(record)(record.series.window(3.0, 36.0), record.conditions)
            record.write(target)
    output = folder / f"compared_on_{place}"
    call("study", "compare", folder / "study", "--measured", tested, "-o", output, may_fail=True)
    content = json.loads((output / "comparison.json").read_text(encoding="utf-8"))
    return list(content["measures"])


# ---- Tables and picture ---------------------------------------------------------------------------------------------


def _errors(lap: Path) -> list[dict[str, Any]]:
    return [json.loads(path.read_text(encoding="utf-8")) for path in sorted(lap.glob("pass_*/errors.json"))]


def _rms(errors: Mapping[str, Any], quantity: str) -> float:
    found = [value for name, value in errors["channels"].items() if name.endswith(quantity)]
    return 100.0 * float(np.sqrt(np.mean(np.square(found))))


def _passes_table(lap: Path) -> str:
    lines = ["| pass | hub acceleration, % | displacement, % | worst channel, % |", "|---|---|---|---|"]
    for errors in _errors(lap):
        worst = 100.0 * max(errors["channels"].values())
        lines.append(
            f"| {errors['pass']} | {_rms(errors, 'hub_acceleration'):.2f} | {_rms(errors, 'displacement'):.2f} | "
            f"{worst:.2f} |"
        )
    return "\n".join(lines)


def _confirmed_table(found: Mapping[str, list[dict[str, Any]]]) -> str:
    lines = [
        "| RMS | Spearman, rig | level error, rig | Spearman, track | level error, track |",
        "|---|---|---|---|---|",
    ]
    by_place = {place: {entry["measure"]: entry for entry in entries} for place, entries in found.items()}
    for measure in SHOWN:
        if all(measure in entries for entries in by_place.values()):
            cells = [
                f"{by_place[place][measure][key]:{form}}{suffix}"
                for place in ("rig", "track")
                for key, form, suffix in (("spearman", ".3f", ""), ("level_error_percent", ".1f", " %"))
            ]
            lines.append(f"| {measure.removesuffix(', RMS')} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _draw(lap: Path) -> None:
    """Draw the errors by pass, and target and best pass of one channel."""
    mpl.use("Agg")
    import matplotlib.pyplot as plt  # noqa: PLC0415  after the choice of the backend

    errors = _errors(lap)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.0, 3.4), width_ratios=(2, 3), layout="constrained")
    for quantity, color in (("hub_acceleration", "#0072b2"), ("displacement", "#d55e00")):
        values = [_rms(one, quantity) for one in errors]
        left.semilogy(range(1, len(values) + 1), values, "o-", color=color, label=quantity.replace("_", " "))
    left.set(xlabel="pass", ylabel="error, % of the target's RMS")
    left.grid(color="#e6e9ee")
    left.legend(frameon=False)
    best = errors[-1]["best"]
    target, record = read_series(lap / "target.parquet"), read_series(lap / f"pass_{best:02d}" / "record.parquet")
    first = read_series(lap / "pass_01" / "record.parquet")
    name = "rr.hub_acceleration"
    for series, style, label in ((target, {"color": "#9aa4b1", "lw": 3.5}, "track"),
                                 (first, {"color": "#d55e00", "lw": 0.8}, "rig, pass 1"),
                                 (record, {"color": "#0072b2", "lw": 1.2}, f"rig, pass {best}")):  # fmt: skip
        shift = 0.0 if series is target else 3.0
        inside = (series.time >= 12.0 + shift) & (series.time <= 13.0 + shift)
        values = units.convert(series[name][inside], "m/s2", "g")
        right.plot(series.time[inside] - shift, values, label=label, **style)
    right.set(xlabel="time, s", ylabel="right rear hub acceleration, g")
    right.grid(color="#e6e9ee")
    right.legend(frameon=False, ncols=3, loc="upper center")
    figure.savefig(PICTURE, dpi=110)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="Folder of the files.")
    parser.add_argument("--duration", default="400 s", help="Duration of each identification test.")
    return parser.parse_args()


if __name__ == "__main__":
    main()
