"""Options of `eightpost robust`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("folder", metavar="STUDY", type=click.Path(path_type=Path))
@click.argument("uncertain", metavar="UNCERTAIN", type=click.Path(path_type=Path))
@click.option("--top", type=click.IntRange(min=2), metavar="N", default=20, show_default=True,
              help="Number of leading setups to compare; the baseline is added.")  # fmt: skip
@click.option("--rank", metavar="MEASURE",
              help="Measure that ranks the setups, smallest first; default: the objective of the study.")  # fmt: skip
@click.option("--draws", type=click.IntRange(min=2), metavar="N", default=32, show_default=True,
              help="Number of draws of the uncertain parameters.")  # fmt: skip
@click.option(
    "--seed", type=click.IntRange(min=0), metavar="N", default=0, show_default=True, help="Seed of the draws."
)
@click.option("--workers", type=click.IntRange(min=1), metavar="N",
              help="Number of processes that run setups; default: one per processor.")  # fmt: skip
@body
def robust() -> None:
    """Show which of a study's best setups differ by more than the stated uncertainty.

    STUDY is a folder that `eightpost study` wrote. UNCERTAIN is a TOML file that states what is not known exactly:
    fitted shocks, parameters, other vehicles, and the difference between two runs on the rig (docs/study_choice.md).
    Every setup is run with every draw, so that errors common to all setups cancel. Setups that differ by less than two
    standard deviations are a tie. The page of the study is rewritten and shows the confidence intervals.

    \b
    Example:
      eightpost robust out/ uncertain.toml --top 20
    """
