"""`eightpost inspect`: what a file contains, and everything suspicious in it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import click
from rich.box import SIMPLE
from rich.console import Console
from rich.markup import escape

from eightpost import completion
from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import FilePath, Number, OutputFolder, Quantity, argument, group, option, setting, verb, warn
from eightpost.app.show import (
    details,
    each,
    is_detailed,
    show_files,
    show_notes,
    show_summary,
    show_table,
    show_text,
    show_verdict,
)
from eightpost.errors import InputError
from eightpost.report.console import Table, console_table, unbroken

if TYPE_CHECKING:
    from eightpost.display import Summary
    from eightpost.ident.linearity import Linearity
    from eightpost.ident.vehicle.frequency_response import FrequencyResponse
    from eightpost.rig import DynoTest, PeakVelocityTable, RigTest
    from eightpost.rig.columns import ProposedMap
    from eightpost.rig.faults import Fault
    from eightpost.signals import ChannelMap, TimeSeries
    from eightpost.signals.raw_record import RawRecord
    from eightpost.vehicle import Mode


#: Numbers of columns and of peak-velocity tables that are shown without -v, and the share of energy above which a path
#: is reported.
_FEW, _TABLES, _LOST = 8, 4, 0.01


@dataclass(frozen=True, slots=True)
class _InspectOptions:
    """Options of `eightpost inspect`."""

    # fmt: off
    files: tuple[Path, ...] = argument("FILE...", kind=FilePath())
    folder: Path | None = option(
        "Output folder for pictures and tables of a vehicle, for those of the linearity of rig tests, or for the "
        "proposed channel map of a rig file; default: none are written.",
        "-o", "--output", kind=OutputFolder(),
    )
    channels: Channels = CHANNELS
    vary: str | None = option(
        "Parameter of a vehicle to vary at all four corners alike, e.g. damping, or with factors damping=0.5,1,2,3, "
        "which are the default; default: none.",
        metavar="PARAMETER[=FACTORS]",
    )
    mass: float | None = setting(
        "Mass of the car on the rig, e.g. '3400 lbm', by which its forces are checked; default: unknown.",
        kind=Quantity("kg", positive=True),
    )
    outputs: tuple[str, ...] = setting(
        "Output of a vehicle to draw, or of rig tests to judge, e.g. lf.tire_force; may be repeated. Default: shock "
        "velocities, tire forces and ride heights.",
        "channel",
    )
    high: float = setting("Highest frequency.", kind=Quantity("Hz", bare=True), default="25 Hz")
    how_file: Path | None = setting(
        "Linearity: file with rate, delays, geometry and other settings (docs/how_to/rig_data.md); default: "
        "decimation to 125 Hz only.",
        "preparation", kind=FilePath(),
    )
    width: float = setting(
        "Linearity: width of the frequency bands in which the noise is estimated.",
        kind=Quantity("Hz", bare=True), default="0.5 Hz",
    )
    coherence: float = setting("Linearity: lower limit of a high coherence, 0 to 1.", kind=Number(), default=0.5)
    level: float = setting(
        "Linearity: lower limit of a high response [dB], relative to the output's largest response.",
        kind=Number(), default=-20.0,
    )
    # fmt: on


@verb
def inspect(ctx: click.Context, asked: _InspectOptions = group(_InspectOptions)) -> None:
    """Show what a file contains, and everything suspicious in it.

    FILE is a record: a text file, a spreadsheet, a .parquet, .mat, .mf4, .tdms or .lvm file (docs/reference/
    dyno_files.md). First, columns, units and preamble are shown as they are in the file. Then a dynamometer file is
    read as `fit` reads it: channels, ranges, runs, temperature and notes. A rig file is read as `identify` reads it:
    channels, ranges, channels that are late, and channels that contradict mechanics. A rig file is recognized by its
    wheelloaders (`lf.road` or `road`, in the file or in the map); for one without these names, a channel map is
    proposed. A drive file has channels of actuators only, and its ranges are shown.

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
    console = Console(highlight=False)
    if len(asked.files) > 1:
        ctx.exit(_show_linearity(console, asked))
    (path,) = asked.files
    kind = _kind_of(path)
    if kind == "vehicle":
        _show_vehicle(console, path, asked)
        return
    if asked.vary is not None:
        raise InputError(f"{path} is not a vehicle file, and --vary varies a parameter of one; omit it")
    if kind:
        _show_document(console, path, kind)
        return
    found = _show_record_file(console, path, asked)
    show_text(console, "There are warnings." if found else "No warnings.", style="bold")
    ctx.exit(int(found))


