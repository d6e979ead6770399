"""`eightpost robust`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import RANK, WORKERS, seed_option
from eightpost.app.progress import each
from eightpost.errors import FileFormatError, InputError
from eightpost.report.console import Table, console_table
from eightpost.workers.process import usable_processors

if TYPE_CHECKING:
    from cosim.study.choice.robust import Draws, Spread
    from cosim.study.choice.robust_file import Uncertainty
    from cosim.study.result import StudyResult


@click.command()
@click.argument("folder", metavar="STUDY", type=click.Path(path_type=Path))
@click.argument("uncertain", metavar="UNCERTAIN", type=click.Path(path_type=Path))
@click.option("--top", type=click.IntRange(min=2), metavar="N", default=20, show_default=True,
              help="Number of leading setups to compare; the baseline is added.")  # fmt: skip
@RANK
@click.option("--draws", type=click.IntRange(min=2), metavar="N", default=32, show_default=True,
              help="Number of draws of the uncertain parameters.")  # fmt: skip
@seed_option(0, "Seed of the draws.")
@WORKERS
def robust(
    folder: Path, uncertain: Path, top: int, rank: str | None, draws: int, seed: int, workers: int | None
) -> None:
    """Show which of a study's best setups differ by more than the stated uncertainty.

    STUDY is a folder that `eightpost study` wrote. UNCERTAIN is a TOML file that states what is not known exactly:
    fitted shocks, parameters, other vehicles, and the difference between two runs on the rig (docs/study_choice.md).
    Every setup is run with every draw, so that errors common to all setups cancel. Setups that differ by less than two
    standard deviations are a tie. The page of the study is rewritten and shows the confidence intervals.

    \b
    Example:
      eightpost robust out/ uncertain.toml --top 20
    """
    from cosim.study.choice.robust import OBJECTIVE, leading, robust_verdict, spreads_of
    from cosim.study.choice.robust_file import read_uncertainty, write_spreads
    from cosim.study.folder import RESULTS, SPREADS
    from cosim.study.result import StudyResult
    from eightpost.app.show import show_verdict, write_page

    console = Console()
    result = StudyResult.load(folder / RESULTS)
    known = read_uncertainty(uncertain, result)
    plan = _plan(console, known, draws, seed)
    setups = leading(result, top, rank).tolist()
    if not plan.any and not any(known.run_to_run.values()):
        raise InputError(f"{uncertain}: no uncertainty is stated; add fits, uncertain, vehicles or run_to_run")
    spreads = spreads_of(
        result, _run(console, result, folder, plan, setups, workers), known.run_to_run, runs=known.runs
    )
    kept = tuple(spread.only(setups) for spread in spreads)
    first = rank or (OBJECTIVE if result.study.objective else result.measures[0].name)
    shown = next(spread for spread in kept if spread.measure == first)
    console.print(spread_table(shown, result))
    show_choice(console, shown, result)
    show_verdict(console, robust_verdict(shown, len(result)))
    write_spreads(kept, folder / SPREADS, digest=result.provenance.digest)
    console.print(f"wrote {folder / SPREADS}", highlight=False, soft_wrap=True)
    write_page(console, result, folder)


def _plan(console: Console, known: Uncertainty, draws: int, seed: int) -> Draws:
    """Add the uncertainty of the fits to that of the file, and print all distributions."""
    from cosim.study.choice.robust import Draws, Uncertain
    from eightpost.shock import read_shock
    from eightpost.shock.fit_uncertainty import fitted_parameters

    parts = list(known.parts)
    for build, path in known.fits.items():
        fit = fitted_parameters(read_shock(path))
        if fit is None:
            raise FileFormatError("states no uncertainty of the shock; fit it with `eightpost fit`", path=path)
        parts.append(Uncertain(build, fit.names, fit.values, fit.covariance, fit.lowest, fit.highest))
        for note in fit.held:
            console.print(f"[yellow]note[/] {escape(f'{build}: {note}')}", highlight=False, soft_wrap=True)
    for part in parts:
        spread = zip(part.names, part.values, part.deviations, strict=True)
        text = ", ".join(f"{name} {value:.4g} ± {deviation:.2g}" for name, value, deviation in spread)
        console.print(f"{escape(part.part)}: {text}", highlight=False, soft_wrap=True)
    for vehicle in known.vehicles:
        console.print(f"alternative vehicle: {vehicle}", highlight=False, soft_wrap=True)
    return Draws(tuple(parts), draws, seed, known.vehicles)


def _run(
    console: Console, result: StudyResult, folder: Path, plan: Draws, setups: list[int], workers: int | None
) -> tuple[StudyResult, ...]:
    from cosim.study.choice.robust import run_draws
    from cosim.study.running.workers import ProcessWorkers

    if not plan.any:
        return ()
    pool = ProcessWorkers(workers or usable_processors())
    try:
        drawn = run_draws(result, folder, pool, plan, setups)
        return tuple(each(console, drawn, "draws", plan.count))
    finally:
        pool.close()


def spread_table(spread: Spread, result: StudyResult) -> Table:
    """Return a table of setups in groups of ties, best first: no member differs significantly from the first."""
    from cosim.study.choice.robust import REACH

    unit, shown = _shown(spread.measure, result)
    sigma = f"± {REACH:g} sigma"
    groups = []
    for number, group in enumerate(spread.groups(), start=1):
        rows = []
        for row, levels in zip(group.tolist(), spread.compared(group).tolist(), strict=True):
            setup = result.study.space.setup(int(spread.setups[row]))
            cells = [f"{shown(level):.4g}" for level in levels]
            rows.append((str(number), str(setup.index), *setup.builds.values(), *cells))
        groups.append(rows)
    columns = (escape(f"{spread.measure} [{unit}]"), sigma, "difference from the group's first", sigma)
    return console_table(["group", "setup", *result.study.corners, *columns], *groups)


def show_choice(console: Console, spread: Spread, result: StudyResult) -> None:
    """Print the best setup, and whether it is better than the baseline by more than the stated uncertainty."""
    group = spread.groups()[0]
    best = result.study.space.setup(int(spread.setups[group[0]]))
    console.print(f"best setup of the first group: {best.index} ({best})", highlight=False, soft_wrap=True)
    baseline = result.study.baseline_setup
    rows = [] if baseline is None else [row for row, n in enumerate(spread.setups.tolist()) if n == baseline.index]
    for row in rows:
        relation = "better than" if spread.worse_than(int(group[0]))[row] else "a tie with"
        console.print(f"it is {relation} the baseline, within the stated uncertainty", highlight=False)


def _shown(measure: str, result: StudyResult) -> tuple[str, Callable[[float], float]]:
    """Return the display unit of a measure, and the conversion of a difference from SI to it."""
    from cosim.study.choice.robust import OBJECTIVE

    if measure == OBJECTIVE:
        return "1", float
    return result.display(measure), partial(result.shown_difference, measure)
