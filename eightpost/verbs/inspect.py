"""The options of `eightpost inspect`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "--units", "unit_words", multiple=True, metavar="CHANNEL=UNIT", help="For a channel whose header has none."
)
@click.option("--map", "map_file", type=click.Path(path_type=Path), help="Channel map (TOML): docs/signs_and_units.md.")
@click.option("--flip", multiple=True, metavar="CHANNEL", help="Turn a channel that is positive the other way.")
@body
def inspect() -> None:
    """Show what is in a dynamometer or rig file, and what is suspicious in it.

    Columns, units and preamble as they stand; then, as `fit` would read a dynamometer file, channels, ranges, runs,
    temperature and notes; or, as `identify` would read a rig file (with wheelloaders, `lf.road` or `road`, by its own
    names or by a map), channels, ranges and what is out of step. FILE is .csv, .txt, .tsv, .parquet, .mat, .mf4 or
    .mdf, or a peak-velocity table. Exits 0 if nothing is suspicious, 1 if something is, 2 if the file cannot be used
    as it is.

    \b
    Examples:
      eightpost inspect run7.csv
      eightpost inspect run7.mf4 --units force=lbf --flip force
      eightpost inspect rig.csv --map rig_map.toml
    """
