"""The options of `eightpost optimise`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("study_file", metavar="STUDY", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("out"), show_default=True,
              help="Folder for results.parquet, the page, and what is done so far.")  # fmt: skip
@click.option("--for", "objectives", multiple=True, metavar="MEASURE",
              help="A measure to minimise; several for their trade-offs. Default: the study's objective.")  # fmt: skip
@click.option("--evaluations", type=click.IntRange(min=2), default=400, show_default=True,
              help="Most setups to try.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the search.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes that run setups; default one per processor.")
@click.option("--scheduler", metavar="ADDRESS", help="Run the setups on a Dask cluster: tcp://host:8786.")
@body
def optimise() -> None:
    """Search the best setups of a study whose bank is too large to run them all.

    STUDY is the TOML file of `eightpost study`. Setups are tried in generations, none twice; the same seed takes the
    same way, and a search that was stopped goes on where it was left, also with more evaluations. Needs pymoo
    (eightpost[optimise]). Exits 1 if no setup that was tried keeps the constraints.

    \b
    Example:
      eightpost optimise examples/study.toml -o out/
      eightpost optimise examples/study.toml -o out/ --for "front ride height, RMS" --for "total tire force, RMS"
    """
