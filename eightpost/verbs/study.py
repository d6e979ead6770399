"""Options of `eightpost study`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body

#: Time after which a silent worker is ended [s].
PATIENCE = 300.0


@click.command()
@click.argument("study_file", metavar="STUDY", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Output folder for results.parquet, the report and the intermediate results.")  # fmt: skip
@click.option("--workers", type=click.IntRange(min=1), metavar="N",
              help="Number of processes that run setups; default: one per processor.")  # fmt: skip
@click.option("--scheduler", metavar="ADDRESS",
              help="Address of a Dask cluster that runs the setups, e.g. tcp://host:8786 (docs/scale.md); default: "
              "this machine.")  # fmt: skip
@click.option("--patience", default=f"{PATIENCE:g} s", show_default=True, metavar="TIME",
              help="Time after which a worker that is not responding is ended and its setup marked as "
              "failed.")  # fmt: skip
@click.option("--rank", metavar="MEASURE",
              help="Measure that ranks the setups, smallest first; default: the objective of the study.")  # fmt: skip
@click.option("--top", type=click.IntRange(min=1), metavar="N", default=10, show_default=True,
              help="Number of rows of the printed ranking.")  # fmt: skip
@click.option("--trace", "traced", multiple=True, type=int, metavar="NUMBER",
              help="Setup whose time traces are written to traces/NUMBER.parquet; it is run again. May be "
              "repeated.")  # fmt: skip
@body
def study() -> None:
    """Run every setup of shocks that a study allows, and rank them.

    STUDY is a TOML file with a vehicle, a bank of shocks, the builds allowed at each corner, drive files, measures,
    objective and constraints; examples/study.toml is an example with comments. FMUs of shock files and vehicle files
    are built first.

    A study that was stopped, by Ctrl-C or otherwise, resumes where it stopped when it is started again with the same
    folder. The exit code is 1 if the study was stopped or setups failed, and 2 if the study cannot be run as it is.

    \b
    Examples:
      eightpost study examples/study.toml -o out/
      eightpost study examples/study.toml -o out/ --rank "front ride height, RMS"
      eightpost study examples/study.toml -o out/ --trace 1200
    """
