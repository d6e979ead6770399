"""`eightpost compare`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import Verb, map_option
from eightpost.errors import FileFormatError, InputError
from eightpost.files import json_content
from eightpost.report.console import Table, console_table, right
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from cosim.study.choice.compare import Comparison, Measured, MeasuredRun
    from cosim.study.measures import Measure
    from cosim.study.result import StudyResult
    from eightpost.signals import ChannelMap, TimeSeries


# ---- Comparison of measured setups with a study's prediction, for `eightpost compare --measured` --------------------


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
    channel_map: ChannelMap | None


def compare_study(
    console: Console, folder: Path, measured: Path, output: Path | None, request: ComparisonRequest
) -> Verdict:
    """Compare a study with measured runs; print and write the comparison.

    Returns:
        The verdict.
    """
    from cosim.study.choice.compare import comparison_verdict, comparisons, measured_runs, read_run_list
    from cosim.study.result import StudyResult
    from eightpost.app.show import show_verdict
    from eightpost.app.study_page import RESULTS, SELECTION
    from eightpost.rig.post import read_rig_test

    result = StudyResult.load(folder / RESULTS)
    for name in request.measures:
        result.study.measure(name)
    path = measured / SELECTION if measured.is_dir() else measured
    runs = _present(console, read_run_list(path, result.study), path)

    def read(file: Path) -> TimeSeries:
        return read_rig_test(file, channel_map=request.channel_map).series

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
    from eightpost import units

    columns = right(
        "Spearman", "attainable", "Kendall", "slope (95 %)", "level error", "bias", "a run's sigma", "in the band"
    )
    rows = []
    for one in entries:
        low, high = one.line.interval()
        unit = result.display(one.measure)
        sigma = f"{units.conversion(result.unit(one.measure), unit)[0] * one.run_to_run:.2g} {unit}"
        rows.append((
            escape(one.measure),
            f"{one.spearman:.3f}",
            f"{one.attainable:.3f}" if one.run_to_run else "",
            f"{one.kendall:.3f}",
            f"{one.line.slope:.2f} ({low:.2f} to {high:.2f})",
            f"{one.level_error:.1f} %",
            f"{one.bias:+.1f} %",
            sigma if one.run_to_run else "unknown",
            f"{int(one.within.sum())} of {one.within.size}",
        ))  # fmt: skip
    return console_table(["measure", *columns], rows)


def _selected(folder: Path, result: StudyResult) -> dict[str, set[int]]:
    """Return the selected setups of each measure; empty if the study's folder has no selection."""
    from cosim.study.choice.selection import read_selection
    from eightpost.app.study_page import SELECTION

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
    from cosim.study.choice.compare_file import plot_comparisons, write_comparisons

    write_comparisons(entries, result.provenance.measure_units, output / "comparison.json", verdict)
    names = [one.measure for one in entries]
    first = selected or dict.fromkeys(term.measure for term in result.study.objective)
    drawn = [one for one in entries if one.measure in first] or list(entries)
    shown = {name: (result.unit(name), result.display(name)) for name in names}
    plot_comparisons(drawn, output / "comparison.png", shown=shown, selected=selected)
    console.print(
        f"wrote {output / 'comparison.png'} and comparison.json in the same folder", highlight=False, soft_wrap=True
    )


# ---- `eightpost compare` --------------------------------------------------------------------------------------------


@click.command(cls=Verb, renamed={"--channel-map": "--map"})
@click.argument("folders", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--vehicle", default="car", show_default=True, metavar="COMPONENT",
              help="Name of the vehicle component whose channels give the ride measures.")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Picture of the changes (.png); default: none. With --measured: output folder; default: compared/ "
              "in the folder of the study.")  # fmt: skip
@click.option("--measured", type=click.Path(path_type=Path), metavar="LIST",
              help="List of rig runs to compare a study with: a CSV file that assigns a setup to each record, such as "
              "the selection.csv of `eightpost select`, or its folder. Default: compare runs.")  # fmt: skip
@click.option("--measure", "measures", multiple=True, metavar="MEASURE",
              help="Measure to compare with --measured; may be repeated. Default: all measures that do not depend on "
              "a mean.")  # fmt: skip
@map_option("docs/rig_data.md", "rig files of --measured")
@click.option("--rank", type=click.FloatRange(-1.0, 1.0), default=0.8, show_default=True,
              help="Minimum acceptable rank correlation (Spearman) for --measured, -1 to 1.")  # fmt: skip
@click.option("--level", type=click.FloatRange(min=0.0), metavar="PERCENT",
              help="Maximum acceptable RMS error of the levels for --measured [%], e.g. 5; default: no "
              "limit.")  # fmt: skip
