"""The options of `eightpost compare`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("folders", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--vehicle", default="car", show_default=True, help="The vehicle's component, for the ride measures.")
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Picture of the changes (.png); with --measured a folder, default compared/ in the study's.",
)  # fmt: skip
@click.option("--measured", type=click.Path(path_type=Path), metavar="LIST",
              help="Compare a study with rig runs: a CSV that says which record is of which setup, such as the "
              "selection.csv of `eightpost select`, or the folder that it is in.")  # fmt: skip
@click.option("--measure", "measures", multiple=True, metavar="MEASURE", help="With --measured: only this one.")
@click.option("--channel-map", type=click.Path(path_type=Path), help="With --measured: channels of the rig's files.")
@click.option("--rank", type=click.FloatRange(-1.0, 1.0), default=0.8, show_default=True,
              help="With --measured: least rank correlation (Spearman) that is acceptable.")  # fmt: skip
@click.option("--level", type=click.FloatRange(min=0.0), metavar="PERCENT",
              help="With --measured: largest acceptable RMS error of the levels; default any.")  # fmt: skip
@body
def compare() -> None:
    """Compare runs, or a study's prediction with what the rig measured.

    Of runs: response measures side by side, and the change from the first run to the last. RUN is a folder that
    `eightpost run` wrote. Settling is left out as each run was told. Runs without the channels of the ride measures are
    compared channel by channel.

    With --measured, RUN is the folder of a study, and its prediction is compared with what the rig measured: trend,
    rank correlations, best-fit line and bands, as Fig 7.7. Exits 1 if a measure does not meet --rank or --level.

    \b
    Example:
      eightpost compare out out/swapped -o out/changes.png
      eightpost compare out/ --measured rig_day/selection.csv
    """
