"""`eightpost study` and its verbs `optimise`, `whatif`, `sensitivity` and `robust`."""

from __future__ import annotations

import re
import signal
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost import completion
from eightpost.app.exchange import build_with_progress
from eightpost.app.options import (
    RANK,
    WORKERS,
    FilePath,
    OutputFile,
    OutputFolder,
    Quantity,
    argument,
    check_outputs,
    check_report_folder,
    option,
    setting,
    verb,
)
from eightpost.app.show import (
    ConsoleListener,
    details,
    is_detailed,
    show_files,
    show_notes,
    show_table,
    show_text,
    show_verdict,
)
from eightpost.outputs import PAGE, TABLE
from eightpost.report.console import Table, console_table, unbroken

if TYPE_CHECKING:
    from cosim.study.choice.certainty import Certainty
    from cosim.study.choice.optimise import Optimum
    from cosim.study.choice.sensitivity import MeasureChange, Sensitivity
    from cosim.study.definition import Study
    from cosim.study.running.sweep import Sweep
    from cosim.study.table import StudyResult
    from eightpost.api.study_folder import StudyFolder

#: Time after which a silent worker is ended [s].
PATIENCE = 300.0

#: Files that the commands of a study write into its folder.
FILES = {"results.parquet": TABLE, "certainty.parquet": TABLE, "report.html": PAGE}

#: Number of measures in the ranking, and of setups without -v.
_SHOWN, _BEST = 3, 2


@verb
def study(
    ctx: click.Context,
    study_file: Path = argument("STUDY", kind=FilePath()),
    output: Path = option(
        "Output folder for results.parquet, the report and the intermediate results.",
        "-o", "--output", kind=OutputFolder(FILES), default=Path("out"),
    ),
    workers: int | str | None = WORKERS,
    rank: str | None = RANK,
    traced: tuple[int, ...] = option(
        "Setup whose time traces are written to traces/NUMBER.parquet; it is run again. May be repeated.",
        "--trace", metavar="NUMBER",
    ),
    sure: bool = setting(
        "Compute how sure the choice is: intervals, ties, probability of being best. This runs some setups again with "
        "changed shocks.",
        "certainty", default=True,
    ),
    patience: float = setting(
        "Time after which a worker that is not responding is ended and its setup marked as failed; on a cluster, time "
        "without any worker after which the study stops.",
        kind=Quantity("s", positive=True), default=f"{PATIENCE:g} s",
    ),
    top: int = setting("Number of rows of the printed ranking.", kind=click.IntRange(min=1), default=10),
) -> None:  # fmt: skip
    """Run every setup of shocks that a study allows, and rank them.

    STUDY is a TOML file with a vehicle, a bank of shocks, the builds allowed at each corner, drive files, measures,
    objective and constraints; examples/study.toml is an example with comments. FMUs of shock files and vehicle files
    are built first.

    A study resumes when it is started again with the same folder, on this machine or on a cluster; no option is needed.
    Completed setups are stored in OUTPUT/chunks every few seconds, each file as a whole or not at all, so that even
    kill -9 loses only the setups that were running. None of the others is run again, and none is in the table twice.
    Ctrl-C (or SIGTERM) lets the running setups finish and writes a table that is marked as partial. If FMUs, drive
    files, parameters, measures, settings or the version have changed, all setups run again; name, objective and
    constraints may change. To start over, delete OUTPUT/chunks.

    The exit code is 1 if the study was stopped or setups failed, and 2 if the study cannot be run as it is.

    \b
    Examples:
      eightpost study examples/study.toml -o out/
      eightpost study examples/study.toml -o out/ --rank "front ride height, RMS"
      eightpost study examples/study.toml -o out/ --trace 1200
    """
    console = Console()
    _stop_at_sigterm()
    folder = opened(console, study_file, output, workers, patience)
    if rank is not None:
        folder.study.measure(rank)
    for index in traced:
        folder.study.space.setup(index)
    begin(console, folder)
    result = folder.run(criterion=rank, certainty=sure)
    show_result(console, result, result.certainty, rank=rank, top=top)
    traces = [path for _, path in folder.write_traces(traced)]
    page = folder.write_page(trace_command=f"eightpost study {study_file} -o {output} --trace {{setup}}")
    show_files(console, [*traces, folder.sweep.path, page])
    stopped = result.partial or (sure and result.certainty is None and result.done.any())
    ctx.exit(0 if not stopped and result.done.all() and result.verdict.is_acceptable else 1)


