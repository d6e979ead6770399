"""The rig day of chapter 7 on the 8-post stand-in: identify, predict 2401 setups, select, test, compare, confirm.

    python docs/make/make_rig_day.py FOLDER [--duration '400 s'] [--bank FOLDER] [--workers N]

The script calls the commands of `eightpost` one after the other and prints each, so that any of them can be repeated
manually. Files that exist in FOLDER are not created again. It writes the tables in docs/evidence/rig_day.md and its
picture; all data are SYNTHETIC, and the seeds are constants of this script. --bank takes fitted shocks from another
folder, such as examples/bank, instead of testing and fitting the seven builds.
"""

from __future__ import annotations

import argparse
import csv
import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from page_parts import call, placed  # beside this file

from eightpost import units
from eightpost.corners import CORNERS

ROOT = Path(__file__).resolve().parents[2]
PAGE, PICTURE = ROOT / "docs" / "evidence" / "rig_day.md", ROOT / "docs" / "pictures" / "rig_day.png"

BUILDS = ("AA/AA", "AA/B", "B/AA", "B/B", "B/C", "C/B", "C/C")
BASELINE, ALTERNATE = "B/B", "AA/AA"

#: Seeds of the identification's drive file and its runs, of the lap, of the recorded run of the lap, and of the tests.
DRIVE, RUNS, LAP, DRIVE_RUN, TEST_RUNS = 11, 1100, 77, 2000, 3000

#: Peak displacements of the two random dynamometer tests of each build, and the seeds of the tests of the first build.
#: At 0.5 in the velocity reaches 0.5 m/s; the shocks of the lap move 1 to 3 mm (RMS) and reach 0.2 to 0.45 m/s.
PEAKS, BENCH = ("0.5 in", "0.3 in"), (101, 151)

#: Number of low setups, and of high setups, to select for each measure (twenty in Table 7.5).
SELECTED = {"front ride height, RMS": 4, "total tire force, RMS": 3, "rf hub acceleration, RMS": 3}

#: Measures of the table and their units.
SHOWN = {
    **dict.fromkeys(("front ride height, RMS", "rear ride height, RMS"), "in"),
    **dict.fromkeys(("total tire force, RMS", "lf tire force, RMS", "rr tire force, RMS"), "lbf"),
    **dict.fromkeys(("rf hub acceleration, RMS", "lr hub acceleration, RMS"), "g"),
    **dict.fromkeys(("lf shock velocity, RMS", "rr shock velocity, RMS"), "in/s"),
}

STUDY = """schema = 1
name = "seven builds on the identified 8-post stand-in (synthetic data)"
families = ["ride", "numbers"]
baseline = "{baseline}"

[vehicle]
fmu = "car.json"

[bank]
{bank}

[[drive]]
file = "lap.parquet"
stop = "33 s"

[drive.targets]
{targets}

[[objective]]
measure = "front ride height, RMS"
weight = 1000.0
unit = "in"

[[objective]]
measure = "total tire force, RMS"
weight = 1.0
unit = "lbf"
"""


def main() -> None:
    """Run all commands of the rig day and write its page."""
    options = _options()
    folder: Path = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    _identify(folder, options.duration)
    bank = options.bank or folder / "bank"
    if options.bank is None:
        _fit_bank(bank)
    _predict(folder, bank, options.workers)
    _test(folder)
    study = folder / "study"
    found = _compare(study, "compared")
    _confirm(study)
    after = _compare(study, "compared_after")
    PAGE.write_text(placed(PAGE.read_text(encoding="utf-8"), "measures", measures_table(found)), encoding="utf-8")
    print(intervals_table(found, after))
    shutil.copy(study / "compared" / "comparison.png", PICTURE)


def _identify(folder: Path, duration: str) -> None:
    """Run the five tests of 6.1.5 with physical dampers, and identify the car."""
    rig, car = folder / "identification", folder / "car.json"
    if not rig.exists():
        call("virtual", "rig", "--program", "identification", "--shock", f"build:{BASELINE}",
             "--set", f"alternate=build:{ALTERNATE}", "--set", f"duration={duration}",
             "--set", f"seed={DRIVE}", "--set", f"run={RUNS}", "-o", rig)  # fmt: skip
    if not car.exists():
        call("identify", *sorted(rig.glob("*.parquet")), "-o", car, "--plot", "none", may_fail=True)


def _fit_bank(bank: Path) -> None:
    """Test every build twice on the virtual dynamometer, and fit its law."""
    bank.mkdir(exist_ok=True)
    for number, build in enumerate(BUILDS):
        name = build.replace("/", "_")
        tests = [bank / f"{name}_{test}.parquet" for test in range(len(PEAKS))]
        for peak, first, test in zip(PEAKS, BENCH, tests, strict=True):
            if not test.exists():
                call("virtual", "dyno", "--build", build, "--set", f"amplitude={peak}", "--set", "duration=12 s",
                     "--set", f"seed={first + number}",
                     "-o", test)  # fmt: skip
        if not (bank / f"{name}.json").exists():
            # The car's static loads and ride heights already include the gas force.
            call("fit", *tests, "--gas", "included", "--set", f"name=build {build}", "-o", bank / f"{name}.json")


