"""`eightpost inspect`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import COLUMNS, UNITS, FilePath, Quantity, Verb, flip_option, map_option
from eightpost.errors import InputError
from eightpost.report.console import Table, console_table

if TYPE_CHECKING:
    from collections.abc import Sequence

    from eightpost.checks import Fault
    from eightpost.rig import DynoTest, PeakVelocityTable, RigTest
    from eightpost.signals import ChannelMap, TimeSeries
    from eightpost.signals.raw_record import RawRecord


@click.command(cls=Verb)
@click.argument("path", metavar="FILE", type=FilePath())
@UNITS
@COLUMNS
@map_option("docs/reference/signs_and_units.md", "file")
@flip_option("force")
@click.option("--mass", type=Quantity("kg", positive=True), metavar="MASS",
              help="Mass of the car on the rig, e.g. '3400 lbm', by which its forces are checked; default: "
              "unknown.")  # fmt: skip
@click.pass_context
def inspect(
    ctx: click.Context,
    path: Path,
    units: tuple[tuple[str, str], ...],
    columns: tuple[tuple[str, str], ...],
    channel_map: ChannelMap | None,
    flip: tuple[str, ...],
    mass: float | None,
) -> None:
    """Show the content of a dynamometer or rig file, and everything suspicious in it.

    First, columns, units and preamble are shown as they are in the file. Then a dynamometer file is read as `fit` reads
    it: channels, ranges, runs, temperature and notes. A rig file is read as `identify` reads it: channels, ranges,
    channels that are late, and channels that contradict mechanics. A rig file is recognized by its wheelloaders
    (`lf.road` or `road`, in the file or in the map); for one without these names, a channel map is proposed. FILE is a
    text file, a spreadsheet, a .parquet, .mat, .mf4, .tdms or .lvm file (docs/reference/dyno_files.md), or a
    peak-velocity table. The exit code is 0 if nothing is suspicious, 1 if something is suspicious, and 2 if the file
    cannot be used as it is.

    \b
    Examples:
      eightpost inspect run7.csv
      eightpost inspect run7.mf4 --units force=lbf --flip force
      eightpost inspect rig.csv --map my_map.toml --mass '3400 lbm'
    """
    from eightpost.rig import read_dyno_tests, read_rig_test, split_runs
    from eightpost.rig.columns import propose_map, with_channels
    from eightpost.rig.peak_velocity import read_peak_velocity
    from eightpost.rig.peak_velocity_columns import holds_peak_velocities
    from eightpost.rig.rig_test import rig_map
    from eightpost.signals import read_records

    console = Console(soft_wrap=True, highlight=False)
    channel_map = with_channels(channel_map, dict(columns))
    records = read_records(path)
    for record in records:
        show_record(console, record)
    if _is_rig(records[0], channel_map):
        _show_map(console, records[0], rig_map(records[0], channel_map).flipped(flip))
        rig_test = read_rig_test(path, channel_map=channel_map, units=dict(units), flip=flip)
        ctx.exit(int(_show_rig_test(console, rig_test, mass)))
    if proposed := propose_map(records[0]):
        console.print("proposed channel map; check its columns, and the signs (docs/reference/signs_and_units.md):")
        console.print(f"\n{escape(proposed.toml())}\n")
        raise InputError(f"{path} {proposed.finding}; save its channel map as rig_map.toml in its folder, or pass the "
                         "map by --map")  # fmt: skip
    if mass is not None:
        raise InputError(f"{path} is not a rig file, and --mass is an option of rig files; omit it")
    if holds_peak_velocities(records, channel_map):
        tables = read_peak_velocity(path, units=dict(units), channel_map=channel_map)
        for table in tables:
            show_table(console, table)
        ctx.exit(int(any(table.gas_force for table in tables)))
    tests = read_dyno_tests(path, channel_map=channel_map, units=dict(units), flip=flip)
    runs = [run for test in tests for run in split_runs(test)]
    for test in tests:
        show_test(console, test)
    show_runs(console, runs)
    ctx.exit(int(any(test.warnings for test in tests)))


def show_record(console: Console, record: RawRecord) -> None:
    """Print the columns and the preamble of a table as they are in the file."""
    line = f", header in line {record.origin.header_line}" if record.origin.header_line else ""
    console.print(f"[bold]{escape(str(record.origin.path))}[/]{line}: {record.columns[0].size} samples")
    for cells in record.preamble:
        console.print(f"  {escape(' | '.join(cells))}", style="dim")
    columns = [f"{name} \\[{unit}]" if unit else f"{name} (no unit)" for name, unit in _named(record)]
    console.print(f"columns: {', '.join(columns)}")


def _named(record: RawRecord) -> list[tuple[str, str | None]]:
    return [
        (escape(name), escape(unit) if unit else None) for name, unit in zip(record.names, record.units, strict=True)
    ]


def show_test(console: Console, test: DynoTest) -> None:
    """Print the channels of a test with their ranges, its scale and lag, its conditions and its notes."""
    from eightpost.rig.motion import lag_statement

    series = test.series
    console.print(f"{series.duration:.4g} s at {series.sample_rate:.6g} Hz")
    console.print(_channel_table(series, ("minimum", "maximum", "mean")))
    for statement in (lag_statement(series), *_conditions(test)):
        console.print(escape(statement))
    for note in (*test.derived, *test.remarks):
        console.print(f"[yellow]note[/] {escape(note)}")
    for warning in test.warnings:
        console.print(f"[red]warning[/] {escape(warning)}")


def _conditions(test: DynoTest) -> list[str]:
    from eightpost.rig.dyno_test import temperature_drift

    known = test.conditions
    values = {
        "run": known.run,
        "date": known.date,
        "build": known.build,
        "clicks": known.clicks,
        "gas pressure": f"{known.gas_pressure:.4g} Pa" if known.gas_pressure is not None else None,
        "gas force": f"{known.gas_force:.4g} N" if known.gas_force is not None else None,
        "temperature at the start": f"{known.temperature:.1f} K" if known.temperature is not None else None,
    }
    lines = [f"{name}: {value}" for name, value in values.items() if value is not None]
    if "temperature" in test.series:
        lines.append(f"temperature drift: {temperature_drift(test.series):+.1f} K")
    return lines


def show_runs(console: Console, runs: list[DynoTest]) -> None:
    """Print the runs, and the effect of temperature over repeated runs."""
    from eightpost.rig import temperature_effect
    from eightpost.rig.dyno_test import temperature_drift

    rows = []
    for i, run in enumerate(runs, 1):
        series = run.series
        stroke = "-" if run.stroke is None else f"{run.stroke:.4g}"
        drift = f"{temperature_drift(series):+.1f}" if "temperature" in series else "-"
        peaks = (f"{float(abs(series[name]).max()):.4g}" for name in ("velocity", "force"))
        rows.append((str(i), f"{series.time[0]:.4g}", f"{series.time[-1]:.4g}", stroke, *peaks, drift))
    columns = ("run", "from [s]", "to [s]", "stroke [m]", "peak velocity [m/s]", "peak force [N]", "drift [K]")
    console.print(console_table(columns, rows))
    effect = temperature_effect(runs)
    if effect:
        console.print(escape(str(effect)))


def show_table(console: Console, table: PeakVelocityTable) -> None:
    """Print a peak-velocity table's setting and ranges."""
    name = " ".join(("peak-velocity table", table.clicks or "")).strip()
    console.print(
        f"{escape(name)}: {len(table)} speeds, {table.speed[0]:.4g} to "
        f"{table.speed[-1]:.4g} m/s; compression to {table.compression.max():.4g} N, rebound to "
        f"{table.rebound.min():.4g} N"
    )
    for note in table.notes:
        console.print(f"[yellow]note[/] {escape(note)}")
    if table.gas_force:
        console.print(
            f"[red]warning[/] gas force {table.gas_force:.4g} N in the table, found from {escape(table.gas_source)}; "
            "it is subtracted from both strokes and becomes the gas preload of the shock"
        )


