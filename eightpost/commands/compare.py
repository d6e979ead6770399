"""`eightpost compare`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from cosim.plots import plot_measures
from cosim.study.measures import DISPLAY, Measure, available, channel_measures, ride_measures
from eightpost import units
from eightpost.commands.compare_study import Wanted, compare_study
from eightpost.errors import FileFormatError, InputError
from eightpost.signals import TimeSeries, read_series


@click.command()
@click.argument("folders", metavar="RUN...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--vehicle", default="car", show_default=True, help="The vehicle's component, for the ride measures.")
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Picture of the changes (.png); with --measured a folder, default compared/ in the study's.",
)  # fmt: skip
@click.option("--measured", type=click.Path(path_type=Path), metavar="LIST",
              help="Compare a study with rig runs: a CSV that says which record is of which setup, such as the "
              "selection.csv of `eightpost select`, or the folder that it is in.")  # fmt: skip
@click.option("--measure", "measures", multiple=True, metavar="MEASURE", help="With --measured: only this one.")
@click.option("--channel-map", type=click.Path(path_type=Path), help="With --measured: channels of the rig's files.")
@click.option("--rank", type=click.FloatRange(-1.0, 1.0), default=0.8, show_default=True,
              help="With --measured: least rank correlation (Spearman) that is acceptable.")  # fmt: skip
@click.option("--level", type=click.FloatRange(min=0.0), metavar="PERCENT",
              help="With --measured: largest acceptable RMS error of the levels; default any.")  # fmt: skip
@click.pass_context
def compare(
    ctx: click.Context, /, folders: tuple[Path, ...], vehicle: str, output: Path | None, **options: Any
) -> None:
    """Compare runs, or a study's prediction with what the rig measured.

    Of runs: response measures side by side, and the change from the first run to the last. RUN is a folder that
    `eightpost run` wrote. Settling is left out as each run was told. Runs without the channels of the ride measures are
    compared channel by channel.

    With --measured, RUN is the folder of a study, and its prediction is compared with what the rig measured: trend,
    rank correlations, best-fit line and bands, as Fig 7.7. Exits 1 if a measure does not meet --rank or --level.

    \b
    Example:
      eightpost compare out out/swapped -o out/changes.png
      eightpost compare out/ --measured rig_day/selection.csv
    """
    console = Console()
    if (measured := options.pop("measured")) is not None:
        ctx.exit(0 if _with_rig(console, folders, measured, output, **options) else 1)
    if len(folders) < 2:
        raise InputError("compare takes two runs or more; the first is the baseline")
    runs = {str(folder): _read(folder) for folder in folders}
    for folder in folders:
        console.print(f"{folder}: {_what(folder)}", highlight=False, soft_wrap=True)
    series = tuple(runs.values())
    measures = available(ride_measures(vehicle), *series) or available(channel_measures(series[0], DISPLAY), *series)
    if not measures:
        raise InputError(f"{folders[0]} and the others have no channel in common")
    console.print(measure_table(runs, measures))
    if output:
        plot_measures(runs, measures, output)
        console.print(f"wrote {output}", highlight=False)


def _with_rig(
    console: Console,
    folders: tuple[Path, ...],
    measured: Path,
    output: Path | None,
    *,
    measures: tuple[str, ...],
    channel_map: Path | None,
    rank: float,
    level: float | None,
) -> bool:
    if len(folders) != 1:
        raise InputError(f"with --measured, compare takes the folder of one study, not {len(folders)}")
    return compare_study(console, folders[0], measured, output, Wanted(measures, rank, level, channel_map))


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
    settling = float(_result(folder).get("settling", 0.0))
    return series.window(settling, float(series.time[-1])) if settling else series


def _what(folder: Path) -> str:
    """Say which FMUs and parameters a run had."""
    result = _result(folder)
    parts = [f"{name} = {source}" for name, source in result.get("sources", {}).items()]
    for name, values in result.get("parameters", {}).items():
        parts += [f"{name}.{parameter} = {value}" for parameter, value in values.items()]
    return ", ".join(parts)


def _result(folder: Path) -> dict[str, Any]:
    path = folder / "result.json"
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FileFormatError("there is no such file: name a folder that `eightpost run` wrote", path=path) from None
    except ValueError as error:
        raise FileFormatError(f"is no result of a run ({error})", path=path) from error
    if not isinstance(document, dict) or document.get("kind") != "result":
        raise FileFormatError("is no result of a run", path=path)
    return document
