"""`eightpost study optimise`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import (
    WORKERS,
    FilePath,
    OutputFolder,
    argument,
    option,
    setting,
    verb,
)
from eightpost.app.study import FILES, begin, opened, show_result
from eightpost.report.console import Table, console_table, unbroken

if TYPE_CHECKING:
    from cosim.study.choice.optimise import Optimum
    from cosim.study.table import StudyResult


@verb
def optimise(
    ctx: click.Context,
    /,
    study_file: Path = argument("STUDY", kind=FilePath()),
    output: Path = option(
        "Output folder for results.parquet, the page and the intermediate results.",
        "-o", "--output", kind=OutputFolder(FILES), default=Path("out"),
    ),
    objectives: tuple[str, ...] = option(
        "Measure to minimise; repeat it for the Pareto front of several. Default: the objective of the study.",
        "--for", metavar="MEASURE",
    ),
    evaluations: int = option(
        "Maximum number of setups to evaluate.",
        kind=click.IntRange(min=2), default=400, metavar="N",
    ),
    workers: int | str | None = WORKERS,
    seed: int = setting("Seed of the search.", kind=click.IntRange(min=0), default=0),
) -> None:  # fmt: skip
    """Search for the best setups of a study whose bank is too large to run them all.

    STUDY is the TOML file of `eightpost study`. Setups are evaluated in generations, each setup once. The same seed
    gives the same search. A stopped search resumes where it stopped, also with a larger number of evaluations. Needs
    pymoo (eightpost[optimise]). The exit code is 1 if no evaluated setup meets the constraints.

    \b
    Examples:
      eightpost study optimise examples/study.toml -o out/
      eightpost study optimise examples/study.toml -o out/ --for "front ride height, RMS" --for "total tire force, RMS"
    """
    from cosim.study.choice.optimise import Search, objectives_in_words
    from eightpost.app.show import show_files, show_table, show_text

    console = Console()
    folder, search = opened(console, study_file, output, workers), Search(objectives, evaluations, seed)
    for name in objectives:
        folder.study.measure(name)
    begin(console, folder, f"at most {evaluations} to be evaluated")
    show_text(console, f"minimised: {objectives_in_words(folder.study, search)}")
    result, optimum = folder.optimise(search)
    show_result(console, result, rank=objectives[0] if objectives else None)
    if len(objectives) > 1:
        show_table(console, front_table(result, optimum, objectives), most=2)
    show_text(console, f"{optimum.status}; the study has {len(folder.study.space)} setups")
    show_files(console, [folder.sweep.path, folder.write_page()])
    ctx.exit(0 if optimum.best is not None else 1)


def front_table(result: StudyResult, optimum: Optimum, objectives: tuple[str, ...]) -> Table:
    """Return a table of the Pareto front, sorted by the first measure."""
    titles = [escape(f"{name} [{result.display(name)}]") for name in objectives]
    columns = ["setup", *unbroken(" ".join(result.study.corners)), *titles]
    lines = []
    for row in result.rows_of(optimum.front, objectives[0]).tolist():
        values = [f"{result.shown(name)[row]:.4g}" for name in objectives]
        lines.append((str(result.setups[row]), " ".join(result.setup(row).builds.values()), *values))
    return console_table(columns, lines, title="Pareto front")
