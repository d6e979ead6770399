"""`eightpost robust`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from eightpost.app.options import RANK, WORKERS, FilePath, Verb, seed_option
from eightpost.app.study import saved, show_certainty, show_page


@click.command(cls=Verb)
@click.argument("folder", metavar="STUDY", type=FilePath())
@click.argument("uncertain", metavar="UNCERTAIN", type=FilePath())
@click.option("--top", type=click.IntRange(min=2), metavar="N", default=20, show_default=True,
              help="Number of leading setups that are simulated with drawn parameters; the baseline is "
              "added.")  # fmt: skip
@RANK
@click.option("--draws", type=click.IntRange(min=0), metavar="N", default=32, show_default=True,
              help="Number of simulated draws of the uncertain parameters, which check the linear effects; 0: no "
              "check.")  # fmt: skip
@seed_option(0, "Seed of the simulated draws.")
@WORKERS
def robust(
    folder: Path, uncertain: Path, top: int, rank: str | None, draws: int, seed: int, workers: int | None
) -> None:
    """Compute how sure a study's choice is with an uncertainty file of your own.

    STUDY is a folder that `eightpost study` wrote. UNCERTAIN is a TOML file that states what is not known exactly:
    fitted shocks, parameters, other vehicles, and the difference between two runs on the rig
    (docs/how_to/study_choice.md). Its entries replace what the models state. The certainty of the study is written
    again (docs/explanation/certainty.md), and rig runs of `eightpost confirm` stay in it. The leading setups are also
    simulated with drawn parameters, and the largest difference from the linear effects is printed. The page of the
    study is rewritten.

    \b
    Example:
      eightpost robust out/ uncertain.toml --top 20
    """
    from cosim.study.verdict import study_verdict
    from eightpost.api.study_folder import CERTAINTY, SPREADS
    from eightpost.app.show import show_verdict

    console = Console()
    study = saved(console, folder, workers)
    certainty, check = study.robust(uncertain, top=top, criterion=rank, draws=draws, seed=seed)
    show_certainty(console, study.result, certainty)
    if check is not None:
        console.print(check.summary(), highlight=False, soft_wrap=True)
    show_verdict(console, study_verdict(study.result, certainty).about("choice", "rig runs"))
    console.print(f"wrote {folder / CERTAINTY} and {SPREADS}", highlight=False, soft_wrap=True)
    show_page(console, study)
