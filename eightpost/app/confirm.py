"""`eightpost study confirm`."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import CHANNELS, Channels, FilePath, argument, option, verb
from eightpost.app.study import saved, show_certainty
from eightpost.report.console import Table, console_table, right

if TYPE_CHECKING:
    from cosim.study.choice.certainty import Certainty
    from cosim.study.table import StudyResult

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
    show_table(details(console), before_and_after(result, before, after))
    show_certainty(console, result, after)
    show_contradictions(console, result, after)
    show_verdict(console, study_verdict(result, after).about("choice", "rig runs"))
    show_files(console, [folder / CERTAINTY, study.write_page()], f"; the previous certainty is {PREVIOUS}")
    ctx.exit(1 if after.contradictions else 0)


def before_and_after(result: StudyResult, before: Certainty, after: Certainty) -> Table:
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


def show_contradictions(console: Console, result: StudyResult, certainty: Certainty) -> None:
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
    show_notes(console, texts, "contradiction")