def _stop_at_sigterm() -> None:
    """Treat SIGTERM as Ctrl-C: job schedulers and containers send it some time before they kill a process."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a shell script
        signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, lambda _number, _frame: signal.raise_signal(signal.SIGINT))


def opened(
    console: Console,
    study_file: Path,
    output: Path,
    workers: int | str | None,
    patience: float = PATIENCE,
) -> StudyFolder:
    """Return the study of a file with its output folder; FMUs of its shock and vehicle files are built."""
    from eightpost.api.study_folder import StudyFolder
    from eightpost.units import state

    check_report_folder(output, "study")
    folder = StudyFolder(
        output,
        study_file,
        workers=workers if isinstance(workers, int) else None,
        scheduler=workers if isinstance(workers, str) else None,
        patience=patience,
        listener=ConsoleListener(console),
        build=partial(build_with_progress, console),
    )
    state(folder.study.units)
    return folder


def saved(console: Console, folder: Path, workers: int | None = None) -> StudyFolder:
    """Return the study of a folder that `eightpost study` wrote."""
    from eightpost.api.study_folder import StudyFolder
    from eightpost.units import state

    study = StudyFolder(folder, workers=workers, listener=ConsoleListener(console))
    state(study.study.units)
    return study


def begin(console: Console, folder: StudyFolder, plan: str = "") -> None:
    """Check a study and its outputs, print what it asks for, and mark its folder before it computes."""
    sweep = folder.sweep
    check_outputs()  # the files that the study names are now known
    show_study(console, sweep, plan)
    completion.begin(folder.path)


def show_study(console: Console, sweep: Sweep, plan: str = "") -> None:
    """Print the size of a study, and what is to be run (by default, all that is left); with -v, its settings."""
    read, more = sweep.study, details(console)
    total, plan = len(read.space), plan or f"{sweep.left} to be run"
    show_text(console, f"{total} setups, {plan}: {read.name}", style="bold", lines=1)
    show_text(more, f"vehicle {read.vehicle.fmu}; means {_trust(read)}")
    show_text(more, f"bank of {len(read.bank)}: {', '.join(read.bank)}")
    for corner, builds in read.corners.items():
        if set(builds) != set(read.bank):
            show_text(more, f"{corner} allows {', '.join(builds)}")
    for group in read.alike:
        show_text(more, f"alike: {', '.join(group)}")
    for drive in read.drives:
        by = f" by its {', '.join(drive.targets)}" if drive.targets else ""
        show_text(
            more, f"drive {drive.name}: {drive.file}{by}, {drive.start:g} to {drive.start + drive.stop:g} s; the "
            f"first {read.settling:g} s are left out of every measure",
        )  # fmt: skip
    show_text(more, f"{len(read.measures)} measures; RMS values are about the mean")


def _trust(read: Study) -> str:
    return "are trusted" if read.vehicle.means_trusted else "are not trusted: measures that depend on them are left out"


def show_result(
    console: Console,
    result: StudyResult,
    certainty: Certainty | None = None,
    *,
    rank: str | None = None,
    top: int = 10,
) -> None:
    """Print the ranking, how sure it is, and the setups that failed or have a mark."""
    from cosim.study.verdict import study_verdict

    rows, most = result.ranking(rank), top if is_detailed() else min(top, _BEST)
    table = _ranking(result, rows[:most].tolist(), rank, is_brief=not is_detailed())
    show_table(console, table, most=most + 1)
    more = details(console)
    if result.infeasible:
        show_text(more, f"{result.infeasible} setups violate a constraint and are not ranked")
    _show_failed(console, result)
    _show_marks(more, result)
    error = result.worst_coupling_error
    worst = "" if error is None else f"; coupling error up to {error:.2g} %"
    show_text(more, f"{len(result)} setups, {result.seconds:.1f} s of worker time{worst}")
    if result.partial:
        show_text(console, "partial: run it again with the same folder to resume", style="yellow")
    if certainty is not None:
        show_certainty(console, result, certainty)
    show_verdict(console, study_verdict(result, certainty))


def show_certainty(console: Console, result: StudyResult, certainty: Certainty) -> None:
    """Print which setup is most probably the best, and what to test next; with -v, the whole summary."""
    from cosim.study.choice.certainty import summary_lines

    for place, line in enumerate(summary_lines(result, certainty)):
        style = "bold" if place == 0 else ""
        if is_detailed():
            show_text(console, line, style=style)
        elif place == 0 or line.startswith("test next"):
            show_text(console, without_builds(line), style=style, lines=1)


def without_builds(line: str) -> str:
    """Return a line of a certainty's summary without what is in parentheses: the table of setups has the builds."""
    return re.sub(r" \([a-z]+ [^)]*\)", "", line)


