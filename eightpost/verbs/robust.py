"""The options of `eightpost robust`."""

from __future__ import annotations

from pathlib import Path

import click

from eightpost.verbs.body import body


@click.command()
@click.argument("folder", metavar="STUDY", type=click.Path(path_type=Path))
@click.argument("uncertain", metavar="UNCERTAIN", type=click.Path(path_type=Path))
@click.option("--top", type=click.IntRange(min=2), default=20, show_default=True,
              help="Setups to look at: the best so many, and the baseline.")  # fmt: skip
@click.option("--rank", metavar="MEASURE", help="Best in this measure, least first; default the study's objective.")
@click.option("--draws", type=click.IntRange(min=2), default=32, show_default=True,
              help="Studies with drawn parameters.")  # fmt: skip
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the draws.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes that run setups; default one per processor.")
@body
def robust() -> None:
    """Say which of a study's best setups differ by more than the uncertainty that is stated.

    STUDY is a folder that `eightpost study` wrote, UNCERTAIN a TOML file that says what is not known exactly: fitted
    shocks, parameters, other vehicles, and how much two runs on the rig differ (docs/study_choice.md). Every draw is
    run for every setup, so that what setups have in common cancels. Those whose difference is within two standard
    deviations are a tie. The study's page is written anew with the spreads in it.

    \b
    Example:
      eightpost robust out/ uncertain.toml --top 20
    """
