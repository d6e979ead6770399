"""Measured setups against a study's prediction: the second half of `eightpost compare`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from cosim.study.choice.compare import Comparison
from cosim.study.choice.compare_file import write_comparisons
from cosim.study.choice.compare_plot import plot_comparisons
from cosim.study.choice.compare_runs import Measured, MeasuredRun, comparisons, measured_runs, read_run_list
from cosim.study.choice.compare_verdict import comparison_verdict
from cosim.study.choice.selection_file import read_selection
from cosim.study.result import StudyResult
from eightpost import units
from eightpost.commands.show_verdict import show_verdict
from eightpost.commands.study_page import RESULTS, SELECTION
from eightpost.errors import InputError
from eightpost.rig.post import read_rig_test
from eightpost.signals import ChannelMap, TimeSeries
from eightpost.verdict import Verdict


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is compared, and what is asked of it.

    Attributes:
        measures: Names; empty: all that were measured and do not hang on a mean.
        rank: Least rank correlation (Spearman) of every measure.
        level: Largest level error of every measure [%]; None where levels do not matter.
        channel_map: Of the rig's files.
    """

    measures: tuple[str, ...]
    rank: float
    level: float | None
    channel_map: Path | None


def compare_study(console: Console, folder: Path, measured: Path, output: Path | None, wanted: Wanted) -> Verdict:
    """Compare a study with measured runs, print what was found, and write it.

    Returns:
        The verdict.
    """
    result = StudyResult.load(folder / RESULTS)
    for name in wanted.measures:
        result.study.measure(name)
    path = measured / SELECTION if measured.is_dir() else measured
    runs = _present(console, read_run_list(path, result.study), path)
    mapping = ChannelMap.read(wanted.channel_map) if wanted.channel_map else None

    def read(file: Path) -> TimeSeries:
        return read_rig_test(file, channel_map=mapping).series

    drawn = measured_runs(runs, result.study, read)
    for name, channels in drawn.missing.items():
        console.print(f"[yellow]note[/] {escape(name)}: the rig has no {channels}", highlight=False, soft_wrap=True)
    names = _names(console, result, drawn, wanted)
    found = comparisons(result, replace(drawn, values={name: drawn.values[name] for name in names}))
    if not found:
        raise InputError(f"{path}: none of the study's measures could be drawn from these records")
    console.print(f"{len(runs)} runs of {found[0].setups.size} setups", highlight=False)
    console.print(comparison_table(found, result))
    verdict = comparison_verdict(found, rank=wanted.rank, level=wanted.level)
    _write(console, found, result, output or folder / "compared", _selected(folder, result), verdict)
    show_verdict(console, verdict)
    return verdict


def _names(console: Console, result: StudyResult, drawn: Measured, wanted: Wanted) -> list[str]:
    """Return the measures to compare; a mean only if it is named, because the rig has a zero of its own."""
    if wanted.measures:
        return [name for name in wanted.measures if name in drawn.values]
    means = [name for name in drawn.values if result.study.measure(name).absolute]
    if means:
        what = f"left out, because the rig has a zero of its own: {', '.join(means)}; --measure takes one all the same"
        console.print(f"[yellow]note[/] {escape(what)}", highlight=False, soft_wrap=True)
    return [name for name in drawn.values if name not in means]


def _present(console: Console, runs: Sequence[MeasuredRun], path: Path) -> list[MeasuredRun]:
    """Return the runs whose records are there; the others are named."""
    there = [run for run in runs if run.file.is_file()]
    missing = [run.file.name for run in runs if not run.file.is_file()]
    if not there:
        raise InputError(f"{path}: none of its {len(runs)} records is there; {runs[0].file if runs else 'it is empty'}")
    if missing:
        console.print(f"[yellow]note[/] not measured: {', '.join(missing)}", highlight=False, soft_wrap=True)
    return there


def comparison_table(found: Sequence[Comparison], result: StudyResult) -> Table:
    """Return how well each measure was predicted."""
    table = Table("measure", *(Column(name, justify="right") for name in (
        "Spearman", "attainable", "Kendall", "slope (95 %)", "level error", "bias", "a run's sigma", "in the band",
    )))  # fmt: skip
    for one in found:
        low, high = one.line.interval()
        unit = result.display(one.measure)
        sigma = f"{units.conversion(result.unit(one.measure), unit)[0] * one.run_to_run:.2g} {unit}"
        table.add_row(
            escape(one.measure),
            f"{one.spearman:.3f}",
            f"{one.attainable:.3f}" if one.run_to_run else "",
            f"{one.kendall:.3f}",
            f"{one.line.slope:.2f} ({low:.2f} to {high:.2f})",
            f"{one.level_error:.1f} %",
            f"{one.bias:+.1f} %",
            sigma if one.run_to_run else "not known",
            f"{int(one.within.sum())} of {one.within.size}",
        )
    return table


def _selected(folder: Path, result: StudyResult) -> dict[str, set[int]]:
    """Return which setups were selected for which measure, where the study's folder has a selection."""
    path = folder / SELECTION
    selection = read_selection(path, result) if path.is_file() else None
    found: dict[str, set[int]] = {}
    for selected in selection.chosen if selection else ():
        found.setdefault(selected.measure, set()).add(selected.setup.index)
    return found


def _write(
    console: Console,
    found: Sequence[Comparison],
    result: StudyResult,
    output: Path,
    selected: dict[str, set[int]],
    verdict: Verdict,
) -> None:
    """Write all comparisons, and a picture of the measures that setups were selected for, else of the objective."""
    write_comparisons(found, result.provenance.measure_units, output / "comparison.json", verdict)
    names = [one.measure for one in found]
    first = selected or dict.fromkeys(term.measure for term in result.study.objective)
    drawn = [one for one in found if one.measure in first] or list(found)
    shown = {name: (result.unit(name), result.display(name)) for name in names}
    plot_comparisons(drawn, output / "comparison.png", shown=shown, selected=selected)
    console.print(f"wrote {output / 'comparison.png'} and comparison.json beside it", highlight=False, soft_wrap=True)