def _ranking(result: StudyResult, rows: list[int], rank: str | None, *, is_brief: bool = False) -> Table:
    """Return the table of the ranking, with the baseline in the last row; a brief one has no further measures."""
    objective = result.objective if rank is None else None
    shown = [rank] if rank else result.study.named_measures[:_SHOWN]
    shown = shown if rank or not is_brief else shown[: 0 if objective is not None else 1]
    titles = [escape(f"{name} [{result.display(name)}]") for name in shown]
    objectives = ["objective"] if objective is not None else []
    columns = ["", "setup", *unbroken(" ".join(result.study.corners)), *objectives, *titles]
    lines = []
    baseline = result.baseline_row
    places = [(str(place), row) for place, row in enumerate(rows, start=1)]
    places += [("base", baseline)] if baseline is not None and result.done[baseline] else []
    for place, row in places:
        values = [] if objective is None else [f"{objective[row]:.4g}"]
        values += [f"{result.shown(name)[row]:.4g}" for name in shown]
        lines.append((place, str(result.setups[row]), " ".join(result.setup(row).builds.values()), *values))
    return console_table(columns, lines)


def _show_failed(console: Console, result: StudyResult) -> None:
    show_notes(console, (f"{setup}: {message}" for setup, message in result.failures), "failed setup")


def _show_marks(console: Console, result: StudyResult) -> None:
    """Print how many setups have each kind of mark."""
    for kind in ("beyond its fitted velocities", "tire off the ground", "coupling"):
        if count := result.marked(kind):
            show_text(console, f"marked {count} setups: {kind}; see column marks")


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
    evaluations: int = setting("Maximum number of setups to evaluate.", kind=click.IntRange(min=2), default=400),
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

    console = Console()
    folder, search = opened(console, study_file, output, workers), Search(objectives, evaluations, seed)
    for name in objectives:
        folder.study.measure(name)
    begin(console, folder, f"at most {evaluations} to be evaluated")
    show_text(console, f"minimised: {objectives_in_words(folder.study, search)}")
    result, optimum = folder.optimise(search)
    show_result(console, result, rank=objectives[0] if objectives else None)
    if len(objectives) > 1:
        show_table(console, _front_table(result, optimum, objectives), most=2)
    show_text(console, f"{optimum.status}; the study has {len(folder.study.space)} setups")
    show_files(console, [folder.sweep.path, folder.write_page()])
    ctx.exit(0 if optimum.best is not None else 1)


def _front_table(result: StudyResult, optimum: Optimum, objectives: tuple[str, ...]) -> Table:
    """Return a table of the Pareto front, sorted by the first measure."""
    titles = [escape(f"{name} [{result.display(name)}]") for name in objectives]
    columns = ["setup", *unbroken(" ".join(result.study.corners)), *titles]
    lines = []
    for row in result.rows_of(optimum.front, objectives[0]).tolist():
        values = [f"{result.shown(name)[row]:.4g}" for name in objectives]
        lines.append((str(result.setups[row]), " ".join(result.setup(row).builds.values()), *values))
    return console_table(columns, lines, title="Pareto front")