def _predict(folder: Path, bank: Path, workers: int | None) -> None:
    """Record a lap with the baseline, predict every setup of the seven builds on it, and select twenty setups."""
    lap, study = folder / "lap.parquet", folder / "study.toml"
    if not lap.exists():
        call(
            "virtual",
            "rig",
            "--test",
            "track",
            "--set",
            f"seed={LAP}",
            "--set",
            f"run={DRIVE_RUN}",
            "--shock",
            f"build:{BASELINE}",
            "-o",
            lap,
        )
    files = "\n".join(f'"{build}" = "{(bank / build.replace("/", "_")).resolve()}.json"' for build in BUILDS)
    targets = "\n".join(f'"{c}.{what}" = "car.{c}.{what}"' for c in CORNERS for what in ("road", "aero"))
    study.write_text(STUDY.format(baseline=BASELINE, bank=files, targets=targets), encoding="utf-8")
    if not (folder / "study" / "results.parquet").exists():
        call("study", study, "-o", folder / "study", *(["--workers", workers] if workers else []))
    if not (folder / "study" / "selection.csv").exists():
        counts = [word for name, count in SELECTED.items() for word in ("--measure", f"{name}={count}")]
        call("study", "select", folder / "study", *counts)


def _test(folder: Path) -> None:
    """Run the selected setups on the rig, each with its own drift and noise, with physical dampers instead of fits."""
    for row in selection(folder / "study"):
        record = folder / "study" / row["file"]
        if not record.exists():
            shocks = [word for corner in CORNERS for word in ("--shock", f"build:{row[corner]}")]
            call(
                "virtual",
                "rig",
                "--test",
                "track",
                "--set",
                f"seed={LAP}",
                "--set",
                f"run={TEST_RUNS + int(row['run'])}",
                *shocks,
                "-o",
                record,
            )


def _compare(study: Path, name: str) -> list[dict[str, Any]]:
    """Compare all rig runs with the study and its certainty; return the comparison of each measure."""
    output = study / name
    if not output.exists():
        call("study", "compare", study, "--measured", study, "-o", output, may_fail=True)
    found: list[dict[str, Any]] = json.loads((output / "comparison.json").read_text(encoding="utf-8"))["measures"]
    return found


def _confirm(study: Path) -> None:
    """Update the certainty of the study with the rig runs of the proposed tests only."""
    if (study / "certainty.previous.parquet").exists():
        return
    tests = [row for row in selection(study) if row["end"] == "test"]
    call("study", "confirm", study, *(f"{row['setup']}={study / row['file']}" for row in tests), may_fail=True)


def selection(study: Path) -> list[dict[str, str]]:
    """Return the runs of the rig day, by column."""
    with (study / "selection.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def measures_table(found: Sequence[Mapping[str, Any]]) -> str:
    """Return the accuracy of each predicted measure as Markdown."""
    lines = [
        "| RMS | measured, minimum to maximum | Spearman | attainable | Kendall | slope (95 %) | level error | bias "
        "| scatter about the line | a run's sigma | in the two-sigma band |",
        "|---" * 11 + "|",
    ]
    lines += [_measure_line(entry, SHOWN[entry["measure"]]) for entry in found if entry["measure"] in SHOWN]
    return "\n".join(lines)


def _measure_line(entry: Mapping[str, Any], unit: str) -> str:
    factor, _ = units.conversion(entry["unit"], unit)
    measured, (low, high) = [factor * value for value in entry["measured"]], entry["slope_interval_95"]
    percent = 100.0 * len(measured) / sum(entry["measured"])
    cells = (
        entry["measure"].removesuffix(", RMS"),
        f"{min(measured):.3g} to {max(measured):.3g} {unit}",
        f"{entry['spearman']:.3f}",
        f"{entry['spearman_attainable']:.3f}",
        f"{entry['kendall']:.3f}",
        f"{entry['slope']:.2f} ({low:.2f} to {high:.2f})",
        f"{entry['level_error_percent']:.1f} %",
        f"{entry['bias_percent']:+.1f} %",
        f"{percent * entry['scatter']:.2g} %",
        f"{factor * entry['run_to_run']:.2g} {unit} ({percent * entry['run_to_run']:.2g} %)",
        f"{entry['within_band']} of {len(measured)}",
    )
    return f"| {' | '.join(cells)} |"


def intervals_table(before: Sequence[Mapping[str, Any]], after: Sequence[Mapping[str, Any]]) -> str:
    """Return how many measured levels are inside the intervals of the study, before and after `confirm`."""
    lines = [
        "| RMS | half-width of a rig run's 95 % interval, as predicted | measured levels inside | after the proposed "
        "tests | measured levels of the other setups inside |",
        "|---" * 5 + "|",
    ]
    for entries in zip(before, after, strict=True):
        if entries[0]["measure"] in SHOWN:
            cells = [f"{_widths(one)} | {one['within_interval']} of {one['judged']}" for one in entries]
            lines.append(f"| {entries[0]['measure'].removesuffix(', RMS')} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _widths(entry: Mapping[str, Any]) -> str:
    """Return the smallest and the largest half-width of the intervals of a measure [%]."""
    lows, highs = entry["interval_95"]
    known = [(low, high) for low, high in zip(lows, highs, strict=True) if low is not None]
    widths = [100.0 * (high - low) / (high + low) for low, high in known]
    return f"{min(widths):.1f} to {max(widths):.1f} %" if widths else "not known"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="folder for rig records, the identified car, the study and its tests")
    parser.add_argument("--duration", default="400 s", help="duration of each of the five identification tests")
    parser.add_argument("--bank", type=Path, help="folder with fitted shocks, instead of tests and fits of the builds")
    parser.add_argument("--workers", type=int, help="number of processes of the study")
    return parser.parse_args()


if __name__ == "__main__":
    main()