@click.pass_context
def compare(
    ctx: click.Context, /, folders: tuple[Path, ...], vehicle: str, output: Path | None, **options: Any
) -> None:
    """Compare runs, or a study's prediction with rig measurements.

    Without --measured, each RUN is a folder that `eightpost run` wrote. The response measures of all runs are listed
    side by side, with the change from the first run to the last. The settling time of each run is left out. Runs that
    lack the channels of the ride measures are compared channel by channel.

    With --measured, RUN is the folder of a study, and its prediction is compared with the rig measurements: trend, rank
    correlations, best-fit line and bands, as in Fig 7.7. The exit code is 1 if a measure misses --rank or --level.

    \b
    Examples:
      eightpost compare out out/swapped -o out/changes.png
      eightpost compare out/ --measured rig_day/selection.csv
    """
    from cosim.plots import plot_measures
    from cosim.study.choice.compare import verdict_of_runs
    from cosim.study.measures import available, channel_measures, ride_measures
    from eightpost.app.show import show_verdict

    console = Console()
    if (measured := options.pop("measured")) is not None:
        ctx.exit(0 if _compare_with_rig(console, folders, measured, output, **options).is_acceptable else 1)
    if len(folders) < 2:
        raise InputError("compare needs at least two runs; the first is the baseline")
    runs = {str(folder): _read(folder) for folder in folders}
    for folder in folders:
        console.print(f"{folder}: {_sources(folder)}", highlight=False, soft_wrap=True)
    series = tuple(runs.values())
    measures = available(ride_measures(vehicle), *series) or available(channel_measures(series[0]), *series)
    if not measures:
        raise InputError(f"{folders[0]} and the other runs have no channel in common")
    console.print(measure_table(runs, measures))
    if output:
        plot_measures(runs, measures, output)
        console.print(f"wrote {output}", highlight=False)
    verdict = verdict_of_runs({str(folder): _result(folder) for folder in folders})
    show_verdict(console, verdict)
    ctx.exit(0 if verdict.is_acceptable else 1)


def _compare_with_rig(
    console: Console,
    folders: tuple[Path, ...],
    measured: Path,
    output: Path | None,
    *,
    measures: tuple[str, ...],
    channel_map: ChannelMap | None,
    rank: float,
    level: float | None,
) -> Verdict:
    if len(folders) != 1:
        raise InputError(f"with --measured, compare takes the folder of one study, not {len(folders)} folders")
    return compare_study(console, folders[0], measured, output, ComparisonRequest(measures, rank, level, channel_map))


def measure_table(runs: dict[str, TimeSeries], measures: tuple[Measure, ...]) -> Table:
    """Return a table of measures by run, with the change of the last run from the first."""
    from eightpost import units

    rows = []
    for measure in measures:
        values = [units.convert(measure.of(s), measure.unit(s), measure.display) for s in runs.values()]
        change = f"{100.0 * (values[-1] / values[0] - 1.0):+.2f} %" if values[0] else ""
        rows.append((measure.name, measure.display, *(f"{value:.4g}" for value in values), change))
    return console_table(["measure", "unit", *runs, "change"], rows)


def _read(folder: Path) -> TimeSeries:
    from eightpost.signals import read_series

    series = read_series(folder / "series.parquet")
    settling = _result(folder).get("settling", 0.0)
    if type(settling) not in (int, float) or not 0.0 <= settling < series.duration:
        message = f"settling is {settling!r}, but must be a time [s] within the run of {series.duration:g} s"
        raise FileFormatError(message, path=folder / "result.json")
    return series.window(settling, float(series.time[-1])) if settling else series


def _sources(folder: Path) -> str:
    """Return the FMUs and parameters of a run in words."""
    result = _result(folder)
    sources, parameters = result.get("sources", {}), result.get("parameters", {})
    if not isinstance(sources, dict) or not isinstance(parameters, dict):
        raise FileFormatError("sources and parameters must be objects", path=folder / "result.json")
    parts = [f"{name} = {source}" for name, source in sources.items()]
    for name, values in parameters.items():
        if not isinstance(values, dict):
            raise FileFormatError(f"parameters.{name} must be an object", path=folder / "result.json")
        parts += [f"{name}.{parameter} = {value}" for parameter, value in values.items()]
    return ", ".join(parts)


def _result(folder: Path) -> dict[str, Any]:
    path = folder / "result.json"
    document = json_content(path, advice="name a folder that `eightpost run` wrote", finite=False)
    if not isinstance(document, dict) or document.get("kind") != "result":
        raise FileFormatError("is not the result of a run", path=path)
    return document
