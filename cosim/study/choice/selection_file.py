"""CSV file of the setups to test on the rig, to which the measured runs are added."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from cosim.study.choice.selection import ENDS, Selected, Selection, selection_of
from cosim.study.result import StudyResult
from eightpost import units
from eightpost.cells import plain_cell, write_rows
from eightpost.errors import FileFormatError, InputError
from eightpost.files import MALFORMED, atomic_path, read_text

#: Number of baseline runs, from which the run-to-run deviation is computed (7.3).
BASELINE_RUNS = 5


def write_selection(selection: Selection, result: StudyResult, path: str | Path) -> None:
    """Write the setups to test, one line each, followed by the runs of the baseline if the study has one.

    The column `file` names the record that `eightpost compare --measured` reads from the folder of the list.
    """
    corners = tuple(result.study.corners)
    rows = [_row(number, result, selected.setup.index) for number, selected in enumerate(selection.chosen, start=1)]
    for row, selected in zip(rows, selection.chosen, strict=True):
        unit = result.display(selected.measure)
        predicted = float(units.convert(selected.value, result.unit(selected.measure), unit))
        row |= {"measure": selected.measure, "end": selected.end, "predicted": f"{predicted:.6g}", "unit": unit}
        row |= {"place": str(selected.rank), "marks": selected.marks}
    baseline = result.study.baseline_setup
    if baseline is not None:
        first = len(rows) + 1
        repeats = [_row(number, result, baseline.index) for number in range(first, first + BASELINE_RUNS)]
        rows += [{**row, "end": "baseline"} for row in repeats]
    names = ("run", "file", "setup", *corners, "measure", "end", "predicted", "unit", "place", "marks")
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as stream:
        write_rows(stream, [names, *([row.get(name, "") for name in names] for row in rows)], end="\r\n")


def read_selection(path: str | Path, result: StudyResult) -> Selection:
    """Read a list of `write_selection` for the same study; values are taken from the study.

    Raises:
        FileFormatError: The file is not a selection of this study.
    """
    path = Path(path)
    text = read_text(path)
    try:
        rows = [row for row in _rows(text) if row["end"] in ENDS]
        return selection_of(result, [_selected(row, result) for row in rows])
    except (csv.Error, *MALFORMED) as error:
        raise FileFormatError(
            f"is not a selection of this study ({error}); run `eightpost select` again", path=path
        ) from error


def _rows(text: str) -> list[dict[str, str]]:
    heads, *lines = csv.reader(io.StringIO(text, newline=""))
    return [dict(zip(map(plain_cell, heads), map(plain_cell, line), strict=True)) for line in lines if line]


def _selected(row: dict[str, str], result: StudyResult) -> Selected:
    setup = result.study.space.setup(int(row["setup"]))
    if (place := result.row(setup.builds)) is None:
        raise InputError(f"setup {setup.index} was not run in the study")
    value = float(result.values(row["measure"])[place])
    return Selected(
        setup, row["measure"], "low" if row["end"] == "low" else "high", value, int(row["place"]), row["marks"]
    )


def _row(number: int, result: StudyResult, setup: int) -> dict[str, str]:
    builds = result.study.space.setup(setup).builds
    return {"run": str(number), "file": f"run_{number:02d}.parquet", "setup": str(setup), **builds}
