"""Options of `eightpost optimise`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("study_file", metavar="STUDY", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Output folder for results.parquet, the page and the intermediate results.")  # fmt: skip
@click.option("--for", "objectives", multiple=True, metavar="MEASURE",
              help="Measure to minimise; repeat it for the Pareto front of several. Default: the objective of the "
              "study.")  # fmt: skip
@click.option("--evaluations", type=click.IntRange(min=2), metavar="N", default=400, show_default=True,
              help="Maximum number of setups to evaluate.")  # fmt: skip
@click.option(
    "--seed", type=click.IntRange(min=0), metavar="N", default=0, show_default=True, help="Seed of the search."
)
@click.option("--workers", type=click.IntRange(min=1), metavar="N",
              help="Number of processes that run setups; default: one per processor.")  # fmt: skip
@click.option("--scheduler", metavar="ADDRESS",
              help="Address of a Dask cluster that runs the setups, e.g. tcp://host:8786 (docs/scale.md); default: "
              "this machine.")  # fmt: skip
@body
def optimise() -> None:
    """Search for the best setups of a study whose bank is too large to run them all.

    STUDY is the TOML file of `eightpost study`. Setups are evaluated in generations, each setup once. The same seed
    gives the same search. A stopped search resumes where it stopped, also with a larger number of evaluations. Needs
    pymoo (eightpost[optimise]). The exit code is 1 if no evaluated setup meets the constraints.

    \b
    Examples:
      eightpost optimise examples/study.toml -o out/
      eightpost optimise examples/study.toml -o out/ --for "front ride height, RMS" --for "total tire force, RMS"
    """
