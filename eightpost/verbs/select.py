"""The options of `eightpost select`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

TOTAL, POOL = 20, 0.02


@click.command()
@click.argument("folder", metavar="STUDY", type=click.Path(path_type=Path))
@click.option("--measure", "measures", multiple=True, metavar="MEASURE[=COUNT]",
              help="A measure to confirm, once for each; with =COUNT so many setups of each end. Default: those of the "
              "objective, else all.")  # fmt: skip
@click.option("-n", "--total", type=click.IntRange(min=2), default=TOTAL, show_default=True,
              help="Setups in all, where no counts are given.")  # fmt: skip
@click.option("--pool", type=click.FloatRange(0.0, 1.0), default=POOL, show_default=True,
              help="Share of the setups, from each end, to choose from.")  # fmt: skip
@body
def select() -> None:
    """Select setups of a study to confirm on the rig: low and high ones of each measure, spread over the bank.

    STUDY is a folder that `eightpost study` wrote. The list selection.csv has a line per run, runs of the baseline
    last; put the rig's records beside it under the names in its column `file`, and `eightpost compare` takes it. The
    study's page is written anew with the selection in it.

    \b
    Example:
      eightpost select out/
      eightpost select out/ --measure "front ride height, RMS=4" --measure "total tire force, RMS=4"
    """
