"""Options of `eightpost compare`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("folders", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--vehicle", default="car", show_default=True, metavar="COMPONENT",
              help="Name of the vehicle component whose channels give the ride measures.")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Picture of the changes (.png); default: none. With --measured: output folder; default: compared/ "
              "in the folder of the study.")  # fmt: skip
@click.option("--measured", type=click.Path(path_type=Path), metavar="LIST",
              help="List of rig runs to compare a study with: a CSV file that assigns a setup to each record, such as "
              "the selection.csv of `eightpost select`, or its folder. Default: compare runs.")  # fmt: skip
@click.option("--measure", "measures", multiple=True, metavar="MEASURE",
              help="Measure to compare with --measured; may be repeated. Default: all measures that do not depend on "
              "a mean.")  # fmt: skip
@click.option("--channel-map", type=click.Path(path_type=Path), metavar="TOML",
              help="Channel map of the rig files for --measured; default: the channel names in the files.")  # fmt: skip
@click.option("--rank", type=click.FloatRange(-1.0, 1.0), default=0.8, show_default=True,
              help="Minimum acceptable rank correlation (Spearman) for --measured, -1 to 1.")  # fmt: skip
@click.option("--level", type=click.FloatRange(min=0.0), metavar="PERCENT",
              help="Maximum acceptable RMS error of the levels for --measured [%], e.g. 5; default: no "
              "limit.")  # fmt: skip
@body
def compare() -> None:
    """Compare runs, or a study's prediction with rig measurements.

    Without --measured, each RUN is a folder that `eightpost run` wrote. The response measures of all runs are listed
    side by side, with the change from the first run to the last. The settling time of each run is left out. Runs that
    lack the channels of the ride measures are compared channel by channel.

    With --measured, RUN is the folder of a study, and its prediction is compared with the rig measurements: trend, rank
    correlations, best-fit line and bands, as in Fig 7.7. The exit code is 1 if a measure misses --rank or --level.

    \b
    Examples:
      eightpost compare out out/swapped -o out/changes.png
      eightpost compare out/ --measured rig_day/selection.csv
    """
