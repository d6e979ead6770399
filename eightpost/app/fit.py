"""`eightpost fit` and `report`: laws of shocks from dynamometer records, and pages about shocks or a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import (
    Assignment,
    FilePath,
    LawName,
    Number,
    OutputFile,
    Quantity,
    argument,
    group,
    option,
    setting,
    verb,
)
from eightpost.app.show import (
    bar,
    details,
    is_detailed,
    show_files,
    show_notes,
    show_summary,
    show_table,
    show_text,
    show_verdict,
)
from eightpost.errors import InputError
from eightpost.outputs import PAGE, PICTURE, SHOCK
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from eightpost.array_types import Array
    from eightpost.ident import ShockFit
    from eightpost.ident.dyno_report.builds import CarCorner, Reading
    from eightpost.ident.dyno_report.entry import Entry
    from eightpost.ident.shock.force import GasTreatment
    from eightpost.ident.shock.law_fit import RecipeName
    from eightpost.ident.shock.settings_table import SettingsTable
    from eightpost.least_squares import Robust
    from eightpost.rig import DynoConditions, DynoTest, PeakVelocityTable


RECIPES = ("joint", "boggs")
WEIGHTINGS = ("auto", "none", "huber", "tukey")
GAS_TREATMENTS = ("estimate", "included", "subtracted")


@dataclass(frozen=True, slots=True)
class FitOptions:
    """Options of `eightpost fit`."""

    # fmt: off
    dyno_files: tuple[Path, ...] = argument("DYNO...", kind=FilePath())
    law: str | None = option(
        "Shock law to fit (docs/explanation/shock_law.md); default: hysteresis, with --set recipe=boggs lpnl2, for a "
        "peak-velocity table polylinear.",
        kind=LawName(),
    )
    output: Path = option(
        "Output shock file; default: the name of the first DYNO with the suffix .json (of a .json file _shock.json), "
        "in the current folder.",
        "-o", "--output", kind=OutputFile(SHOCK, default=lambda given: Path(f"{given['dyno_files'][0].stem}.json")),
    )
    gas: GasTreatment = option(
        "Gas force in the force channel. estimate: it is fitted and kept in the shock. included: it is fitted and "
        "left out of the shock, because the static load of the car already counts it. subtracted: the dynamometer "
        "already subtracted it, so it is not fitted.",
        kind=GAS_TREATMENTS, default="estimate",
    )
    channels: Channels = CHANNELS
    split: bool = option("Split each record at its pauses and where a sine changes, and fit the parts as runs.")
    builds: tuple[str, ...] = option(
        "Team's own name for the shock build, or for that of a file, e.g. run7.csv='front 3'; may be repeated. "
        "Default: that in the file. Records of several builds are fitted together, and the shock file states their "
        "spread.",
        "--build", metavar="[FILE=]NAME",
    )
    plot: Path | None = option(
        "Picture of the curves, or of the map over clicks; default: none.", kind=OutputFile(PICTURE)
    )
    recipe: RecipeName = setting(
        "Order of the fit. joint: all parameters together, a curve through knots. boggs: one after the other, a curve "
        "of polynomials, as in 3.3.",
        kind=RECIPES, default="joint",
    )
    robust: Robust = setting(
        "Weighting of outliers. auto: outliers are down-weighted if there are any. none: no weighting. huber, tukey: "
        "always weighted by this function.",
        kind=WEIGHTINGS, default="auto",
    )
    segment: tuple[float, float] | None = setting(
        "Start and end of the part of the record to fit, e.g. segment='1 s, 10 s', which is the default.",
        kind=Quantity("s", bare=True), nargs=2,
    )
    cutoff: float | None = setting(
        "Cut-off frequency of the low-pass on model and data; default '50 Hz'.", kind=Quantity("Hz", bare=True)
    )
    name: str | None = setting("Name of the shock; default: the name of the file.")
    clicks: str | None = setting(
        "Settings of the adjusters and how they are counted, e.g. '14 from closed, rebound'; default: those in the "
        "file.",
    )
    gas_pressure: float | None = setting(
        "Gas pressure of the shock, e.g. '150 psi'; default: that in the file.", kind=Quantity("Pa")
    )
    # fmt: on


@verb
def fit(ctx: click.Context, asked: FitOptions = group(FitOptions)) -> None:
    """Fit a shock law to dynamometer records: one, several runs together, or one shock over its adjusters.

    DYNO is a text file, spreadsheet, .parquet, .mat, .json, .mf4, .tdms or .lvm file with time, force, and velocity or
    displacement (docs/reference/dyno_files.md). Units are in its header, in a channel map, or given by --channel. A
    table of forces over peak velocities gives a polylinear shock for each setting of the adjusters.

    One shock over its clicks, valving or temperature (docs/how_to/settings.md): DYNO is a TOML table that lists the
    files with their settings, or the names of the files state them (2clicks.csv, 1.5A.csv). Its FMU has the clicks and
    the temperature as parameters.

    The exit code is 1 if the shock is not usable (docs/reference/verdict.md).

    \b
    Examples:
      eightpost fit dyno.csv -o shock.json
      eightpost fit run1.csv run2.csv --law lpf1 -o shock.json
      eightpost fit sines.csv --split -o shock.json
      eightpost fit a.csv b.csv --build a.csv='front 1' --build b.csv='front 2' -o front.json
      eightpost fit peak_velocities.csv -o shock.json
      eightpost fit rebound.toml -o shock.json
      eightpost fit 0.3A.csv 0.9A.csv 1.6A.csv -o shock.json
      eightpost fit run7.csv --channel 'force=-Force [lbf]' --gas included -o dist/run7.json
    """
    if asked.plot is not None:
        import eightpost.report.pictures  # noqa: F401 -- refuses a picture that cannot be drawn before the fit
    ctx.exit(0 if _fit(Console(), asked).is_acceptable else 1)


def _fit(console: Console, asked: FitOptions) -> Verdict:
    """Fit what the files contain, and return the verdict."""
    from eightpost.ident.shock.peak_velocity import builds_in, tables_in

    files, channels = asked.dyno_files, asked.channels
    if table := _settings_table(asked):
        return _fit_settings(console, table, asked)
    build, of_files = _builds(asked.builds, files)
    if of_builds := builds_in(files, dict(channels.units), of_files, channels.channel_map):
        _check_law_of_tables(asked.law)
        return _fit_builds(console, of_builds, asked)
    if tables := tables_in(files, dict(channels.units), channels.channel_map):
        _check_law_of_tables(asked.law)
        return _fit_tables(console, tables, asked, build)
    return _fit_records(console, asked, build, of_files)


# ---- Over adjusters and temperature ---------------------------------------------------------------------------------


def _settings_table(asked: FitOptions) -> SettingsTable | None:
    """Return the settings of a TOML table, or of the names of several files; None if the files are runs of a shock."""
    files, has_columns, is_plain = asked.dyno_files, asked.channels.is_stated, not (asked.split or asked.builds)
    is_table = len(files) == 1 and files[0].suffix.lower() == ".toml"
    if len(files) == 1 and not is_table:
        return None
    from eightpost.ident.shock.settings_table import read_settings_table, settings_of_names, states_settings

    if is_table:
        if has_columns or not is_plain:
            raise InputError(f"{files[0]} states columns, units, signs and builds: omit --channel, --build and --split")
        return read_settings_table(files[0], cutoff=asked.cutoff)
    if is_plain and not has_columns and states_settings(files):
        return settings_of_names(files, cutoff=asked.cutoff)
    return None


def _fit_settings(console: Console, table: SettingsTable, asked: FitOptions) -> Verdict:
    """Fit one shock over its settings, and print the errors at each of them."""
    from eightpost.ident.shock.plots import plot_click_map
    from eightpost.ident.shock.settings import fit_settings, settings_table
    from eightpost.shock import write_shock

    for note in table.notes:
        show_text(details(console), f"note {note}")
    shock_fit = fit_settings(table, law=asked.law, segment=asked.segment, cutoff=asked.cutoff)
    show_table(console, settings_table(shock_fit), most=5)
    for change in shock_fit.shock.fit["changes"]:
        details(console).print(f"[yellow]changed[/] {escape(change)}", highlight=False, soft_wrap=True)
    show_verdict(console, shock_fit.verdict)
    write_shock(shock_fit.shock, asked.output)
    if asked.plot is not None:
        plot_click_map(shock_fit.shock, asked.plot)
    show_files(console, filter(None, [asked.output, asked.plot]))
    return shock_fit.verdict


# ---- Records and tables of peak velocities --------------------------------------------------------------------------


def _check_law_of_tables(law: str | None) -> None:
    if law not in (None, "polylinear"):
        raise InputError(
            f"a peak-velocity table has forces over speeds and no information on lag, which {law} has: omit "
            "--law, or use --law polylinear"
        )


def _builds(words: Sequence[str], files: Sequence[Path]) -> tuple[str | None, dict[Path, str]]:
    """Return the build of all files, None if not given, and the builds of single files."""
    names = {name: file for file in files for name in (str(file), file.name, file.stem)}
    common: str | None = None
    of_files: dict[Path, str] = {}
    for word in words:
        name, equals, build = word.partition("=")
        if equals and name in names:
            of_files[names[name]] = build
        elif common is not None:
            listed = ", ".join(file.name for file in files)
            raise InputError(f"--build {word!r}: write FILE=NAME with one of the files: {listed}")
        else:
            common = word
    return common, of_files


def _read_tests(
    console: Console, asked: FitOptions, conditions: DynoConditions, builds: Mapping[Path, str]
) -> list[DynoTest]:
    """Return the records of all files and print their channels."""
    from eightpost.rig import read_dyno_tests, split_runs

    tests: list[DynoTest] = []
    for file in asked.dyno_files:
        stated = replace(conditions, build=builds[file]) if file in builds else conditions
        records = read_dyno_tests(file, **asked.channels.of(file), conditions=stated, cutoff=asked.cutoff)
        if twin := next((test.source for test in tests if test.sha256 == records[0].sha256), None):
            raise InputError(f"{file} has the content of {twin}: a record would predict itself; give it once")
        tests += records
    if asked.split:
        tests = [run for test in tests for run in split_runs(test)]
    for test in tests:
        show_test(console if len(tests) == 1 else details(console), test)
    if len(tests) > 1:
        seconds = sum(test.series.duration for test in tests)
        show_text(console, f"{len(tests)} runs are fitted together, {seconds:.0f} s, with one curve and one law")
    return tests


def _fit_records(console: Console, asked: FitOptions, build: str | None, builds: Mapping[Path, str]) -> Verdict:
    """Fit one law to the records of all files."""
    from eightpost.ident import fit_shock
    from eightpost.rig import DynoConditions
    from eightpost.shock import write_shock

    shock_fit = fit_shock(
        _read_tests(console, asked, DynoConditions(build, asked.clicks, asked.gas_pressure), builds),
        asked.law, recipe=asked.recipe, gas=asked.gas, robust=asked.robust, name=asked.name, segment=asked.segment,
        cutoff=asked.cutoff,
    )  # fmt: skip
    show_fit(console, shock_fit)
    write_shock(shock_fit.shock, asked.output)
    if asked.plot is not None:
        from eightpost.ident import plot_force_velocity

        plot_force_velocity(shock_fit, asked.plot)
    show_files(console, filter(None, [asked.output, asked.plot]))
    return shock_fit.verdict


def _fit_builds(console: Console, tables: Mapping[str, Sequence[PeakVelocityTable]], asked: FitOptions) -> Verdict:
    """Fit the mean of the peak-velocity tables of several builds, and print the spread between them."""
    from eightpost.ident.shock.peak_velocity import fit_builds
    from eightpost.shock import write_shock

    shock, spread = fit_builds(tables, name=asked.name, gas=asked.gas)
    write_shock(shock, asked.output)
    show_text(console, f"{spread.summary()}.")
    assert shock.validity is not None
    show_verdict(console, shock.validity.verdict)
    show_files(console, [asked.output])
    return shock.validity.verdict


def _fit_tables(
    console: Console, tables: Sequence[PeakVelocityTable], asked: FitOptions, build: str | None
) -> Verdict:  # fmt: skip
    """Fit the tables of a peak-velocity file and draw their curves."""
    from eightpost.ident.shock.peak_velocity import fit_tables

    fitted = fit_tables(tables, asked.output, name=asked.name, build=build, gas=asked.gas)
    show_notes(console, map(str, fitted), "fitted", most=3)
    for one in fitted if is_detailed() else ():
        show_notes(console, one.shock.fit["changes"], "changed")
    verdict = Verdict.combined(one.shock.validity.verdict for one in fitted if one.shock.validity)
    show_verdict(console, verdict)
    if asked.plot is not None:
        from eightpost.ident import plot_peak_velocity

        plot_peak_velocity([(one.table, one.shock) for one in fitted], asked.plot)
    show_files(console, filter(None, [*(one.path for one in fitted), asked.plot]))
    return verdict


def show_test(console: Console, test: DynoTest) -> None:
    """Print the channels of a record, its length and scale; with -v, also its lag and notes."""
    from eightpost.rig.motion import lag_statement

    series, more = test.series, details(console)
    show_text(console, f"{test.source}: {series.duration:.1f} s at {series.sample_rate:.0f} Hz", lines=1)
    show_text(more, ", ".join(series.names), begin="  ")
    more.print(f"  {escape(lag_statement(series))}", soft_wrap=True, highlight=False)
    for note in (*test.derived, *test.remarks):
        more.print(f"[yellow]note[/] {escape(note)}", highlight=False)


def _range_text(shock_fit: ShockFit) -> str:
    """Return the ranges of the records: displacement, frequency and, if measured, temperature."""
    from eightpost.units import shown_range

    ranges = shock_fit.shock.validity.ranges if shock_fit.shock.validity else ()
    return ", ".join(
        f"{one.variable if one.kind == 'amplitude' else ''} {shown_range(one.low, one.high, one.unit)}".strip()
        for one in ranges
    )


def show_fit(console: Console, shock_fit: ShockFit) -> None:
    """Print law, errors, range and verdict of a fit; with -v, also its parameters and the settings that it changed."""
    from eightpost.ident import fit_table, parameter_table
    from eightpost.shock.laws import law_title
    from eightpost.units import shown

    force, unit = shown(shock_fit.rms, "N")
    between = "" if shock_fit.between_builds is None else shock_fit.between_builds.summary()
    rows = [
        ("law", f"{law_title(shock_fit.shock.law_name)}, {len(shock_fit.parameters)} parameters and a curve"),
        ("error", f"{shock_fit.percent:.2g} % of the force's standard deviation, {force:.3g} {unit} RMS"),
        ("held out", str(shock_fit.held_out or "").removeprefix("held-out error ")),
        ("range", _range_text(shock_fit)),
        ("builds", between),
        ("search", "" if shock_fit.converged else f"did not converge: {shock_fit.status}"),
        ("changes", f"{len(shock_fit.changes)}; -v shows them" if shock_fit.changes and not is_detailed() else ""),
    ]
    show_summary(console, shock_fit.shock.name, rows)
    more = details(console)
    more.print(fit_table([shock_fit]))
    more.print(parameter_table(shock_fit))
    for change in shock_fit.changes:
        more.print(f"[yellow]changed[/] {escape(change)}", highlight=False)
    show_verdict(console, shock_fit.verdict)


# ---- Pages of shocks and of studies ---------------------------------------------------------------------------------


def _default_page(given: Mapping[str, Any]) -> Path:
    return Path(f"{given['files'][0].stem}.html" if given["live"] else "report.html")


@dataclass(frozen=True, slots=True)
class _ReportOptions:
    """Options of `eightpost report`."""

    # fmt: off
    files: tuple[Path, ...] = argument("FILE...", kind=FilePath())
    output: Path = option(
        "HTML file to write; default: report.html, with --live the name of FILE with the suffix .html.",
        "-o", "--output", kind=OutputFile(PAGE, default=_default_page), metavar="FILE.HTML",
    )
    live: bool = option("Write a page on which the shock and a quarter car run live, instead of its report.")
    builds: tuple[tuple[str, str], ...] = option(
        "Build of a file; may be repeated. Default: that in the file, else, for a shock, that of the record it was "
        "fitted to, else the name of the file.",
        "--build", kind=Assignment("FILE=NAME"), metavar="FILE=NAME",
    )
    limits: Path | None = option(
        "Master curve, for pass or fail: a table of speed, compression, rebound and tolerance, in N or %, or another "
        "dynamometer or shock file with --set tolerance. Default: no limits.",
        kind=FilePath(), metavar="MASTER",
    )
    car: Path | None = option(
        "Vehicle file (docs/reference/vehicle_file.md) with the masses and wheel rates of the corners, for damping "
        "ratios; with --live, file or FMU of the quarter car. Default: damping ratios are unknown; with --live, the "
        "car of examples/corner.toml.",
        kind=FilePath(), metavar="CAR.TOML",
    )
    at: tuple[tuple[str, str], ...] = option(
        "Build at a corner of the car (lf, rf, lr, rr), for the overview of a car's shocks; may be repeated.",
        "--corner", kind=Assignment("CORNER=BUILD"), metavar="CORNER=BUILD",
    )
    channels: Channels = CHANNELS
    split: bool = option("Split each record at its pauses and where a sine changes; the parts are runs.")
    title: str = setting("Heading of the page.", default="Dynamometer report")
    clicks: tuple[tuple[str, str], ...] = setting(
        "Settings of the adjusters of a file, e.g. clicks=run7.csv='14 from closed'; may be repeated. Default: those "
        "in the file.",
        kind=Assignment("FILE=TEXT"),
    )
    tolerances: tuple[str, ...] = setting(
        "Tolerance of a --limits file without one, in percent of its force or as a force: '5 %' or '20 N'; given "
        "twice, the larger one counts.",
        "tolerance",
    )
    cycle: str = setting(
        "Cycle of a steady sine to show: the last, the mean of all, or a number from 1.", default="mean"
    )
    track: tuple[str, ...] = setting(
        "Record of a track with the velocity or displacement of the shaft (FILE or FILE=COLUMN), for a histogram of "
        "shaft speed beside the curve; may be repeated.",
    )
    speeds: tuple[float, ...] = setting(
        "Speed of the tables, e.g. '5 in/s'; may be repeated. Default: 1, 2, 3, 5, 10, 15 and 20 in/s, as far as a "
        "curve goes.",
        "speed", kind=Quantity("m/s"),
    )
    corner_mass: float | None = setting(
        "Sprung mass on the corner of a car, e.g. '306 kg' or '675 lbm', for damping ratios; default: that of --car.",
        kind=Quantity("kg", positive=True),
    )
    wheel_rate: float | None = setting(
        "Rate of the suspension at the wheel, e.g. '40 N/mm', for damping ratios; default: that of --car.",
        kind=Quantity("N/m", positive=True),
    )
    motion_ratio: float = setting(
        "Damper travel per wheel travel, usually 0.1 to 2.", kind=Number(min=0.0, min_open=True), default=1.0
    )
    # fmt: on


@verb
def report(ctx: click.Context, asked: _ReportOptions = group(_ReportOptions)) -> None:
    """Write a page about shocks: their dynamometer records and fitted laws, by build; or about a study.

    FILE is a dynamometer record or a peak-velocity table in any format that `fit` reads (docs/reference/dyno_files.md),
    or a shock file that `fit` wrote. The page shows force over velocity, displacement and time, knees and slopes,
    the ratio of rebound to compression, damping ratios, hysteresis, lag, gas force, friction, energy, warming,
    repeatability, and the differences from the build of the first file (docs/how_to/dyno_report.md). It is one file
    that needs no network and can be printed. The exit code is 1 if the verdict on a record or a shock is "not usable"
    (docs/reference/verdict.md), or if a run or table is outside the --limits, or none can be judged by them; the page
    is written nevertheless.

    With --live, FILE is a shock file or the native FMU of a shock. On the page, a reader turns its parameters, drives
    it on a dynamometer or by hand, and drives a quarter car over a bump; the C code of the FMUs runs in it as
    WebAssembly (docs/how_to/page.md). FILE may also be the folder of a study, whose page is written again.

    \b
    Examples:
      eightpost report run1.csv run2.csv shock.json -o report.html
      eightpost report A.csv A.json B.csv B.json --set corner-mass='306 kg' --set wheel-rate='40 N/mm'
      eightpost report run1.csv --limits dyno.csv --set tolerance='5 %' --set tolerance='10 N' --set cycle=last
      eightpost report bank/*.json --car car.toml --corner lf=A --corner rf=A --corner lr=B --corner rr=B
      eightpost report day.csv --split --build day.csv='front 3' --set speed='5 in/s' --set speed='10 in/s'
      eightpost report shock.json --live
      eightpost report out/
    """
    console = Console(soft_wrap=True, highlight=False)
    if asked.live:
        ctx.exit(0 if _live_page(console, asked.files, asked.output, asked.car).is_acceptable else 1)
    if is_study(asked.files[0]):
        _study_page(console, asked.files[0])
        return
    ctx.exit(0 if _dyno_page(console, asked) else 1)


def _dyno_page(console: Console, asked: _ReportOptions) -> bool:
    """Write the page about shocks; return whether all are acceptable and within the limits."""
    from eightpost.ident.dyno_report.builds import Reading, dyno_report, read_limits
    from eightpost.ident.dyno_report.page import report_verdict, write_report

    corners, channels = _corners(asked), asked.channels
    options = {"channel_map": channels.channel_map, "units": dict(channels.units)}
    builds, clicks = dict(asked.builds), dict(asked.clicks)
    reading = Reading(options, channels.flips, builds, clicks, asked.split, _cycle(asked.cycle))
    reading.check(asked.files)
    wanted = _tolerances(asked.tolerances, asked.limits)
    master = None if asked.limits is None else read_limits(asked.limits, Reading(options, channels.flips), wanted)
    entries, track = _read(console, asked.files, reading), _tracks(asked.track)
    made = dyno_report(
        entries, speeds=asked.speeds, corners=corners, fitted_to=dict(asked.at), limits=master, track=track
    )  # fmt: skip
    with console.status("drawing"):
        write_report(asked.output, made, title=asked.title)
    variants = [f"{variant.label}: {', '.join(f'{entry.name} ({entry.kind})' for entry in variant.entries)}"
                for variant in made.variants]  # fmt: skip
    show_notes(console, variants, "build")
    verdict = report_verdict(made.entries)
    show_verdict(console, verdict)
    failed = [one for one in made.judgements if not one.passed]
    show_notes(console, (f"{one.entry.name}, {one.stroke}: {one.text}" for one in failed), "FAIL:")
    unjudged = (f"{name}, which has no measured curve at a speed of the limits (--set speed)" for name in made.unjudged)
    show_notes(console, unjudged, "not judged:", most=1)
    if made.judgements and not failed:
        show_text(console, f"pass: all judged curves are within the limits of {asked.limits}")
    show_files(console, [asked.output])
    is_within = not failed and (asked.limits is None or bool(made.judgements))
    return verdict.is_acceptable and is_within


def _live_page(console: Console, files: Sequence[Path], output: Path, car: Path | None) -> Verdict:
    """Write the page on which a shock runs live; return the verdict on the shock."""
    from builder.live_page import write_live_page
    from eightpost.examples_folder import examples_folder

    if len(files) > 1:
        raise InputError(f"--live shows one shock, not {len(files)} files")
    with console.status("compiling"):
        written = write_live_page(files[0], output, vehicle=car or examples_folder() / "corner.toml")
    show_verdict(console, written.verdict)
    size = written.path.stat().st_size
    show_files(console, [written.path], f": {len(written.controls)} parameters to turn, {size / 1e6:.1f} MB")
    return written.verdict


def is_study(path: Path) -> bool:
    """Return whether a folder is that of a study."""
    return (path / "results.parquet").is_file()


def _study_page(console: Console, folder: Path) -> None:
    from eightpost.app.study import saved

    show_files(console, [saved(console, folder).write_page()])


def _cycle(text: str) -> str | int:
    """Return the cycle to show: `last`, `mean`, or a number from 1."""
    if text in ("last", "mean"):
        return text
    if not (text.isdecimal() and int(text)):
        raise InputError(f"--set cycle={text}: write last, mean, or the number of a cycle from 1")
    return int(text)


def _tolerances(texts: Sequence[str], limits: Path | None) -> list[tuple[float, str]]:
    """Return tolerances in percent or N."""
    from eightpost.units import convert, quantity

    if texts and limits is None:
        raise InputError("the tolerance is that of a master curve; add --limits FILE")
    if wrong := [text for text in texts if text.strip()[-1:].isdigit()]:
        raise InputError(f"tolerance {wrong[0]!r} has no unit; write it as '5 %' or '20 N'")
    found = [quantity(text) for text in texts]
    return [(value, "%") if unit == "%" else (float(convert(value, unit, "N")), "N") for value, unit in found]


def _tracks(words: Sequence[str]) -> dict[str, Array]:
    """Return the velocities of the shaft [m/s] of track files, by name."""
    from eightpost.ident.dyno_report.builds import read_track

    found = {}
    for word in words:
        name, _, column = word.partition("=")
        found[f"{Path(name).stem} {column}".strip()] = read_track(Path(name), column or None)
    return found


def _corners(asked: _ReportOptions) -> tuple[CarCorner, ...]:
    from eightpost.ident.dyno_report.builds import CarCorner, corners_of_car

    mass, rate = asked.corner_mass, asked.wheel_rate
    if asked.car is not None:
        if mass is not None or rate is not None:
            raise InputError("--car gives mass and wheel rate of every corner; omit corner-mass and wheel-rate")
        return corners_of_car(asked.car, asked.motion_ratio)
    if (mass is None) != (rate is None):
        raise InputError("a damping ratio needs both corner-mass and wheel-rate")
    return () if mass is None or rate is None else (CarCorner("corner", mass, rate, asked.motion_ratio),)


def _read(console: Console, files: Sequence[Path], reading: Reading) -> tuple[Entry, ...]:
    from eightpost.ident.dyno_report.builds import read_entries

    with bar(console, "reading", len(files)) as advance:
        return read_entries(files, reading, advance=advance)
