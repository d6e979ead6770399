"""Verbs of a study for hardware: `select`, `confirm` and `compare` on the rig; `shapes` and `clicks` of shocks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost import completion
from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import (
    WORKERS,
    Assignment,
    FilePath,
    Number,
    OutputFile,
    OutputFolder,
    Quantity,
    argument,
    group,
    option,
    setting,
    verb,
)
from eightpost.app.show import details, show_files, show_notes, show_table, show_text, show_verdict
from eightpost.app.study import FILES, begin, opened, saved, show_certainty
from eightpost.errors import InputError
from eightpost.outputs import AIM, PAGE, PICTURE
from eightpost.report.console import Table, console_table, folded, right, unbroken
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from cosim.study.choice.certainty import Certainty
    from cosim.study.choice.compare import Comparison, RunComparison
    from cosim.study.choice.rig_day import Selection
    from cosim.study.table import StudyResult
    from eightpost.api.shapes import Aim
    from eightpost.ident.shock.clicks import Level


TOTAL, POOL, TWICE = 20, 0.02, 4


@verb
def select(
    folder: Path = argument("STUDY", kind=FilePath()),
    measures: tuple[str, ...] = option(
        "Measure to confirm; may be repeated. COUNT is its number of low and of high setups. Default: the measures of "
        "the objective; without an objective, all.",
        "--measure", metavar="MEASURE[=COUNT]",
    ),
    total: int = option(
        "Total number of setups, if no COUNT is given; with COUNT, the proposed tests come in addition.",
        "-n", "--total", kind=click.IntRange(min=2), default=TOTAL, metavar="N",
    ),
    pool: float = setting(
        "Share of the setups at each end of a ranking to choose from, 0 to 1.", kind=Number(0.0, 1.0), default=POOL
    ),
    twice: int = setting(
        "Maximum number of extreme setups that are listed twice: drift from run to run moves them more than the "
        "baseline.",
        kind=click.IntRange(min=0), default=TWICE,
    ),
) -> None:  # fmt: skip
    """Select setups of a study to confirm on the rig: the tests that decide most about the best setup, then low and
    high setups of each measure, spread over the bank.

    STUDY is a folder that `eightpost study` wrote. The list selection.csv has a line for each run; second runs of
    extreme setups and the runs of the baseline come last: they show how far two runs of a setup differ. Save the rig
    records in the same folder, under the names in the column `file`; then `eightpost study compare --measured` reads
    them. The page of the study is rewritten and shows the selection.

    \b
    Examples:
      eightpost study select out/
      eightpost study select out/ --measure "front ride height, RMS=4" --measure "total tire force, RMS=4"
    """
    from cosim.study.choice.rig_day import BASELINE_RUNS, repeated
    from eightpost.api.study_folder import SELECTION

    console = Console()
    study = saved(console, folder)
    names, share = _measures_and_counts(measures)
    selection = study.select(names, total=total, share=share, pool=pool, twice=twice)
    show_table(console, _selection_table(selection, study.result))
    if marked := sum(bool(selected.marks) for selected in selection.chosen):
        show_text(console, f"* {marked} predictions have a mark: see the column marks of the list")
    show_text(console, f"any two setups differ at {selection.closest} or more corners")
    second = len(repeated(selection, twice))
    repeats = f", {second} of them twice" if second else ""
    repeats += f", and {BASELINE_RUNS} runs of the baseline" if study.study.baseline else ""
    show_text(console, f"selection.csv: {len(selection.chosen)} setups{repeats}")
    show_files(console, [folder / SELECTION, study.write_page()])


def _measures_and_counts(measures: tuple[str, ...]) -> tuple[tuple[str, ...], dict[str, int] | None]:
    """Return the measures, and the number of setups of each end by measure if counts are given."""
    counted = {name: count for name, equal, count in (m.rpartition("=") for m in measures) if equal}
    if not counted:
        return measures, None
    if len(counted) < len(measures) or not all(count.isdecimal() and int(count) for count in counted.values()):
        raise InputError("give every --measure a count, e.g. 'total tire force, RMS=4', or omit all counts")
    return tuple(counted), {name: int(count) for name, count in counted.items()}


def _selection_table(selection: Selection, result: StudyResult) -> Table:
    """Return a table of the selected setups, as Table 7.5; an asterisk means that the prediction has a mark."""
    from eightpost import units

    rows = []
    for number, selected in enumerate(selection.chosen, start=1):
        name = selected.measure
        value = units.convert(selected.value, result.unit(name), result.display(name))
        shown = f"{value:.4g} {result.display(name)}{'*' if selected.marks else ''}"
        builds = selected.setup.builds.values()
        rows.append((str(number), escape(name), selected.end, *builds, shown, str(selected.rank)))
    columns = ["", "measure", "", *unbroken(*result.study.corners), "predicted", *right("rank")]
    return console_table(columns, rows)


#: Number of setups in the table.
_SHOWN = 8


@verb
def confirm(
    ctx: click.Context,
    folder: Path = argument("STUDY", kind=FilePath()),
    records: tuple[str, ...] = argument("RECORDS..."),
    measures: tuple[str, ...] = option(
        "Measure to take into account; may be repeated. Default: all measures that do not depend on a mean.",
        "--measure", metavar="MEASURE",
    ),
    channels: Channels = CHANNELS,
) -> None:  # fmt: skip
    """Update how sure a study's choice is with rig runs of some of its setups.

    STUDY is a folder that `eightpost study` wrote. RECORDS is a list of rig runs, a CSV file that assigns a setup to
    each record, such as the selection.csv of `eightpost study select`; or one or more SETUP=FILE with the number of a
    setup and its record. The measured levels update the intervals of all setups, the ties and the next tests. Records
    that contradict the prediction are named; the exit code is then 1. The previous certainty is kept in
    certainty.previous.parquet.

    \b
    Examples:
      eightpost study confirm out/ rig_day/selection.csv
      eightpost study confirm out/ 37=run1.csv 120=run2.csv
    """
    from cosim.study.verdict import study_verdict
    from eightpost.api.study_folder import CERTAINTY, PREVIOUS

    console = Console()
    study = saved(console, folder)
    before, after = study.confirm(records, measures=measures, **channels.record_options)
    result, new = study.result, after.runs[len(before.runs) :]
    show_text(console, f"{len(new)} new runs of {len({run.setup for run in new})} setups; {len(after.runs)} in all")
    show_table(details(console), _before_and_after(result, before, after))
    show_certainty(console, result, after)
    _show_contradictions(console, result, after)
    show_verdict(console, study_verdict(result, after).about("choice", "rig runs"))
    show_files(console, [folder / CERTAINTY, study.write_page()], f"; the previous certainty is {PREVIOUS}")
    ctx.exit(1 if after.contradictions else 0)


def _before_and_after(result: StudyResult, before: Certainty, after: Certainty) -> Table:
    """Return a table of the leading setups: probability of being the best and level, before and after the rig runs."""
    setups = list(dict.fromkeys([*after.ties[:_SHOWN], *before.ties[:_SHOWN]]))[: 2 * _SHOWN]
    rows = []
    for setup in setups:
        cells = []
        for one in (before, after):
            cells += [f"{100.0 * one.probability(setup):.1f} %", _level(result, one, setup)]
        builds = " ".join(result.study.space.setup(setup).builds.values())
        rows.append((str(setup), builds, cells[0], cells[2], cells[1], cells[3]))
    unit = "" if after.criterion not in result.provenance.measure_units else f" [{result.display(after.criterion)}]"
    level = escape(f"{after.criterion}{unit}, 95 %")
    columns = right("best before", "best after", f"{level}, before", "after")
    return console_table(["setup", " ".join(result.study.corners), *columns], rows)


def _level(result: StudyResult, certainty: Certainty, setup: int) -> str:
    """Return the interval of the criterion of a setup, in the display unit."""
    from eightpost import units

    low, high = (end[certainty.row(setup)] for end in certainty.levels[certainty.criterion].interval(0.95))
    if math.isnan(low):
        return "unknown"
    name = certainty.criterion
    if name in result.provenance.measure_units:
        low, high = (float(units.convert(end, result.unit(name), result.display(name))) for end in (low, high))
    return f"{low:.4g} to {high:.4g}"


def _show_contradictions(console: Console, result: StudyResult, certainty: Certainty) -> None:
    """Print the measured levels that the prediction does not explain."""
    from cosim.study.choice.certainty import chance_text
    from eightpost import units

    texts = []
    for one in certainty.contradictions:
        own, unit = result.unit(one.measure), result.display(one.measure)
        measured, predicted = (units.convert(value, own, unit) for value in (one.measured, one.predicted))
        texts.append(
            f"{one.file}: {one.measure} of setup {one.setup} is "
            f"{measured:.4g} {unit}, predicted {predicted:.4g}; a deviation of this size has a probability of "
            f"{chance_text(one.probability)}; {'used, as other runs agree' if one.used else 'left out'}"
        )
    show_notes(console, texts, "contradiction", most=1)


#: Largest length of all labels of runs as headings of a table; longer ones are replaced by their numbers.
_LABELS = 30


@verb
def compare(
    ctx: click.Context,
    folders: tuple[Path, ...] = argument("RUN...", kind=FilePath()),
    output: Path | None = option(
        "Picture of the changes (.png, .pdf or .svg); default: none. With --measured: output folder; default: "
        "compared/ in the folder of the study.",
        "-o", "--output", kind=OutputFile(PICTURE, is_folder=lambda given: given["measured"] is not None),
    ),
    measured: Path | None = option(
        "List of rig runs to compare a study with: a CSV file that assigns a setup to each record, such as the "
        "selection.csv of `eightpost study select`, or its folder. Default: compare runs.",
        kind=FilePath(), metavar="LIST",
    ),
    measures: tuple[str, ...] = option(
        "Measure to compare with --measured; may be repeated. Default: all measures that do not depend on a mean.",
        "--measure", metavar="MEASURE",
    ),
    channels: Channels = CHANNELS,
    vehicle: str = setting("Name of the vehicle component whose channels give the ride measures.", default="car"),
    rank: float = setting(
        "Minimum acceptable rank correlation (Spearman) for --measured, -1 to 1.", kind=Number(-1.0, 1.0), default=0.8
    ),
    level: float | None = setting(
        "Maximum acceptable RMS error of the levels for --measured [%], e.g. 5; default: no limit.",
        kind=Number(min=0.0),
    ),
) -> None:  # fmt: skip
    """Compare runs, or a study's prediction with rig measurements.

    Without --measured, each RUN is a folder that `eightpost run` wrote. The response measures of all runs are listed
    side by side, with the change from the first run to the last. The settling time of each run is left out. Runs that
    lack the channels of the ride measures are compared channel by channel.

    With --measured, RUN is the folder of a study, and its prediction is compared with the rig measurements: trend, rank
    correlations, best-fit line and bands, as in Fig 7.7. The exit code is 1 if a measure misses the settings rank or
    level.

    \b
    Examples:
      eightpost study compare out out/swapped -o out/changes.png
      eightpost study compare out/ --measured rig_day/selection.csv
    """
    console = Console()
    if measured is None:
        verdict = _compare_runs(console, folders, vehicle, output)
    elif len(folders) == 1:
        study = saved(console, folders[0])
        entries, verdict, picture = study.compare(
            measured, output, measures=measures, rank=rank, level=level, **channels.record_options
        )
        show_table(console, _rank_table(entries))
        show_table(details(console), _level_table(entries, study.result))
        show_files(console, [picture, picture.with_name("comparison.json")])
    else:
        raise InputError(f"with --measured, compare takes the folder of one study, not {len(folders)} folders")
    show_verdict(console, verdict)
    ctx.exit(0 if verdict.is_acceptable else 1)


def _compare_runs(console: Console, folders: tuple[Path, ...], vehicle: str, output: Path | None) -> Verdict:
    from cosim.session.result import SavedRun
    from cosim.study.choice.compare import compare_runs

    saved = {str(folder): SavedRun.load(folder) for folder in folders}
    for number, (folder, run) in enumerate(saved.items(), start=1):
        show_text(console, f"run {number}: {folder}: {run.sources}", lines=1)
    compared = compare_runs(saved, vehicle)
    show_table(console, measure_table(compared))
    if output:
        compared.plot().save(output)
        show_files(console, [output])
    return compared.verdict


def _rank_table(entries: Sequence[Comparison]) -> Table:
    """Return a table of how the prediction ranks setups by each measure, and of its best-fit line."""
    rows = []
    for one in entries:
        low, high = one.line.interval()
        rows.append((
            escape(one.measure),
            f"{one.spearman:.3f}",
            f"{one.attainable:.3f}" if one.run_to_run else "",
            f"{one.kendall:.3f}",
            f"{one.line.slope:.2f} ({low:.2f} to {high:.2f})",
        ))  # fmt: skip
    columns = right("Spearman", "attainable", "Kendall", "slope (95 %)")
    return console_table([*folded("measure"), *columns], rows, title="Ranks and trend")


def _level_table(entries: Sequence[Comparison], result: StudyResult) -> Table:
    """Return a table of the errors of each measure's levels, and of the setups within bands and intervals."""
    rows = []
    for one in entries:
        unit = result.display(one.measure)
        sigma = f"{result.shown_difference(one.measure, one.run_to_run):.2g} {unit}"
        rows.append((
            escape(one.measure),
            f"{one.level_error:.1f} %",
            f"{one.bias:+.1f} %",
            sigma if one.run_to_run else "unknown",
            f"{int(one.within.sum())} of {one.within.size}",
            f"{int(one.inside.sum())} of {one.judged}" if one.judged else "unknown",
        ))  # fmt: skip
    columns = right("level\nerror", "bias", "a run's\nsigma", "in the\nband", "in its 95 %\ninterval")
    return console_table([*folded("measure"), *columns], rows, title="Levels")


