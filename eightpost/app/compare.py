"""`eightpost study compare`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import CHANNELS, Channels, FilePath, Number, OutputFile, argument, option, setting, verb
from eightpost.app.study import saved
from eightpost.errors import InputError
from eightpost.outputs import PICTURE
from eightpost.report.console import Table, console_table, folded, right
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from cosim.study.choice.compare import Comparison, RunComparison
    from cosim.study.table import StudyResult

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
        "Minimum acceptable rank correlation (Spearman) for --measured, -1 to 1.",
        kind=Number(-1.0, 1.0), default=0.8,
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
        show_table(console, rank_table(entries))
        show_table(details(console), level_table(entries, study.result))
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


def rank_table(entries: Sequence[Comparison]) -> Table:
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


def level_table(entries: Sequence[Comparison], result: StudyResult) -> Table:
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
