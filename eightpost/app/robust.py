"""`eightpost study robust`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from eightpost.app.options import FilePath, argument, setting, verb
from eightpost.app.study import saved, show_certainty


@verb
def robust(
    folder: Path = argument("STUDY", kind=FilePath()),
    uncertain: Path = argument("UNCERTAIN", kind=FilePath()),
    rank: str | None = setting("Measure that ranks the setups, smallest first; default: the objective of the study."),
    top: int = setting(
        "Number of leading setups that are simulated with drawn parameters; the baseline is added.",
        kind=click.IntRange(min=2), default=20,
    ),
    draws: int = setting(
        "Number of simulated draws of the uncertain parameters, which check the linear effects; 0: no check.",
        kind=click.IntRange(min=0), default=32,
    ),
    seed: int = setting("Seed of the simulated draws.", kind=click.IntRange(min=0), default=0),
    workers: int | None = setting(
        "Number of processes that run setups; default: one per processor.",
        kind=click.IntRange(min=1),
    ),
) -> None:  # fmt: skip
    """Compute how sure a study's choice is with an uncertainty file of your own.

    STUDY is a folder that `eightpost study` wrote. UNCERTAIN is a TOML file that states what is not known exactly:
    fitted shocks, parameters, other vehicles, and the difference between two runs on the rig
    (docs/how_to/study_choice.md). Its entries replace what the models state. The certainty of the study is written
    again (docs/explanation/certainty.md), and rig runs of `eightpost study confirm` stay in it. The leading setups are
    also simulated with drawn parameters, and the largest difference from the linear effects is printed. The page of the
    study is rewritten.

    \b
    Example:
      eightpost study robust out/ uncertain.toml --set top=20
    """
    from cosim.study.verdict import study_verdict
    from eightpost.api.study_folder import CERTAINTY, SPREADS
    from eightpost.app.show import show_files, show_text, show_verdict

    console = Console()
    study = saved(console, folder, workers)
    certainty, check = study.robust(uncertain, top=top, criterion=rank, draws=draws, seed=seed)
    show_certainty(console, study.result, certainty)
    if check is not None:
        show_text(console, check.summary())
    show_verdict(console, study_verdict(study.result, certainty).about("choice", "rig runs"))
    show_files(console, [folder / CERTAINTY, folder / SPREADS, study.write_page()])