@verb
def whatif(
    folder: Path = argument("STUDY", kind=FilePath()),
    corners: tuple[str, ...] = option(
        "Corner whose shock changes, e.g. lr; may be repeated.", "--at", default=..., metavar="CORNER"
    ),
    rebound: int = option("Clicks of the rebound adjuster, e.g. +1; default: 0.", default=0, metavar="CLICKS"),
    compression: int = option("Clicks of the compression adjuster, e.g. -2; default: 0.", default=0, metavar="CLICKS"),
    setup: int | None = setting("Number of the setup to change; default: the baseline, or else the best setup."),
    share: float = setting(
        "Change of the slope that counts as a click, for shocks without a fitted adjuster.",
        "click", kind=Quantity("1", positive=True), default="5 %",
    ),
    speeds: str = setting(
        "Speeds at which the slope changes, for shocks without a fitted adjuster; low and high overlap near 0.1 m/s.",
        kind=("low", "high", "all"), default="low",
    ),
    workers: int | None = setting("Number of processes that run setups; default: 1.", kind=click.IntRange(min=1)),
) -> None:  # fmt: skip
    """Show what a click more or less at a corner would do to every measure of a study.

    STUDY is a folder that `eightpost study` wrote. The setup is run with and without the change. A shock that was
    fitted over its adjusters (docs/how_to/settings.md) changes its setting, counted as in its file; for others a click
    changes the slope of the curve on that side by a stated share, and + is stiffer. Changes that are within the
    coupling error of a run are in brackets.

    \b
    Examples:
      eightpost study whatif out/ --at lr --rebound +1
      eightpost study whatif out/ --at lf --at rf --compression -2 --set click='10 %' --set speeds=high
    """
    clicks = {side: count for side, count in (("rebound", rebound), ("compression", compression)) if count}
    study = saved(console := Console(), folder, workers)
    show_table(console, _effect_table(study.what_if(corners, clicks, share=share, speeds=speeds, setup=setup)))


def _effect_table(effects: Sequence[MeasureChange]) -> Table:
    """Return a table of effects; a change that is within the coupling error is in brackets."""
    rows = []
    for one in effects:
        change = f"{one.change:+.3g}"
        relative = "" if one.before == 0.0 else f"{100.0 * one.relative:+.2f} %"
        shown = (change, relative) if one.is_clear else (f"({change})", f"({relative})" if relative else "")
        name = f"{one.measure} [{one.unit}]" if one.unit else one.measure
        rows.append((escape(name), f"{one.before:.5g}", f"{one.after:.5g}", *shown, f"{one.noise:.1g}"))
    return console_table(["measure", "before", "after", "change", "relative", "coupling error"], rows)


@verb
def sensitivity(
    folder: Path = argument("STUDY", kind=FilePath()),
    output: Path = option(
        "Output table of all terms (.parquet); default: sensitivity.parquet in the folder of the study.",
        "-o", "--output", kind=OutputFile(TABLE, default=lambda given: given["folder"] / "sensitivity.parquet"),
    ),
) -> None:  # fmt: skip
    """Show which corner matters for which measure of a study: main effects and first-order interactions.

    STUDY is a folder that `eightpost study` wrote. The table shows shares of each measure's variance over all setups.
    The shares are exact if every setup was run; if setups are missing, they are fitted by least squares.

    \b
    Example:
      eightpost study sensitivity out/
    """
    console = Console()
    study = saved(console, folder)
    results = study.sensitivity(output)
    show_text(console, f"{study.study.name}: {len(study.result)} setups, {results[0].method}")
    show_table(console, _share_table(results))
    show_files(console, [output])


def _share_table(results: Sequence[Sensitivity]) -> Table:
    """Return a table of shares of the variance [%]: corners, interactions and the rest, a row for each measure."""
    names = [factor.name for factor in results[0].factors]
    rows = []
    for one in results:
        pairs = {pair: one.share(*pair) for pair in one.pairs}
        largest = max(pairs, key=lambda pair: pairs[pair], default=None)
        strongest = "" if largest is None else f"{' x '.join(largest)} {_percent(pairs[largest])}"
        shares = [_percent(one.share(name)) for name in names]
        others = (_percent(sum(pairs.values())), strongest, _percent(one.rest_share))
        rows.append((escape(one.measure), *shares, *others))
    return console_table(["% of the variance", *names, "all interactions", "largest", "rest"], rows)


def _percent(share: float) -> str:
    from eightpost.units import convert

    return f"{convert(share, '1', '%'):.1f}"


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
        "Number of processes that run setups; default: one per processor.", kind=click.IntRange(min=1)
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

    console = Console()
    study = saved(console, folder, workers)
    certainty, check = study.robust(uncertain, top=top, criterion=rank, draws=draws, seed=seed)
    show_certainty(console, study.result, certainty)
    if check is not None:
        show_text(console, check.summary())
    show_verdict(console, study_verdict(study.result, certainty).about("choice", "rig runs"))
    show_files(console, [folder / CERTAINTY, folder / SPREADS, study.write_page()])