def measure_table(compared: RunComparison) -> Table:
    """Return a table of measures by run, with the change of the last run from the first."""
    rows = []
    for measure in compared.measures:
        change = compared.change(measure)
        text = "" if change is None else f"{change:+.2f} %"
        rows.append(
            (
                escape(measure.name),
                compared.display(measure),
                *(f"{value:.4g}" for value in compared.values(measure)),
                text,
            )
        )
    fit = sum(map(len, compared.runs)) <= _LABELS
    runs = compared.runs if fit else [f"run {number}" for number in range(1, len(compared.runs) + 1)]
    return console_table([*folded("measure"), "unit", *right(*map(escape, runs), "change")], rows)


# ---- Shock curves to aim at -----------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _ShapeOptions:
    """Options of `eightpost study shapes`."""

    # fmt: off
    study_file: Path = argument("STUDY", kind=FilePath())
    output: Path = option(
        "Output folder for the page, shapes.json, the shock files of the targets and intermediate results.",
        "-o", "--output", kind=OutputFolder({**FILES, "shapes.json": AIM, "shapes.html": PAGE}), default=Path("out"),
    )
    objective: str | None = option(
        "Measure to minimise; default: the objective of the study.", "--for", metavar="MEASURE"
    )
    corners: tuple[str, ...] = option(
        "Corner whose shock is searched, with those that are alike; may be repeated. Default: all. Other corners keep "
        "the builds of the best setup of the bank.",
        "--at", metavar="CORNER",
    )
    vary: tuple[str, ...] = option(
        "Number of the shape that varies, e.g. rebound.low; may be repeated. Default: the ten numbers of the curve.",
        metavar="NUMBER",
    )
    limits: tuple[tuple[str, str], ...] = option(
        "Limits of a number with their units, e.g. 'rebound.knee=1 in/s,6 in/s'; may be repeated. Default: the range "
        "over the builds of the bank.",
        "--limit", kind=Assignment("NUMBER=LOW,HIGH"), metavar="NUMBER=LOW,HIGH",
    )
    workers: int | str | None = WORKERS
    tolerance: float = setting(
        "Standard deviation of every number from shock to shock, as a share of its value.",
        kind=Quantity("1"), default="3 %",
    )
    draws: int = setting(
        "Number of draws of the tolerance; 0: shocks exactly as planned.", kind=click.IntRange(min=0), default=6
    )
    weight: float = setting(
        "Number of standard deviations, 0 to 10, that are added to the mean of the objective.",
        kind=Number(0.0, 10.0), default=1.0,
    )
    keep: float = setting("Share of the gain that the band keeps.", kind=Quantity("1", positive=True), default="80 %")
    starts: int = setting(
        "Number of starts: the best of the bank, the baseline, and random ones.", kind=click.IntRange(min=1), default=3
    )
    sure: bool = setting(
        "Account for the errors that the vehicle states, and for the rig runs in the folder.", "certainty", default=True
    )
    seed: int = setting("Seed of the random starts.", kind=click.IntRange(min=0), default=0)
    # fmt: on


