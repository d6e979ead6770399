"""Options of `eightpost inspect`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option("--units", "unit_words", multiple=True, metavar="CHANNEL=UNIT",
              help="Unit of a channel whose header names none, e.g. force=lbf; may be repeated.")  # fmt: skip
@click.option("--map", "map_file", type=click.Path(path_type=Path), metavar="TOML",
              help="Channel map (docs/signs_and_units.md); default: the channel names in the file.")  # fmt: skip
@click.option("--flip", multiple=True, metavar="CHANNEL",
              help="Reverse the sign of a channel, e.g. force; may be repeated.")  # fmt: skip
@body
def inspect() -> None:
    """Show the content of a dynamometer or rig file, and everything suspicious in it.

    First, columns, units and preamble are shown as they are in the file. Then a dynamometer file is read as `fit` reads
    it: channels, ranges, runs, temperature and notes. A rig file is read as `identify` reads it: channels, ranges and
    channels that are late. A rig file is recognized by its wheelloaders (`lf.road` or `road`, in the file or in the
    map). FILE is a .csv, .txt, .tsv, .parquet, .mat, .mf4 or .mdf file, or a peak-velocity table. The exit code is 0 if
    nothing is suspicious, 1 if something is suspicious, and 2 if the file cannot be used as it is.

    \b
    Examples:
      eightpost inspect run7.csv
      eightpost inspect run7.mf4 --units force=lbf --flip force
      eightpost inspect rig.csv --map rig_map.toml
    """
