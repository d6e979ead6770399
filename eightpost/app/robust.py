"""`eightpost robust`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.certainty import measured_noise, show_certainty, with_runs
from eightpost.app.options import FilePath, argument, setting, verb
from eightpost.app.progress import bar, each
from eightpost.errors import FileFormatError, InputError
from eightpost.outputs import replacing
from eightpost.workers.process import usable_processors

if TYPE_CHECKING:
    from cosim.study.choice.files import Uncertainty
    from cosim.study.choice.robust import Draws
    from cosim.study.result import StudyResult
    from cosim.study.running.workers import Workers


@verb
def robust(
    folder: Path = argument("STUDY", kind=FilePath()),
    uncertain: Path = argument("UNCERTAIN", kind=FilePath()),
    rank: str | None = setting("Measure that ranks the setups, smallest first; default: the objective of the study."),
    top: int = setting(
        "Number of leading setups that are simulated with drawn parameters; the baseline is added.",
        kind=click.IntRange(min=2),
        default=20,
    ),
    draws: int = setting(
        "Number of simulated draws of the uncertain parameters, which check the linear effects; 0: no check.",
        kind=click.IntRange(min=0),
        default=32,
    ),
    seed: int = setting("Seed of the simulated draws.", kind=click.IntRange(min=0), default=0),
    workers: int | None = setting(
        "Number of processes that run setups; default: one per processor.", kind=click.IntRange(min=1)
    ),
) -> None:
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
    from cosim.study.certainty import write_certainty
    from cosim.study.certainty.assess import certainty_of
    from cosim.study.choice.files import read_uncertainty, write_spreads
    from cosim.study.choice.robust import knowledge_of, leading, linearity_check, spreads_of
    from cosim.study.folder import CERTAINTY, RESULTS, SPREADS
    from cosim.study.result import StudyResult
    from cosim.study.running.workers import ProcessWorkers
    from cosim.study.verdict import study_verdict
    from eightpost.app.show import show_verdict, write_page

    console = Console()
    result = StudyResult.load(folder / RESULTS)
    stated = read_uncertainty(uncertain, result)
    plan = _plan(console, stated, draws, seed)
    if not plan.any and not any(stated.run_to_run.values()):
        raise InputError(f"{uncertain}: no uncertainty is stated; add fits, uncertain, vehicles or run_to_run")
    noise = {**measured_noise(folder), **stated.run_to_run}
    setups = leading(result, top, rank).tolist()
    pool = ProcessWorkers(workers or usable_processors())
    try:
        with bar(console, "uncertain parameters", 1) as advance:
            known = knowledge_of(result, plan, noise, folder, pool, advance)
        drawn = _drawn(console, result, folder, plan, setups, pool)
    finally:
        pool.close()
    known = with_runs(console, known, result, folder)
    certainty = certainty_of(result, known, criterion=rank)
    with replacing(folder / CERTAINTY):
        write_certainty(certainty, folder / CERTAINTY)
    show_certainty(console, result, certainty)
    spreads = spreads_of(result, drawn, stated.run_to_run, runs=stated.runs)
    check = linearity_check(result, known, spreads)
    if check is not None:
        console.print(check.summary(), highlight=False, soft_wrap=True)
    show_verdict(console, study_verdict(result, certainty).about("choice", "rig runs"))
    write_spreads(tuple(s.only(setups) for s in spreads), folder / SPREADS, digest=result.provenance.digest)
    console.print(f"wrote {folder / CERTAINTY} and {SPREADS}", highlight=False, soft_wrap=True)
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
            what = "states no uncertainty of the shock, or was edited after the fit; fit it with `eightpost fit`"
            raise FileFormatError(what, path=path)
        parts.append(Uncertain(build, fit.names, fit.values, fit.covariance, fit.lowest, fit.highest, fit.left_out))
        for note in fit.held:
            console.print(f"[yellow]note[/] {escape(f'{build}: {note}')}", highlight=False, soft_wrap=True)
    for part in parts:
        spread = zip(part.names, part.values, part.deviations, strict=True)
        text = ", ".join(f"{name} {value:.4g} ± {deviation:.2g}" for name, value, deviation in spread)
        console.print(f"{escape(part.part)}: {text}", highlight=False, soft_wrap=True)
    for vehicle in known.vehicles:
        console.print(f"alternative vehicle: {vehicle}", highlight=False, soft_wrap=True)
    return Draws(tuple(parts), draws, seed, known.vehicles)


def _drawn(
    console: Console, result: StudyResult, folder: Path, plan: Draws, setups: list[int], pool: Workers
) -> tuple[StudyResult, ...]:
    """Return the leading setups with drawn parameters; none if nothing is drawn."""
    from cosim.study.choice.robust import run_draws

    if not plan.any or plan.count < 2:
        return ()
    return tuple(each(console, run_draws(result, folder, pool, plan, setups), "draws", plan.count))