def _kind_of(path: Path) -> str:
    """Return the kind of a file of this project or of an FMU; an empty text for a record."""
    from eightpost.api.reading import existing, toml_kind
    from eightpost.app.fit import is_study
    from eightpost.files import document_kind

    suffix = existing(path).suffix.lower()
    if path.is_dir():
        return "study" if is_study(path) else "run"
    if suffix == ".json":
        return {"shock": "shock", "vehicle": "vehicle"}.get(document_kind(path) or "", "")
    kind = toml_kind(path) if suffix == ".toml" else ""
    if kind == "study":
        raise InputError(f"{path} defines a study: run it with study -o FOLDER, and inspect the folder")
    return kind or {".fmu": "fmu", ".ssp": "system", ".ssd": "system"}.get(suffix, "")


def _show_document(console: Console, path: Path, kind: str) -> None:
    """Print the summary of a file that has no channels."""
    from eightpost.api.reading import read

    if kind == "fmu":
        show_summary(console, *_fmu_summary(path))
        return
    document = read(path / "results.parquet" if kind == "study" else path)
    validity = getattr(document, "validity", None) if kind == "shock" else None
    title, rows = document._summary()
    show_summary(console, title, [row for row in rows if validity is None or row[0] not in ("verdict", "reason")])
    if validity:
        show_verdict(console, validity.verdict)


def _fmu_summary(path: Path) -> Summary:
    """Return version, interface and variables of an FMU of any maker."""
    from xml.etree import ElementTree

    from eightpost.archive import read_archive
    from eightpost.display import Summary, some
    from eightpost.fmi import read_description

    content = read_archive(path)
    root = ElementTree.fromstring(content["modelDescription.xml"])
    description = read_description(root)
    names = {
        causality: some([one.name for one in description.variables if one.causality == causality])
        for causality in ("input", "output", "parameter")
    }
    platforms = sorted({name.split("/")[1] for name in content if name.startswith("binaries/") and name.count("/") > 1})
    return Summary.of(
        f"{root.get('modelName')}: FMI {root.get('fmiVersion')}",
        ("made by", root.get("generationTool", "")),
        *((f"{causality}s", text) for causality, text in names.items()),
        ("platforms", ", ".join(platforms)),
    )


# ---- Records --------------------------------------------------------------------------------------------------------


def _show_record_file(console: Console, path: Path, asked: _InspectOptions) -> bool:
    """Print a dynamometer file, a rig file or a table of peak velocities; return whether something is suspicious."""
    from eightpost.rig import read_dyno_tests, read_rig_test, split_runs
    from eightpost.rig.columns import propose_map
    from eightpost.rig.peak_velocity import read_peak_velocity
    from eightpost.rig.peak_velocity_columns import holds_peak_velocities
    from eightpost.rig.rig_test import is_drive, rig_map
    from eightpost.signals import read_records

    channels, mass, channel_map = asked.channels, asked.mass, asked.channels.channel_map
    records = read_records(path)
    for record in records:
        _show_record(console, record)
    if _is_rig(records[0], channel_map):
        mapping = rig_map(records[0], channel_map).flipped(channels.of(path)["flip"])
        _show_map(console, records[0], mapping)
        if is_drive(records[0], mapping):
            _show_drive(console, records[0], mapping, channels.units)
            return False
        return _show_rig_test(console, read_rig_test(path, keep=False, **channels.of(path)), mass)
    if proposed := propose_map(records[0]):
        _show_proposed(console, path, proposed, asked.folder)
    if mass is not None:
        raise InputError(f"{path} is not a rig file, and mass is a setting of rig files; omit it")
    if holds_peak_velocities(records, channel_map):
        tables = read_peak_velocity(path, units=channels.units, channel_map=channel_map)
        shown = tables if is_detailed() else tables[:_TABLES]
        for table in shown:
            _show_peaks(console, table)
        if len(tables) > len(shown):
            show_text(console, f"{len(shown)} of {len(tables)} tables; -v shows all", begin="  ")
        return any(table.gas_force for table in tables)
    tests = read_dyno_tests(path, **channels.of(path))
    for test in tests:
        show_test(console, test)
    _show_runs(console, [run for test in tests for run in split_runs(test)])
    return any(test.warnings for test in tests)


