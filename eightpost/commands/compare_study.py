"""Comparison of measured setups with a study's prediction, for `eightpost compare --measured`."""

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
class ComparisonRequest:
    """Measures to compare and the limits that they must meet.

    Attributes:
        measures: Names of the measures; empty: all measured ones that do not depend on a mean.
        rank: Minimum acceptable rank correlation (Spearman) of every measure.
        level: Maximum acceptable level error of every measure [%]; None for no limit.
        channel_map: Channel map of the rig files.
    """

    measures: tuple[str, ...]
    rank: float
    level: float | None
    channel_map: Path | None


def compare_study(
    console: Console, folder: Path, measured: Path, output: Path | None, request: ComparisonRequest
) -> Verdict:
    """Compare a study with measured runs; print and write the comparison.

    Returns:
        The verdict.
    """
    result = StudyResult.load(folder / RESULTS)
    for name in request.measures:
        result.study.measure(name)
    path = measured / SELECTION if measured.is_dir() else measured
    runs = _present(console, read_run_list(path, result.study), path)
    mapping = ChannelMap.read(request.channel_map) if request.channel_map else None

    def read(file: Path) -> TimeSeries:
        return read_rig_test(file, channel_map=mapping).series

    rig = measured_runs(runs, result.study, read)
    for name, channels in rig.missing.items():
        console.print(f"[yellow]note[/] {escape(name)}: the rig has no {channels}", highlight=False, soft_wrap=True)
    names = _names(console, result, rig, request)
    entries = comparisons(result, replace(rig, values={name: rig.values[name] for name in names}))
    if not entries:
        raise InputError(f"{path}: none of the study's measures can be computed from these records")
    console.print(f"{len(runs)} runs of {entries[0].setups.size} setups", highlight=False)
    console.print(comparison_table(entries, result))
    verdict = comparison_verdict(entries, rank=request.rank, level=request.level)
    _write(console, entries, result, output or folder / "compared", _selected(folder, result), verdict)
    show_verdict(console, verdict)
    return verdict


def _names(console: Console, result: StudyResult, rig: Measured, request: ComparisonRequest) -> list[str]:
    """Return the measures to compare; a mean only if it is named, because the zero of the rig differs."""
    if request.measures:
        return [name for name in request.measures if name in rig.values]
    means = [name for name in rig.values if result.study.measure(name).absolute]
    if means:
        note = f"left out, because the zero of the rig differs: {', '.join(means)}; compare one with --measure"
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False, soft_wrap=True)
    return [name for name in rig.values if name not in means]


def _present(console: Console, runs: Sequence[MeasuredRun], path: Path) -> list[MeasuredRun]:
    """Return the runs whose records exist; print the names of the missing records."""
    there = [run for run in runs if run.file.is_file()]
    missing = [run.file.name for run in runs if not run.file.is_file()]
    if not there:
        first = f"the first is {runs[0].file}" if runs else "the list is empty"
        raise InputError(f"{path}: none of its {len(runs)} records exists; {first}")
    if missing:
        console.print(f"[yellow]note[/] no record yet: {', '.join(missing)}", highlight=False, soft_wrap=True)
    return there


def comparison_table(entries: Sequence[Comparison], result: StudyResult) -> Table:
    """Return a table of the quality of each measure's prediction."""
    table = Table("measure", *(Column(name, justify="right") for name in (
        "Spearman", "attainable", "Kendall", "slope (95 %)", "level error", "bias", "a run's sigma", "in the band",
    )))  # fmt: skip
    for one in entries:
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
            sigma if one.run_to_run else "unknown",
            f"{int(one.within.sum())} of {one.within.size}",
        )
    return table


def _selected(folder: Path, result: StudyResult) -> dict[str, set[int]]:
    """Return the selected setups of each measure; empty if the study's folder has no selection."""
    path = folder / SELECTION
    selection = read_selection(path, result) if path.is_file() else None
    setups: dict[str, set[int]] = {}
    for selected in selection.chosen if selection else ():
        setups.setdefault(selected.measure, set()).add(selected.setup.index)
    return setups


def _write(
    console: Console,
    entries: Sequence[Comparison],
    result: StudyResult,
    output: Path,
    selected: dict[str, set[int]],
    verdict: Verdict,
) -> None:
    """Write all comparisons, and a picture of the measures of the selection, or else of the objective."""
    write_comparisons(entries, result.provenance.measure_units, output / "comparison.json", verdict)
    names = [one.measure for one in entries]
    first = selected or dict.fromkeys(term.measure for term in result.study.objective)
    drawn = [one for one in entries if one.measure in first] or list(entries)
    shown = {name: (result.unit(name), result.display(name)) for name in names}
    plot_comparisons(drawn, output / "comparison.png", shown=shown, selected=selected)
    console.print(
        f"wrote {output / 'comparison.png'} and comparison.json in the same folder", highlight=False, soft_wrap=True
    )