@verb
def shapes(ctx: click.Context, asked: _ShapeOptions = group(_ShapeOptions)) -> None:
    """Find the shock curves to aim at: the best shapes for a study, also ones that nobody has built.

    STUDY is the TOML file of `eightpost study` with shock files in its bank. A shape has a few numbers: bleed, knee,
    low- and high-speed slopes of each side, lag and gas. The search varies them at each corner within the range of the
    bank, under the constraints of the study, and minimises mean plus scatter of the objective over the tolerance. The
    page states the target curves with a band that keeps most of the gain, the nearest builds of the bank, and the
    shims, bleed and clicks of the virtual damper that come closest. The errors that an identified vehicle states are
    drawn too, so that the gain is stated with a probability. The targets are run as FMUs of their own. The page of the
    study is written too; both pages link to each other. The exit code is 1 if the targets are not better than the best
    setup of the bank, or if Ctrl-C stopped the search: completed runs of the bank are kept.

    \b
    Examples:
      eightpost study shapes examples/identified/study.toml -o out/
      eightpost study shapes examples/study.toml -o out/ --at lr --vary rebound.low --vary rebound.high
      eightpost study shapes examples/study.toml -o out/ --limit 'compression.low=10 lbf.s/in,60 lbf.s/in'
    """
    from cosim.study.choice.shape_search import Robustness
    from eightpost.api.shape_page import aim_verdict
    from eightpost.api.shapes import Request, bank_plan, searched_groups
    from eightpost.shock.shape import CURVE_NUMBERS

    console = Console()
    request = Request(
        vary=asked.vary or CURVE_NUMBERS,
        limits=_limits(asked.limits),
        corners=asked.corners,
        tolerance=asked.tolerance,
        robustness=Robustness(asked.draws, asked.weight),
        starts=asked.starts,
        keep=asked.keep,
        objective=asked.objective or "",
        seed=asked.seed,
        uncertain=asked.sure,
    )
    folder = opened(console, asked.study_file, asked.output, asked.workers)
    searched_groups(folder.study, asked.corners)
    if asked.objective is not None:
        folder.study.measure(asked.objective)
    begin(console, folder, bank_plan(folder.sweep))
    try:
        found = folder.shapes(request)
    except KeyboardInterrupt:
        show_text(console, "stopped: no targets were written; completed runs of the bank are kept, those of the search "
                  "are not; run the command again with the same folder")  # fmt: skip
        completion.abandon()
        ctx.exit(1)
    _show(console, found)
    show_verdict(console, aim_verdict(found))
    show_files(console, [asked.output / "shapes.json", asked.output / "shapes.html", folder.write_page()])
    ctx.exit(0 if aim_verdict(found).is_acceptable else 1)