def _show_proposed(console: Console, path: Path, proposed: ProposedMap, folder: Path | None) -> NoReturn:
    """Write a proposed channel map into a folder, or show it with -v; then refuse the file, which needs a map."""
    channels = proposed.toml()
    more = details(console)
    more.print("proposed channel map; check its columns, and the signs (docs/reference/signs_and_units.md):")
    more.print(f"\n{escape(channels)}\n")
    if folder is None:
        where = "write its channel map into its folder with -o FOLDER (-v shows it), and check columns and signs"
        raise InputError(f"{path} {proposed.finding}; {where}")
    from eightpost.files import write_text
    from eightpost.signals.raw_record import MAP_BESIDE

    target = folder / MAP_BESIDE
    if target.exists():
        raise InputError(f"{path} {proposed.finding}; {target} exists and is not replaced: correct it, or name it with "
                         "--channel")  # fmt: skip
    show_files(console, [write_text(target, channels)])
    again = "" if folder.resolve() == path.resolve().parent else f" with --channel {target}"
    raise InputError(f"{path} {proposed.finding}; check columns and signs of {target}, and inspect again{again}")


def _show_record(console: Console, record: RawRecord) -> None:
    """Print the columns of a table as they are in the file; with -v, also its preamble."""
    line = f", header in line {record.origin.header_line}" if record.origin.header_line else ""
    columns = [f"{name} [{unit}]" if unit else f"{name} (no unit)"
               for name, unit in zip(record.names, record.units, strict=True)]  # fmt: skip
    show_summary(
        console, f"{record.origin.path}{line}: {record.columns[0].size} samples",
        [("columns", ", ".join(columns) if len(columns) <= _FEW or is_detailed() else f"{len(columns)}")],
    )  # fmt: skip
    for cells in record.preamble:
        details(console).print(f"  {escape(' | '.join(cells))}", style="dim")


def show_test(console: Console, test: DynoTest) -> None:
    """Print the ranges of a test, its lag, its conditions and its notes."""
    from eightpost.rig.motion import lag_statement

    series = test.series
    show_text(console, f"{series.duration:.4g} s at {series.sample_rate:.6g} Hz")
    if is_detailed():
        console.print(_channel_table(series, ("minimum", "maximum", "mean")))
    rows = [("ranges", "" if is_detailed() else _ranges(series)), ("stated", "; ".join(_conditions(test)))]
    show_summary(console, "", rows)
    show_text(console, lag_statement(series))
    show_notes(console, (*test.derived, *test.remarks), most=1)
    show_notes(console, test.warnings, "warning")


def _ranges(series: TimeSeries) -> str:
    """Return the range of each channel in a sentence."""
    from eightpost.units import shown

    parts = []
    for name, si in zip(series.names, series.units, strict=True):
        values = series[name]
        (low, unit), (high, _) = (shown(float(end), si) for end in (values.min(), values.max()))
        parts.append(f"{name} {low:.4g} to {high:.4g} {unit}")
    return ", ".join(parts)


def _conditions(test: DynoTest) -> list[str]:
    from eightpost.rig.dyno_test import temperature_drift
    from eightpost.units import shown, shown_difference

    def text(value: float | None, unit: str) -> str | None:
        return None if value is None else "{:.4g} {}".format(*shown(value, unit))

    known = test.conditions
    values = {
        "run": known.run,
        "date": known.date,
        "build": known.build,
        "clicks": known.clicks,
        "gas pressure": text(known.gas_pressure, "Pa"),
        "gas force": text(known.gas_force, "N"),
        "temperature at the start": text(known.temperature, "K"),
    }
    lines = [f"{name}: {value}" for name, value in values.items() if value is not None]
    if "temperature" in test.series:
        lines.append("temperature drift: {:+.1f} {}".format(*shown_difference(temperature_drift(test.series))))
    return lines


def _show_runs(console: Console, runs: list[DynoTest]) -> None:
    """Print the runs, and the effect of temperature over repeated runs."""
    from eightpost.rig import temperature_effect
    from eightpost.rig.dyno_test import temperature_drift
    from eightpost.units import display_unit, shown, shown_difference

    rows = []
    for i, run in enumerate(runs, 1):
        series = run.series
        stroke = "-" if run.stroke is None else f"{shown(run.stroke, 'm')[0]:.4g}"
        drift = f"{shown_difference(temperature_drift(series))[0]:+.1f}" if "temperature" in series else "-"
        peaks = (f"{shown(float(abs(series[name]).max()), series.unit(name))[0]:.4g}" for name in ("velocity", "force"))
        rows.append((str(i), f"{series.time[0]:.4g}", f"{series.time[-1]:.4g}", stroke, *peaks, drift))
    units = {"from": "s", "to": "s", "stroke": display_unit("m"), "peak velocity": display_unit("m/s"),
             "peak force": display_unit("N"), "drift": shown_difference(0.0)[1]}  # fmt: skip
    columns = ["run", *(escape(f"{name} [{unit}]") for name, unit in units.items())]
    if len(runs) > 1 or is_detailed():
        show_table(console, console_table(columns, rows), most=2)
    effect = temperature_effect(runs)
    if effect:
        show_text(console, str(effect))


