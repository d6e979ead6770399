"""`eightpost study select`, `confirm` and `compare`: setups on the rig."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import FilePath, Number, OutputFile, argument, option, setting, verb
from eightpost.app.study import saved, show_certainty
from eightpost.errors import InputError
from eightpost.outputs import PICTURE
from eightpost.report.console import Table, console_table, folded, right, unbroken
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from cosim.study.choice.certainty import Certainty
    from cosim.study.choice.compare import Comparison, RunComparison
    from cosim.study.choice.rig_day import Selection
    from cosim.study.table import StudyResult

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
    from eightpost.app.show import show_files, show_table, show_text

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
    from eightpost.app.show import details, show_files, show_table, show_text, show_verdict

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
    from eightpost.app.show import show_notes

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
    from eightpost.app.show import details, show_files, show_table, show_verdict

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
    from eightpost.app.show import show_files, show_table, show_text

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