def _limits(stated: tuple[tuple[str, str], ...]) -> dict[str, tuple[float, float]]:
    """Return limits in SI by number."""
    from eightpost import units
    from eightpost.shock.shape import NUMBERS, unit_of

    found = {}
    for name, text in stated:
        ends = [part.strip() for part in text.split(",")]
        if name not in NUMBERS or len(ends) != 2:
            raise InputError(
                f"--limit {name}={text}: write NUMBER=LOW,HIGH with units; the numbers are {', '.join(NUMBERS)}"
            )
        try:
            low, high = (float(units.convert(*units.quantity(end), unit_of(name))) for end in ends)
        except InputError as error:
            raise InputError(f"--limit {name}={text}: {error}") from error
        found[name] = (low, high)
    return found


def _show(console: Console, found: Aim) -> None:
    """Print objectives, band, targets and what is near them."""
    from eightpost.api.shape_page import (
        band_text,
        car_text,
        gain_table,
        neighbour_table,
        number_table,
        objective_table,
        robust_table,
    )
    from eightpost.report.tables import result_table

    show_table(console, result_table(objective_table(found)), most=3)
    more = details(console)
    for table in (gain_table(found), robust_table(found)):
        show_table(more, result_table(table))
    for text in (car_text(found), band_text(found)):
        show_text(more, text)
    for target in found.targets:
        show_table(more, result_table(number_table(target, found)))
        show_table(more, result_table(neighbour_table(target, found)))