def _show_peaks(console: Console, table: PeakVelocityTable) -> None:
    """Print a peak-velocity table's setting and ranges."""
    from eightpost.units import shown

    name = " ".join(("peak-velocity table", table.clicks or "")).strip()
    (low, speed), (high, _) = (shown(float(table.speed[end]), "m/s") for end in (0, -1))
    (most, force), (least, _) = (shown(float(end), "N") for end in (table.compression.max(), table.rebound.min()))
    show_text(
        console, f"{name}: {len(table)} speeds, {low:.4g} to {high:.4g} {speed}; compression to {most:.4g} {force}, "
        f"rebound to {least:.4g} {force}",
    )  # fmt: skip
    show_notes(console, table.notes)
    if table.gas_force:
        gas, _ = shown(table.gas_force, "N")
        text = (
            f"gas force {gas:.4g} {force} in the table, found from {table.gas_source}; "
            "it is subtracted from both strokes and becomes the gas preload of the shock"
        )
        show_notes(console, [text], "warning")


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
        show_text(console, f"channel map{path}: {', '.join(named)}")
    read = {pick.source for pick in picks.values()} | {mapping.time.source if mapping.time else ""}
    if left := [name for name in record.names if name not in read]:
        show_text(console, f"columns that are not read: {', '.join(left)}", lines=1)


def _show_drive(console: Console, record: RawRecord, mapping: ChannelMap, units: Mapping[str, str] | None) -> None:
    """Print length, rate and ranges of a drive file."""
    from eightpost.rig.rig_test import CHANNEL_UNITS
    from eightpost.signals.raw_record import mapped_series

    series = mapped_series(record, mapping, units=units, expected=CHANNEL_UNITS, keep=False)
    show_text(console, f"{series.duration:.4g} s at {series.sample_rate:.6g} Hz, {len(series.names)} channels: a drive "
              "file, which has motions and loads of actuators, and no response of a car")  # fmt: skip
    details(console).print(_channel_table(series, ("minimum", "maximum", "mean", "std")))
    show_summary(console, "", [("ranges", "" if is_detailed() else _ranges(series))])


def _show_rig_test(console: Console, test: RigTest, mass: float | None) -> bool:
    """Print channels, conditions and lags of a rig test; return whether something is suspicious."""
    from eightpost.ident.preparation import check_lost_channels
    from eightpost.ident.preparation.plausibility import record_findings

    series = test.series
    check_lost_channels(series, test.corners, path=test.source)
    show_text(
        console, f"{series.duration:.4g} s at {series.sample_rate:.6g} Hz, corners {' '.join(test.corners) or 'one'}, "
        f"{len(series.names)} channels",
    )  # fmt: skip
    more = details(console)
    more.print(_channel_table(series, ("minimum", "maximum", "mean", "std")))
    known = test.conditions
    show_text(console, known.synthetic, lines=1)
    for line in (known.truth, known.drivefile, ", ".join(known.shocks)):
        show_text(more, line)
    show_notes(console, (*test.notes, *test.derived), most=1)
    findings = record_findings(series, test.corners, mass=mass)
    late = _show_lags(more, test, findings)
    warnings = [*map(str, findings), *late]
    show_notes(console, warnings, "warning")
    return bool(warnings)


def _channel_table(series: TimeSeries, statistics: Sequence[str]) -> Table:
    """Return a table with a row for each channel and a column for each statistic: minimum, maximum, mean, std."""
    from eightpost.units import convert, display_unit

    rows = []
    for name, si in zip(series.names, series.units, strict=True):
        unit = display_unit(si)
        drawn = convert(series[name], si, unit)
        figures = {"minimum": drawn.min(), "maximum": drawn.max(), "mean": drawn.mean(), "std": drawn.std()}
        rows.append((name, unit, *(f"{figures[statistic]:.5g}" for statistic in statistics)))
    return console_table(["channel", "unit", *statistics], rows)


def _show_lags(console: Console, test: RigTest, findings: Sequence[Fault]) -> list[str]:
    """Print the lags; return a warning for each late or drifting channel that no finding explains."""
    from eightpost.ident.preparation import drifts, record_lags
    from eightpost.ident.preparation.preparation import unexplained_lags

    lags, changes = record_lags(test.series, test.corners), drifts(test.series, test.corners)
    late = unexplained_lags(lags, findings)
    for lag in lags:
        show_text(console, str(lag))
    advice = "; shift the channels of a late logger with delays (docs/how_to/rig_data.md)"
    return [*(f"{lag}{advice}" for lag in late), *(f"from start to end {drift.drift_text}" for drift in changes)]