def _is_rig(record: RawRecord, channel_map: ChannelMap | None) -> bool:
    """Return whether a file is a rig file: it has wheelloaders, by its own names or by a map."""
    from eightpost.signals.raw_record import map_beside

    given = channel_map or map_beside(record)
    names = {*record.names, *(given.channels if given else ())}
    return bool(names & {"road", "lf.road", "rf.road", "lr.road", "rr.road"})


def _show_map(console: Console, record: RawRecord, mapping: ChannelMap) -> None:
    """Print the column of each channel, with the sign of the map, and the columns that are not read."""
    picks = mapping.channels
    named = [f"{name} {'-' * (pick.gain < 0.0)}{pick.source}" for name, pick in picks.items() if name != pick.source]
    if named:
        path = f" ({mapping.path})" if mapping.path else ""
        console.print(f"channel map{escape(path)}: {escape(', '.join(named))}")
    read = {pick.source for pick in picks.values()} | {mapping.time.source if mapping.time else ""}
    if left := [name for name in record.names if name not in read]:
        console.print(f"columns that are not read: {escape(', '.join(left))}")


def _show_rig_test(console: Console, test: RigTest, mass: float | None) -> bool:
    """Print channels, conditions and lags of a rig test; return whether something is suspicious.

    Raises:
        ConstantChannelError: A channel becomes constant during the record.
    """
    from eightpost.ident.preparation import check_lost_channels
    from eightpost.ident.preparation.plausibility import record_findings

    series = test.series
    check_lost_channels(series, test.corners, path=test.source)
    console.print(f"{series.duration:.4g} s at {series.sample_rate:.6g} Hz, corners {' '.join(test.corners) or 'one'}")
    console.print(_channel_table(series, ("minimum", "maximum", "mean", "std")))
    known = test.conditions
    for line in (known.synthetic, known.truth, known.drivefile, ", ".join(known.shocks)):
        if line:
            console.print(escape(line))
    for note in (*test.notes, *test.derived):
        console.print(f"[yellow]note[/] {escape(note)}")
    findings = record_findings(series, test.corners, mass=mass)
    is_late = _show_lags(console, test, findings)
    for finding in findings:
        console.print(f"[red]warning[/] {escape(str(finding))}")
    return bool(findings) or is_late


