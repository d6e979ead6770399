"""The list of setups to test on the rig, as a file for the shop floor that later takes the measured runs."""

from __future__ import annotations

import csv
from pathlib import Path

from cosim.study.result import StudyResult
from cosim.study.selection import Selection
from eightpost import units
from eightpost.files import atomic_path

#: Runs of the baseline that say how runs differ (7.3).
BASELINE_RUNS = 5


def write_selection(selection: Selection, result: StudyResult, path: str | Path) -> None:
    """Write the setups to test, a line each, after them the baseline's runs where the study has a baseline.

    The column `file` names the record that `eightpost compare --measured` will look for beside the list.
    """
    corners = tuple(result.study.corners)
    rows = [_row(number, result, selected.setup.index) for number, selected in enumerate(selection.chosen, start=1)]
    for row, selected in zip(rows, selection.chosen, strict=True):
        unit = result.display(selected.measure)
        predicted = float(units.convert(selected.value, result.unit(selected.measure), unit))
        row |= {"measure": selected.measure, "end": selected.end, "predicted": f"{predicted:.6g}", "unit": unit}
        row |= {"marks": selected.marks}
    baseline = result.study.baseline_setup
    if baseline is not None:
        first = len(rows) + 1
        repeats = [_row(number, result, baseline.index) for number in range(first, first + BASELINE_RUNS)]
        rows += [{**row, "end": "baseline"} for row in repeats]
    names = ("run", "file", "setup", *corners, "measure", "end", "predicted", "unit", "marks")
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.DictWriter(stream, names, restval="")
        writer.writeheader()
        writer.writerows(rows)


def _row(number: int, result: StudyResult, setup: int) -> dict[str, str]:
    builds = result.study.space.setup(setup).builds
    return {"run": str(number), "file": f"run_{number:02d}.parquet", "setup": str(setup), **builds}
