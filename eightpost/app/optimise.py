"""`eightpost optimise`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost import completion
from eightpost.app.options import (
    WORKERS,
    FilePath,
    OutputFolder,
    argument,
    check_outputs,
    check_report_folder,
    option,
    setting,
    verb,
)
from eightpost.app.progress import bar
from eightpost.app.study import FILES, read_with_fmus, running_workers, show_coupling, show_result, show_study
from eightpost.report.console import Table, console_table, unbroken

if TYPE_CHECKING:
    from cosim.study.choice.optimise import Optimum, Search
    from cosim.study.result import StudyResult
    from cosim.study.running.sweep import Requested
    from cosim.study.running.workers import Workers


@verb
def optimise(
    ctx: click.Context,
    /,
    study_file: Path = argument("STUDY", kind=FilePath()),
    output: Path = option(
        "Output folder for results.parquet, the page and the intermediate results.",
        "-o",
        "--output",
        kind=OutputFolder(FILES),
        default=Path("out"),
    ),
    objectives: tuple[str, ...] = option(
        "Measure to minimise; repeat it for the Pareto front of several. Default: the objective of the study.",
        "--for",
        metavar="MEASURE",
    ),
    evaluations: int = option(
        "Maximum number of setups to evaluate.", kind=click.IntRange(min=2), default=400, metavar="N"
    ),
    workers: int | str | None = WORKERS,
    seed: int = setting("Seed of the search.", kind=click.IntRange(min=0), default=0),
) -> None:
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
    from cosim.study.folder import RESULTS
    from cosim.study.running.sweep import Requested
    from eightpost.app.show import write_page

    console = Console()
    check_report_folder(output, "study")
    described = read_with_fmus(console, study_file, output)
    for name in objectives:
        described.measure(name)
    requested, search = Requested(described, output), Search(objectives, evaluations, seed)
    check_outputs()  # the files that the study names are now known
    show_study(console, requested, f"at most {evaluations} to be evaluated")
    console.print(f"minimised: {escape(objectives_in_words(described, search))}", highlight=False, soft_wrap=True)
    completion.begin(output)
    with running_workers(workers) as pool:
        result, optimum = _search(console, requested, pool, search)
        coupling = requested.coupling(pool)
        compared = requested.compare_best(requested.everything(coupling), coupling)
        if compared.machine is None and coupling.machine is not None:
            result, optimum = _search(console, requested, pool, search)
        everything = requested.everything(compared)
    everything.save(output / RESULTS)
    show_result(console, replace(result, partial=False), rank=objectives[0] if objectives else None)
    if len(objectives) > 1:
        console.print(front_table(result, optimum, objectives))
    console.print(f"{escape(optimum.status)}; the study has {len(described.space)} setups", highlight=False)
    console.print(f"table: {output / RESULTS}", highlight=False, soft_wrap=True)
    write_page(console, everything, output)
    ctx.exit(0 if optimum.best is not None else 1)


def _search(console: Console, requested: Requested, pool: Workers, search: Search) -> tuple[StudyResult, Optimum]:
    from cosim.study.choice.optimise import search_study

    with console.status("choosing the coupling step"):
        coupling = requested.coupling(pool)
    show_coupling(console, coupling, requested.study)
    with bar(console, "setups", search.evaluations) as advance:
        return search_study(requested, pool, coupling, search, advance)


def front_table(result: StudyResult, optimum: Optimum, objectives: tuple[str, ...]) -> Table:
    """Return a table of the Pareto front, sorted by the first measure."""
    titles = [escape(f"{name} [{result.display(name)}]") for name in objectives]
    columns = ["setup", *unbroken(" ".join(result.study.corners)), *titles]
    lines = []
    for row in result.rows_of(optimum.front, objectives[0]).tolist():
        values = [f"{result.shown(name)[row]:.4g}" for name in objectives]
        lines.append((str(result.setups[row]), " ".join(result.setup(row).builds.values()), *values))
    return console_table(columns, lines, title="Pareto front")