# ---- Vehicles -------------------------------------------------------------------------------------------------------


def _show_vehicle(console: Console, path: Path, asked: _InspectOptions) -> None:
    """Print the modes of a vehicle with its linear dampers; with a folder, write pictures and response.npz."""
    from eightpost.ident.vehicle.frequency_response import response_of, write_response
    from eightpost.ident.vehicle.variants import frequencies_to, variants_of
    from eightpost.vehicle import StructuralVehicle, read_vehicle
    from eightpost.vehicle.structural import doubts

    frequency, folder = frequencies_to(asked.high), asked.folder
    parameter, factors = _varied(asked.vary)
    car = read_vehicle(path)
    show_text(console, f"read {path}: {car.name} ({car.model}), with its dampers")
    for doubt in doubts(car.parameters) if isinstance(car, StructuralVehicle) else ():
        warn(f"{doubt.summary}; {doubt.remedy}")
    variants = variants_of(car, parameter, factors, frequency)
    responses = {label: variant.response for label, variant in variants.items()}
    chosen = _outputs(next(iter(responses.values())), asked.outputs)
    show_table(console, _mode_table({label: variant.modes for label, variant in variants.items()}), most=7)
    if folder is None:
        return
    from eightpost.ident.vehicle.plots import plot_magnitudes

    completion.begin(folder)
    for name in chosen:
        plot_magnitudes(responses, name, folder / f"{name}.png")
    write_response(folder / "response.npz", response_of(car.with_damper(), frequency))
    show_files(console, [folder / "response.npz"], f" and {len(chosen)} pictures")


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
    from eightpost.ident.vehicle.frequency_response import KEY_OUTPUTS

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


def _show_linearity(console: Console, asked: _InspectOptions) -> int:
    """Print where a linear model can predict the tests; return 1 if it misses a high response."""
    from eightpost.ident.linearity import Condition, Thresholds, judge_linearity
    from eightpost.ident.preparation import prepare, read_preparation
    from eightpost.ident.vehicle.estimators import LocalPolynomial

    how = read_preparation(asked.how_file) if asked.how_file else None
    prepared = prepare(_tests(asked.files, asked.channels), how)
    for line in prepared.summary():
        show_text(details(console), line)
    recipe, limits = LocalPolynomial.of_width(asked.width, asked.high), Thresholds(asked.coherence, asked.level)
    assessment = judge_linearity(prepared, outputs=asked.outputs, recipe=recipe, thresholds=limits)
    _show_conditions(console, assessment)
    if asked.folder is not None:
        completion.begin(asked.folder)
        _write_linearity(asked.folder, assessment, prepared.sources)
        show_files(console, [asked.folder / "paths.csv", asked.folder / "amplitude.csv"], " and pictures")
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
        yield read_rig_test(path, **channels.of(path))


def _show_conditions(console: Console, assessment: Linearity) -> None:
    from eightpost.ident.linearity import Condition
    from eightpost.units import convert

    details(console).print(_condition_table(assessment))
    for kind in Condition:
        count = sum(verdict.condition is kind for verdict in assessment.verdicts)
        show_text(console, f"{kind.name}: {count} of {len(assessment.verdicts)} paths, {kind.meaning}")
    lost = [each for each in assessment.verdicts if each.shares[Condition.III] >= _LOST]
    lost.sort(key=lambda verdict: -verdict.shares[Condition.III])
    worst = {each.output: each for each in reversed(lost)}.values()
    texts = [
        f"{each.output}: {convert(each.shares[Condition.III], '1', '%'):.1f} % of its energy from {each.input} is not "
        "predictable (III)"
        for each in sorted(worst, key=lambda verdict: -verdict.shares[Condition.III])
    ]
    show_notes(console, texts, "warning")
    show_notes(console, (str(effect) for effect in assessment.effects if effect.is_notable), "warning", most=1)
    show_notes(console, assessment.notes, most=1)


def _condition_table(assessment: Linearity) -> Table:
    """Return a table with condition and mean coherence of every path, a row for each output."""
    rows = []
    for output in assessment.outputs:
        verdicts = [assessment.verdict(output, name) for name in assessment.inputs]
        rows.append((output, *(f"{each.condition.name}\n{each.coherence:.2f}" for each in verdicts)))
    return console_table(["output", *(name.replace(".", "\n") for name in assessment.inputs)], rows, box=SIMPLE)