def _channel_table(series: TimeSeries, statistics: Sequence[str]) -> Table:
    """Return a table with a row for each channel and a column for each statistic: minimum, maximum, mean, std."""
    rows = []
    for name, unit, values in zip(series.names, series.units, series.values, strict=True):
        known = {"minimum": values.min(), "maximum": values.max(), "mean": values.mean(), "std": values.std()}
        rows.append((name, unit, *(f"{known[statistic]:.5g}" for statistic in statistics)))
    return console_table(["channel", "unit", *statistics], rows)


def _show_lags(console: Console, test: RigTest, findings: Sequence[Fault]) -> bool:
    """Print the lags, with a warning if a channel is late and no finding says so; return whether there is a warning."""
    from eightpost.ident.preparation import drifts, record_lags
    from eightpost.ident.preparation.preparation import unexplained_lags

    lags, changes = record_lags(test.series, test.corners), drifts(test.series, test.corners)
    late = unexplained_lags(lags, findings)
    for lag in lags:
        word = "[red]warning[/] " if lag in late else ""
        console.print(f"{word}{escape(str(lag))}")
    if late:
        console.print("shift the channels of a late logger with delays (docs/how_to/rig_data.md)")
    for drift in changes:
        console.print(f"[red]warning[/] from start to end {escape(drift.drift_text)}")
    return bool(late or changes)
