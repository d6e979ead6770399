"""The options of `eightpost study`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

#: How long a worker may stay silent [s].
PATIENCE = 300.0


@click.command()
@click.argument("study_file", metavar="STUDY", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Folder for results.parquet, the report, and what is done so far.")  # fmt: skip
@click.option("--workers", type=click.IntRange(min=1), help="Processes that run setups; default one per processor.")
@click.option("--scheduler", metavar="ADDRESS",
              help="Run the setups on a Dask cluster: tcp://host:8786 (docs/scale.md).")  # fmt: skip
@click.option("--patience", default=f"{PATIENCE:g} s", show_default=True, metavar="TIME",
              help="A worker that gives no sign for so long is ended, and its setup marked failed.")  # fmt: skip
@click.option("--rank", metavar="MEASURE", help="Rank by this measure, least first; default the study's objective.")
@click.option("--top", type=click.IntRange(min=1), default=10, show_default=True, help="Rows of the ranking.")
@click.option("--trace", "traced", multiple=True, type=int, metavar="NUMBER",
              help="Also write the time traces of this setup to traces/NUMBER.parquet; it is run again.")  # fmt: skip
@body
def study() -> None:
    """Run every setup of shocks that a study allows, and rank them.

    STUDY is a TOML file: a vehicle, a bank of shocks, which may go where, drivefiles, measures, objective and
    constraints; examples/study.toml is one with comments. FMUs of shock files and vehicle files are built first.

    A study that was stopped, by Ctrl-C or otherwise, goes on where it was left when it is called again with the same
    folder. Exits 1 if it was stopped or setups failed; 2 if it cannot be run as it stands.

    \b
    Example:
      eightpost study examples/study.toml -o out/
      eightpost study examples/study.toml -o out/ --rank "front ride height, RMS"
      eightpost study examples/study.toml -o out/ --trace 1200
    """
