"""Options of `eightpost select`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

TOTAL, POOL = 20, 0.02


@click.command()
@click.argument("folder", metavar="STUDY", type=click.Path(path_type=Path))
@click.option("--measure", "measures", multiple=True, metavar="MEASURE[=COUNT]",
              help="Measure to confirm; may be repeated. COUNT is its number of low and of high setups. Default: the "
              "measures of the objective; without an objective, all.")  # fmt: skip
@click.option("-n", "--total", type=click.IntRange(min=2), metavar="N", default=TOTAL, show_default=True,
              help="Total number of setups, if no COUNT is given.")  # fmt: skip
@click.option("--pool", type=click.FloatRange(0.0, 1.0), default=POOL, show_default=True, metavar="SHARE",
              help="Share of the setups at each end of a ranking to choose from, 0 to 1.")  # fmt: skip
@body
def select() -> None:
    """Select setups of a study to confirm on the rig: low and high ones of each measure, spread over the bank.

    STUDY is a folder that `eightpost study` wrote. The list selection.csv has a line for each run; the runs of the
    baseline come last. Save the rig records in the same folder, under the names in the column `file`; then `eightpost
    compare --measured` reads them. The page of the study is rewritten and shows the selection.

    \b
    Examples:
      eightpost select out/
      eightpost select out/ --measure "front ride height, RMS=4" --measure "total tire force, RMS=4"
    """
