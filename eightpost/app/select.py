"""`eightpost study select`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import FilePath, Number, argument, option, setting, verb
from eightpost.app.study import saved
from eightpost.errors import InputError
from eightpost.report.console import Table, console_table, right, unbroken

if TYPE_CHECKING:
    from cosim.study.choice.selection import Selection
    from cosim.study.table import StudyResult

TOTAL, POOL, TWICE = 20, 0.02, 4


@verb
def select(
    folder: Path = argument("STUDY", kind=FilePath()),
    measures: tuple[str, ...] = option(
        "Measure to confirm; may be repeated. COUNT is its number of low and of high setups. Default: the measures of "
        "the objective; without an objective, all.",
        "--measure", metavar="MEASURE[=COUNT]",
    ),
    total: int = option(
        "Total number of setups, if no COUNT is given; with COUNT, the proposed tests come in addition.",
        "-n", "--total", kind=click.IntRange(min=2), default=TOTAL, metavar="N",
    ),
    pool: float = setting(
        "Share of the setups at each end of a ranking to choose from, 0 to 1.",
        kind=Number(0.0, 1.0), default=POOL,
    ),
    twice: int = setting(
        "Maximum number of extreme setups that are listed twice: drift from run to run moves them more than the "
        "baseline.",
        kind=click.IntRange(min=0), default=TWICE,
    ),
) -> None:  # fmt: skip
    """Select setups of a study to confirm on the rig: the tests that decide most about the best setup, then low and
    high setups of each measure, spread over the bank.

    STUDY is a folder that `eightpost study` wrote. The list selection.csv has a line for each run; second runs of
    extreme setups and the runs of the baseline come last: they show how far two runs of a setup differ. Save the rig
    records in the same folder, under the names in the column `file`; then `eightpost study compare --measured` reads
    them. The page of the study is rewritten and shows the selection.

    \b
    Examples:
      eightpost study select out/
      eightpost study select out/ --measure "front ride height, RMS=4" --measure "total tire force, RMS=4"
    """
    from cosim.study.choice.selection import BASELINE_RUNS, repeated
    from eightpost.api.study_folder import SELECTION
    from eightpost.app.show import show_files, show_table, show_text

    console = Console()
    study = saved(console, folder)
    names, share = _measures_and_counts(measures)
    selection = study.select(names, total=total, share=share, pool=pool, twice=twice)
    show_table(console, selection_table(selection, study.result))
    if marked := sum(bool(selected.marks) for selected in selection.chosen):
        show_text(console, f"* {marked} predictions have a mark: see the column marks of the list")
    show_text(console, f"any two setups differ at {selection.closest} or more corners")
    second = len(repeated(selection, twice))
    repeats = f", {second} of them twice" if second else ""
    repeats += f", and {BASELINE_RUNS} runs of the baseline" if study.study.baseline else ""
    show_text(console, f"selection.csv: {len(selection.chosen)} setups{repeats}")
    show_files(console, [folder / SELECTION, study.write_page()])


def _measures_and_counts(measures: tuple[str, ...]) -> tuple[tuple[str, ...], dict[str, int] | None]:
    """Return the measures, and the number of setups of each end by measure if counts are given."""
    counted = {name: count for name, equal, count in (m.rpartition("=") for m in measures) if equal}
    if not counted:
        return measures, None
    if len(counted) < len(measures) or not all(count.isdecimal() and int(count) for count in counted.values()):
        raise InputError("give every --measure a count, e.g. 'total tire force, RMS=4', or omit all counts")
    return tuple(counted), {name: int(count) for name, count in counted.items()}


def selection_table(selection: Selection, result: StudyResult) -> Table:
    """Return a table of the selected setups, as Table 7.5; an asterisk means that the prediction has a mark."""
    from eightpost import units

    rows = []
    for number, selected in enumerate(selection.chosen, start=1):
        name = selected.measure
        value = units.convert(selected.value, result.unit(name), result.display(name))
        shown = f"{value:.4g} {result.display(name)}{'*' if selected.marks else ''}"
        builds = selected.setup.builds.values()
        rows.append((str(number), escape(name), selected.end, *builds, shown, str(selected.rank)))
    columns = ["", "measure", "", *unbroken(*result.study.corners), "predicted", *right("rank")]
    return console_table(columns, rows)
