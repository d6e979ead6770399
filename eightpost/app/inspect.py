"""`eightpost inspect`: what a file contains, and everything suspicious in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape

from eightpost import completion
from eightpost.app.options import (
    CHANNELS,
    Channels,
    FilePath,
    Number,
    OutputFolder,
    Quantity,
    argument,
    option,
    setting,
    verb,
    warn,
)
from eightpost.app.show import each
from eightpost.errors import InputError
from eightpost.report.console import Table, console_table, unbroken

if TYPE_CHECKING:
    from eightpost.checks import Fault
    from eightpost.ident.linearity import Linearity
    from eightpost.ident.vehicle.frequency_response import FrequencyResponse
    from eightpost.rig import DynoTest, PeakVelocityTable, RigTest
    from eightpost.signals import ChannelMap, TimeSeries
    from eightpost.signals.raw_record import RawRecord
    from eightpost.vehicle import Mode


@verb
def inspect(
    ctx: click.Context,
    files: tuple[Path, ...] = argument("FILE...", kind=FilePath()),
    folder: Path | None = option(
        "Output folder for pictures and tables of a vehicle, or of the linearity of rig tests; default: none are "
        "written.",
        "-o", "--output", kind=OutputFolder(),
    ),
    channels: Channels = CHANNELS,
    vary: str | None = option(
        "Parameter of a vehicle to vary at all four corners alike, e.g. damping, or with factors damping=0.5,1,2,3, "
        "which are the default; default: none.",
        metavar="PARAMETER[=FACTORS]",
    ),
    mass: float | None = setting(
        "Mass of the car on the rig, e.g. '3400 lbm', by which its forces are checked; default: unknown.",
        kind=Quantity("kg", positive=True),
    ),
    outputs: tuple[str, ...] = setting(
        "Output of a vehicle to draw, or of rig tests to judge, e.g. lf.tire_force; may be repeated. Default: shock "
        "velocities, tire forces and ride heights.",
        "channel",
    ),
    high: float = setting("Highest frequency.", kind=Quantity("Hz", bare=True), default="25 Hz"),
    how_file: Path | None = setting(
        "Linearity: file with rate, delays, geometry and other settings (docs/how_to/rig_data.md); default: "
        "decimation to 125 Hz only.",
        "preparation", kind=FilePath(),
    ),
    width: float = setting(
        "Linearity: width of the frequency bands in which the noise is estimated.",
        kind=Quantity("Hz", bare=True), default="0.5 Hz",
    ),
    coherence: float = setting("Linearity: lower limit of a high coherence, 0 to 1.", kind=Number(), default=0.5),
    level: float = setting(
        "Linearity: lower limit of a high response [dB], relative to the output's largest response.",
        kind=Number(), default=-20.0,
    ),
) -> None:  # fmt: skip
    """Show what a file contains, and everything suspicious in it.

    FILE is a record: a text file, a spreadsheet, a .parquet, .mat, .mf4, .tdms or .lvm file (docs/reference/
    dyno_files.md). First, columns, units and preamble are shown as they are in the file. Then a dynamometer file is
    read as `fit` reads it: channels, ranges, runs, temperature and notes. A rig file is read as `identify` reads it:
    channels, ranges, channels that are late, and channels that contradict mechanics. A rig file is recognized by its
    wheelloaders (`lf.road` or `road`, in the file or in the map); for one without these names, a channel map is
    proposed.

    Several rig files with one actuator each show where a linear model can predict the car: coherence against response
    energy, Table 6.4 of the dissertation (docs/explanation/linearity.md). Tests of several amplitudes, a baseline test
    with all actuators, and tests with another shock at one corner may be among them.

    A vehicle file (.toml, .json) shows its modes, with -o also frequency responses, and with --vary the effect of a
    parameter. FILE may also be a shock file, a system, an FMU, an SSP package, or the folder of a run or a study.

    The exit code is 0 if nothing is suspicious, 1 if something is suspicious or a linear model misses a high response,
    and 2 if the file cannot be used as it is.

    \b
    Examples:
      eightpost inspect run7.csv
      eightpost inspect run7.mf4 --channel 'force=-Force [lbf]'
      eightpost inspect rig.csv --channel my_map.toml --set mass='3400 lbm'
      eightpost inspect rig/*.parquet -o linearity/
      eightpost inspect car.toml --vary damping=0.5,1,2,3 -o responses/
      eightpost inspect dist/shock.fmu
    """
    console = Console(soft_wrap=True, highlight=False)
    if len(files) > 1:
        ctx.exit(
            _show_linearity(
                console, files, channels, folder,
                how=how_file, width=width, high=high, limits=(coherence, level), outputs=outputs,
            )
        )  # fmt: skip
    (path,) = files
    kind = _kind_of(path)
    if kind == "vehicle":
        _show_vehicle(console, path, folder, vary=vary, high=high, names=outputs)
        return
    if vary is not None:
        raise InputError(f"{path} is not a vehicle file, and --vary varies a parameter of one; omit it")
    if kind:
        _show_document(console, path, kind)
        return
    ctx.exit(int(_show_record_file(console, path, channels, mass)))


def _kind_of(path: Path) -> str:
    """Return the kind of a file of this project or of an FMU; an empty text for a record."""
    from eightpost.api.reading import existing, toml_kind
    from eightpost.app.report import is_study
    from eightpost.files import document_kind

    suffix = existing(path).suffix.lower()
    if path.is_dir():
        return "study" if is_study(path) else "run"
    if suffix == ".json":
        return {"shock": "shock", "vehicle": "vehicle"}.get(document_kind(path) or "", "")
    return toml_kind(path) if suffix == ".toml" else {".fmu": "fmu", ".ssp": "system", ".ssd": "system"}.get(suffix, "")


def _show_document(console: Console, path: Path, kind: str) -> None:
    """Print the summary of a file that has no channels."""
    from eightpost.api.reading import read
    from eightpost.app.show import show_verdict

    if kind == "fmu":
        console.print(escape(_fmu_summary(path)))
        return
    document = read(path / "results.parquet" if kind == "study" else path)
    console.print(escape(repr(document)))
    if kind == "shock" and (validity := getattr(document, "validity", None)):
        show_verdict(console, validity.verdict)


def _fmu_summary(path: Path) -> str:
    """Return version, interface and variables of an FMU of any maker."""
    from xml.etree import ElementTree

    from eightpost.archive import read_archive
    from eightpost.display import Summary, some
    from eightpost.fmi.description import read_description

    content = read_archive(path)
    root = ElementTree.fromstring(content["modelDescription.xml"])
    description = read_description(root)
    names = {
        causality: some([one.name for one in description.variables if one.causality == causality])
        for causality in ("input", "output", "parameter")
    }
    platforms = sorted({name.split("/")[1] for name in content if name.startswith("binaries/") and name.count("/") > 1})
    summary = Summary.of(
        f"{root.get('modelName')}: FMI {root.get('fmiVersion')}",
        ("made by", root.get("generationTool", "")),
        *((f"{causality}s", text) for causality, text in names.items()),
        ("platforms", ", ".join(platforms)),
    )
    return summary.text()


# ---- Records --------------------------------------------------------------------------------------------------------


def _show_record_file(console: Console, path: Path, channels: Channels, mass: float | None) -> bool:
    """Print a dynamometer file, a rig file or a table of peak velocities; return whether something is suspicious."""
    from eightpost.rig import read_dyno_tests, read_rig_test, split_runs
    from eightpost.rig.columns import propose_map
    from eightpost.rig.peak_velocity import read_peak_velocity
    from eightpost.rig.peak_velocity_columns import holds_peak_velocities
    from eightpost.rig.rig_test import rig_map
    from eightpost.signals import read_records

    channel_map = channels.channel_map
    records = read_records(path)
    for record in records:
        _show_record(console, record)
    if _is_rig(records[0], channel_map):
        _show_map(console, records[0], rig_map(records[0], channel_map).flipped(channels.flip))
        return _show_rig_test(console, read_rig_test(path, **channels.options), mass)
    if proposed := propose_map(records[0]):
        console.print("proposed channel map; check its columns, and the signs (docs/reference/signs_and_units.md):")
        console.print(f"\n{escape(proposed.toml())}\n")
        raise InputError(f"{path} {proposed.finding}; save its channel map as rig_map.toml in its folder, or pass the "
                         "map by --channel")  # fmt: skip
    if mass is not None:
        raise InputError(f"{path} is not a rig file, and mass is a setting of rig files; omit it")
    if holds_peak_velocities(records, channel_map):
        tables = read_peak_velocity(path, units=channels.units, channel_map=channel_map)
        for table in tables:
            show_table(console, table)
        return any(table.gas_force for table in tables)
    tests = read_dyno_tests(path, **channels.options)
    for test in tests:
        show_test(console, test)
    _show_runs(console, [run for test in tests for run in split_runs(test)])
    return any(test.warnings for test in tests)


def _show_record(console: Console, record: RawRecord) -> None:
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


def _show_runs(console: Console, runs: list[DynoTest]) -> None:
    """Print the runs, and the effect of temperature over repeated runs."""
    from eightpost.rig import temperature_effect
    from eightpost.rig.dyno_test import temperature_drift
    from eightpost.units import display_unit, shown

    rows = []
    for i, run in enumerate(runs, 1):
        series = run.series
        stroke = "-" if run.stroke is None else f"{shown(run.stroke, 'm')[0]:.4g}"
        drift = f"{temperature_drift(series):+.1f}" if "temperature" in series else "-"
        peaks = (f"{shown(float(abs(series[name]).max()), series.unit(name))[0]:.4g}" for name in ("velocity", "force"))
        rows.append((str(i), f"{series.time[0]:.4g}", f"{series.time[-1]:.4g}", stroke, *peaks, drift))
    units = {"from": "s", "to": "s", "stroke": display_unit("m"), "peak velocity": display_unit("m/s"),
             "peak force": display_unit("N"), "drift": "K"}  # fmt: skip
    columns = ["run", *(escape(f"{name} [{unit}]") for name, unit in units.items())]
    console.print(console_table(columns, rows))
    effect = temperature_effect(runs)
    if effect:
        console.print(escape(str(effect)))


def show_table(console: Console, table: PeakVelocityTable) -> None:
    """Print a peak-velocity table's setting and ranges."""
    from eightpost.units import shown

    name = " ".join(("peak-velocity table", table.clicks or "")).strip()
    (low, speed), (high, _) = (shown(float(table.speed[end]), "m/s") for end in (0, -1))
    (most, force), (least, _) = (shown(float(end), "N") for end in (table.compression.max(), table.rebound.min()))
    console.print(
        f"{escape(name)}: {len(table)} speeds, {low:.4g} to {high:.4g} {speed}; compression to {most:.4g} {force}, "
        f"rebound to {least:.4g} {force}"
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
    from eightpost.units import convert, display_unit

    rows = []
    for name, si, values in zip(series.names, series.units, series.values, strict=True):
        unit = display_unit(si)
        drawn = convert(values, si, unit)
        figures = {"minimum": drawn.min(), "maximum": drawn.max(), "mean": drawn.mean(), "std": drawn.std()}
        rows.append((name, unit, *(f"{figures[statistic]:.5g}" for statistic in statistics)))
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


# ---- Vehicles -------------------------------------------------------------------------------------------------------


def _show_vehicle(
    console: Console, path: Path, folder: Path | None, *, vary: str | None, high: float, names: Sequence[str]
) -> None:
    """Print the modes of a vehicle with its linear dampers; with a folder, write pictures and response.npz."""
    from eightpost.ident.vehicle.frequency_response import response_of, write_response
    from eightpost.ident.vehicle.plots import frequencies_to, plot_magnitudes, variants_of
    from eightpost.vehicle import StructuralVehicle, read_vehicle
    from eightpost.vehicle.structural import doubts

    frequency = frequencies_to(high)
    parameter, factors = _varied(vary)
    car = read_vehicle(path)
    console.print(f"read {path}: {car.name} ({car.model}), with its dampers")
    for doubt in doubts(car.parameters) if isinstance(car, StructuralVehicle) else ():
        warn(f"{doubt.summary}; {doubt.remedy}")
    variants = variants_of(car, parameter, factors, frequency)
    responses = {label: variant.response for label, variant in variants.items()}
    chosen = _outputs(next(iter(responses.values())), names)
    console.print(_mode_table({label: variant.modes for label, variant in variants.items()}))
    if folder is None:
        return
    completion.begin(folder)
    for name in chosen:
        plot_magnitudes(responses, name, folder / f"{name}.png")
    write_response(folder / "response.npz", response_of(car.with_damper(), frequency))
    console.print(f"wrote response.npz and {len(chosen)} pictures in {folder}")


def _mode_table(modes: Mapping[str, tuple[Mode, ...]]) -> Table:
    """Return a table with frequency and damping ratio of every mode, a column for each variant."""
    rows = [
        (str(number + 1), *(_mode_text(variant[number]) if number < len(variant) else "" for variant in modes.values()))
        for number in range(max(len(variant) for variant in modes.values()))
    ]
    return console_table(["mode", *unbroken(*modes)], rows)


def _mode_text(mode: Mode) -> str:
    from eightpost.units import convert

    return f"{mode.frequency_hz:.3f} Hz {convert(mode.damping_ratio, '1', '%'):.2f} %"


def _outputs(response: FrequencyResponse, names: Sequence[str]) -> list[str]:
    from eightpost.ident.vehicle.plots import KEY_OUTPUTS

    if not names:
        return [name for name in response.output_names if name.endswith(KEY_OUTPUTS)]
    return list(response.select(outputs=names).output_names)


def _varied(vary: str | None) -> tuple[str | None, list[float]]:
    """Return the parameter to vary and its factors."""
    parameter, _, factors = (vary or "").partition("=")
    try:
        return parameter or None, list(dict.fromkeys(float(part) for part in (factors or "0.5,1,2,3").split(",")))
    except ValueError:
        raise InputError(f"--vary {vary}: give numbers separated by commas, e.g. damping=0.5,1,2") from None


# ---- Linearity of rig tests -----------------------------------------------------------------------------------------


def _show_linearity(
    console: Console, files: Sequence[Path], channels: Channels, folder: Path | None, *,
    how: Path | None, width: float, high: float, limits: tuple[float, float], outputs: tuple[str, ...],
) -> int:  # fmt: skip
    """Print where a linear model can predict the tests; return 1 if it misses a high response."""
    from eightpost.ident.linearity import Condition, Thresholds, judge_linearity
    from eightpost.ident.preparation import prepare, read_preparation
    from eightpost.ident.vehicle.estimators import LocalPolynomial

    prepared = prepare(_tests(files, channels), read_preparation(how) if how else None)
    for line in prepared.summary():
        console.print(line, markup=False)
    recipe = LocalPolynomial.of_width(width, high)
    assessment = judge_linearity(prepared, outputs=outputs, recipe=recipe, thresholds=Thresholds(*limits))
    _show_conditions(console, assessment)
    if folder is not None:
        completion.begin(folder)
        _write_linearity(folder, assessment, prepared.sources)
        console.print(f"wrote paths.csv, amplitude.csv and pictures in {folder}")
    lost = any(verdict.condition is Condition.III for verdict in assessment.verdicts)
    return int(lost or any(effect.is_notable for effect in assessment.effects))


def _write_linearity(folder: Path, assessment: Linearity, sources: Mapping[str, str]) -> None:
    from eightpost.ident.linearity_plots import plot_conditions, plot_output, write_effects, write_paths

    write_paths(folder / "paths.csv", assessment, sources=sources)
    plot_conditions(assessment, folder / "conditions.png")
    for output in assessment.outputs:
        plot_output(assessment, output, folder / f"{output}.png")
    if assessment.effects:
        write_effects(folder / "amplitude.csv", assessment)


def _tests(files: Sequence[Path], channels: Channels) -> Iterator[RigTest]:
    from eightpost.rig import read_rig_test

    for path in each(Console(stderr=True), files, "reading", len(files)):
        yield read_rig_test(path, **channels.options)


def _show_conditions(console: Console, assessment: Linearity) -> None:
    from eightpost.ident.linearity import Condition
    from eightpost.units import convert

    console.print(_condition_table(assessment))
    for kind in Condition:
        console.print(f"{kind.name}: {kind.meaning}", markup=False)
    for output in assessment.outputs:
        lost = max(
            (each for each in assessment.verdicts if each.output == output), key=lambda v: v.shares[Condition.III]
        )
        share = convert(lost.shares[Condition.III], "1", "%")
        if share >= 1.0:
            console.print(
                f"{output}: {share:.1f} % of its energy from {lost.input} is not predictable (III)", markup=False
            )
    for effect in assessment.effects:
        if effect.is_notable:
            console.print(str(effect), markup=False)
    for note in assessment.notes:
        console.print(f"note: {note}", markup=False)


def _condition_table(assessment: Linearity) -> Table:
    """Return a table with condition and mean coherence of every path, a row for each output."""
    rows = []
    for output in assessment.outputs:
        verdicts = [assessment.verdict(output, name) for name in assessment.inputs]
        rows.append((output, *(f"{each.condition.name}\n{each.coherence:.2f}" for each in verdicts)))
    return console_table(["output", *(name.replace(".", "\n") for name in assessment.inputs)], rows, box=SIMPLE)