@verb
def clicks(
    shock_file: Path = argument("SHOCK", kind=FilePath()),
    curve: Path = option(
        "Target: a table with the columns velocity and force and their units, or a shock file.",
        kind=FilePath(), default=..., metavar="FILE",
    ),
    fix: tuple[tuple[str, str], ...] = option(
        "Setting of an adjuster that is not searched, e.g. rebound=12; may be repeated.",
        kind=Assignment("ADJUSTER=CLICKS"), metavar="ADJUSTER=CLICKS",
    ),
    plot: Path | None = option(
        "Picture of the target and the best setting; no default: none is written.", kind=OutputFile(PICTURE)
    ),
    temperature: float | None = setting(
        "Temperature at which the target is to be reached, e.g. '60 degC'; default: the reference.", kind=Quantity("K")
    ),
    speeds: tuple[float, float] | None = setting(
        "Lowest and highest speed that count, e.g. speeds='0 m/s, 0.2 m/s'; default: all measured speeds.",
        kind=Quantity("m/s"), nargs=2,
    ),
    level: Level = setting(
        "Treatment of a constant force over all speeds, such as gas force. kept: it counts as an error. free: it does "
        "not.",
        kind=("free", "kept"), default="kept",
    ),
    count: int = setting("Number of settings to list.", kind=click.IntRange(1, 100), default=5),
) -> None:  # fmt: skip
    """Find the clicks at which a shock comes closest to a target curve.

    SHOCK is a shock that `eightpost fit` fitted over its settings. All combinations of whole clicks are compared with
    the target. The list shows the remaining error in each range of speeds, and which settings are equal within the band
    of the model.

    \b
    Examples:
      eightpost study clicks shock.json --curve target.csv
      eightpost study clicks shock.json --curve other_shock.json --set speeds='0 m/s, 0.2 m/s' --plot target.png
      eightpost study clicks shock.json --curve target.csv --fix compression=8
    """
    from eightpost.ident.shock.clicks import answer_table, best_clicks, read_target
    from eightpost.shock import read_shock

    console = Console()
    shock, target = read_shock(shock_file), read_target(curve)
    fixed = {name: _number(name, text) for name, text in fix}
    if temperature is not None:
        fixed["temperature"] = temperature
    answer = best_clicks(shock, target, fixed=fixed, speeds=speeds, level=level, count=count)
    show_table(console, answer_table(answer), most=min(count, 5))
    show_notes(console, answer.notes, most=1)
    if answer.is_reachable:
        show_text(console, f"the target can be reached: {answer.best.text}", style="green")
    show_notes(console, answer.unreachable, "not reached", most=1)
    if plot is not None:
        from eightpost.ident.shock.plots import plot_answer

        plot_answer(shock, target, answer, plot)
        show_files(console, [plot])


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"--fix {name}={text}: {text!r} is not a number of clicks") from None
