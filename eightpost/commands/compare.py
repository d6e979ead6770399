"""`eightpost compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from cosim.plots import plot_measures
from cosim.study.choice.compare_verdict import verdict_of_runs
from cosim.study.measures import DISPLAY, Measure, available, channel_measures, ride_measures
from eightpost import units
from eightpost.commands.compare_study import ComparisonRequest, compare_study
from eightpost.commands.show_verdict import show_verdict
from eightpost.errors import FileFormatError, InputError
from eightpost.files import json_content
from eightpost.signals import TimeSeries, read_series
from eightpost.verdict import Verdict


@click.pass_context
def compare(
    ctx: click.Context, /, folders: tuple[Path, ...], vehicle: str, output: Path | None, **options: Any
) -> None:
    """Compare runs, or a study's prediction with rig measurements."""
    console = Console()
    if (measured := options.pop("measured")) is not None:
        ctx.exit(0 if _compare_with_rig(console, folders, measured, output, **options).is_acceptable else 1)
    if len(folders) < 2:
        raise InputError("compare needs at least two runs; the first is the baseline")
    runs = {str(folder): _read(folder) for folder in folders}
    for folder in folders:
        console.print(f"{folder}: {_sources(folder)}", highlight=False, soft_wrap=True)
    series = tuple(runs.values())
    measures = available(ride_measures(vehicle), *series) or available(channel_measures(series[0], DISPLAY), *series)
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
    channel_map: Path | None,
    rank: float,
    level: float | None,
) -> Verdict:
    if len(folders) != 1:
        raise InputError(f"with --measured, compare takes the folder of one study, not {len(folders)} folders")
    return compare_study(console, folders[0], measured, output, ComparisonRequest(measures, rank, level, channel_map))


def measure_table(runs: dict[str, TimeSeries], measures: tuple[Measure, ...]) -> Table:
    """Return a table of measures by run, with the change of the last run from the first."""
    table = Table("measure", "unit", *runs, "change")
    for measure in measures:
        values = [units.convert(measure.of(s), measure.unit(s), measure.display) for s in runs.values()]
        change = f"{100.0 * (values[-1] / values[0] - 1.0):+.2f} %" if values[0] else ""
        table.add_row(measure.name, measure.display, *(f"{value:.4g}" for value in values), change)
    return table


def _read(folder: Path) -> TimeSeries:
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
