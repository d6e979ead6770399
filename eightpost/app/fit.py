"""`eightpost fit`: one record, several of one shock, or one shock over its adjusters and temperature."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.channels import CHANNELS, Channels
from eightpost.app.options import FilePath, LawName, OutputFile, Quantity, argument, group, option, setting, verb
from eightpost.app.show import (
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
from eightpost.outputs import PICTURE, SHOCK
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from eightpost.ident import ShockFit
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
    from eightpost.ident.shock.settings_table import read_settings_table, settings_of_names, states_settings

    files, has_columns, is_plain = asked.dyno_files, asked.channels.is_stated, not (asked.split or asked.builds)
    if len(files) == 1 and files[0].suffix.lower() == ".toml":
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
