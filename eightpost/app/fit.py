"""`eightpost fit`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import COLUMNS, UNITS, FilePath, LawName, OutputFile, Quantity, Verb, flip_option, map_option
from eightpost.errors import InputError
from eightpost.outputs import PICTURE, SHOCK
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from eightpost.ident import ShockFit
    from eightpost.ident.shock.force import GasTreatment
    from eightpost.ident.shock.law_fit import RecipeName
    from eightpost.least_squares import Robust
    from eightpost.rig import DynoTest, PeakVelocityTable
    from eightpost.signals import ChannelMap

RECIPES = ("joint", "boggs")
WEIGHTINGS = ("auto", "none", "huber", "tukey")
GAS_TREATMENTS = ("estimate", "included", "subtracted")


@click.command(cls=Verb)
@click.argument("dyno_files", metavar="DYNO...", nargs=-1, required=True, type=FilePath())
@click.option("--law", type=LawName(),
              help="Shock law to fit (docs/explanation/shock_law.md); default: hysteresis, with --recipe boggs lpnl2, "
              "for a peak-velocity table polylinear.")  # fmt: skip
@click.option("-o", "--output",
              type=OutputFile(SHOCK, default=lambda given: Path(f"{given['dyno_files'][0].stem}.json")),
              help="Output shock file; default: the name of the first DYNO with the suffix .json (of a .json file "
              "_shock.json), in the current folder.")  # fmt: skip
@click.option("--recipe", type=click.Choice(RECIPES), default="joint", show_default=True,
              help="Order of the fit. joint: all parameters together, a curve through knots. boggs: one after the "
              "other, a curve of polynomials, as in 3.3.")  # fmt: skip
@click.option("--robust", type=click.Choice(WEIGHTINGS), default="auto", show_default=True,
              help="Weighting of outliers. auto: outliers are down-weighted if there are any. none: no weighting. "
              "huber, tukey: always weighted by this function.")  # fmt: skip
@click.option("--gas", type=click.Choice(GAS_TREATMENTS), default="estimate", show_default=True,
              help="Gas force in the force channel. estimate: it is fitted and kept in the shock. included: it is "
              "fitted and left out of the shock, because the static load of the car already counts it. subtracted: "
              "the dynamometer already subtracted it, so it is not fitted.")  # fmt: skip
@UNITS
@COLUMNS
@map_option("docs/reference/signs_and_units.md", "file")
@flip_option("force")
@click.option("--split", is_flag=True,
              help="Split each record at its pauses and where a sine changes, and fit the parts as runs.")  # fmt: skip
@click.option("--segment", nargs=2, type=Quantity("s", bare=True), metavar="START STOP",
              help="Start and end of the part of the record to fit; default '1 s' '10 s'.")  # fmt: skip
@click.option("--cutoff", type=Quantity("Hz", bare=True), metavar="FREQUENCY",
              help="Cut-off frequency of the low-pass on model and data; default '50 Hz'.")  # fmt: skip
@click.option("--name", help="Name of the shock; default: the name of the file.")
@click.option("--build", "builds", metavar="[FILE=]NAME", multiple=True,
              help="Team's own name for the shock build, or for that of a file, e.g. run7.csv='front 3'; may be "
              "repeated. Default: that in the file. Records of several builds are fitted together, and the shock file "
              "states their spread (docs/explanation/shock_law.md).")  # fmt: skip
@click.option("--clicks", metavar="TEXT",
              help="Settings of the adjusters and how they are counted, e.g. '14 from closed, rebound'; default: those "
              "in the file.")  # fmt: skip
@click.option("--gas-pressure", type=Quantity("Pa"), metavar="PRESSURE",
              help="Gas pressure of the shock, e.g. '150 psi'; default: that in the file.")  # fmt: skip
@click.option("--plot", type=OutputFile(PICTURE), help="Force-velocity picture; default: none.")
@click.pass_context
def fit(  # one parameter per option
    ctx: click.Context,
    dyno_files: tuple[Path, ...],
    law: str | None,
    output: Path,
    recipe: RecipeName,
    robust: Robust,
    gas: GasTreatment,
    units: tuple[tuple[str, str], ...],
    columns: tuple[tuple[str, str], ...],
    channel_map: ChannelMap | None,
    flip: tuple[str, ...],
    split: bool,
    segment: tuple[float, float] | None,
    cutoff: float | None,
    name: str | None,
    builds: tuple[str, ...],
    clicks: str | None,
    gas_pressure: float | None,
    plot: Path | None,
) -> None:
    """Fit a shock law to a dynamometer file, or to several runs together, of one build or of several.

    DYNO is a text file, spreadsheet, .parquet, .mat, .json, .mf4, .tdms or .lvm file with time, force, and velocity or
    displacement (docs/reference/dyno_files.md). Units are in its header, in a channel map, or given by --units. Several
    tables in a file are several runs. A table of forces over peak velocities gives a polylinear shock for each setting
    of the adjusters. The exit code is 1 if the shock is not usable (docs/reference/verdict.md).

    \b
    Examples:
      eightpost fit dyno.csv -o shock.json
      eightpost fit run1.csv run2.csv --law lpf1 -o shock.json
      eightpost fit sines.csv --split -o shock.json
      eightpost fit a.csv b.csv --build a.csv='front 1' --build b.csv='front 2' -o front.json
      eightpost fit peak_velocities.csv -o shock.json
      eightpost fit run7.csv --units force=lbf --flip force --gas included -o dist/run7.json
    """
    from threadpoolctl import threadpool_limits

    from eightpost.ident import fit_shock
    from eightpost.ident.shock.peak_velocity import builds_in, tables_in
    from eightpost.rig import DynoConditions
    from eightpost.rig.columns import with_channels
    from eightpost.shock import write_shock

    ctx.with_resource(threadpool_limits(1, "blas"))  # threads do not speed up matrices this small
    if plot is not None:
        import eightpost.report.pictures  # noqa: F401 -- refuses a picture that cannot be drawn before the fit
    console = Console()
    build, of_files = _builds(builds, dyno_files)
    given, conditions = dict(units), DynoConditions(build, clicks, gas_pressure)
    channel_map = with_channels(channel_map, dict(columns))
    if of_builds := builds_in(dyno_files, given, of_files, channel_map):
        _check_law_of_tables(law)
        ctx.exit(0 if _fit_builds(console, of_builds, output, name=name, gas=gas).is_acceptable else 1)
    if tables := tables_in(dyno_files, given, channel_map):
        _check_law_of_tables(law)
        ctx.exit(0 if _fit_tables(console, tables, output, plot, name=name, build=build, gas=gas).is_acceptable else 1)
    reading = {"channel_map": channel_map, "units": given, "flip": flip, "conditions": conditions, "cutoff": cutoff}
    tests = _read_tests(console, dyno_files, reading, of_files, split=split)
    shock_fit = fit_shock(
        tests,
        law,
        recipe=recipe,
        gas=gas,
        robust=robust,
        name=name,
        segment=segment,
        cutoff=cutoff,
    )
    show_fit(console, shock_fit)
    write_shock(shock_fit.shock, output)
    written = [output]
    if plot is not None:
        from eightpost.ident import plot_force_velocity

        plot_force_velocity(shock_fit, plot)
        written.append(plot)
    console.print(f"wrote {', '.join(map(str, written))}", soft_wrap=True, highlight=False)
    ctx.exit(0 if shock_fit.verdict.is_acceptable else 1)


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
    console: Console,
    files: Sequence[Path],
    reading: Mapping[str, Any],
    builds: Mapping[Path, str],
    *,
    split: bool,
) -> list[DynoTest]:
    """Return the records of all files and print their channels; `reading` are options of `read_dyno_tests`."""
    from eightpost.rig import read_dyno_tests, split_runs

    tests: list[DynoTest] = []
    for file in files:
        own = {"conditions": replace(reading["conditions"], build=builds[file])} if file in builds else {}
        found = read_dyno_tests(file, **{**reading, **own})
        if twin := next((test.source for test in tests if test.sha256 == found[0].sha256), None):
            raise InputError(f"{file} has the content of {twin}: a record would predict itself; give it once")
        tests += found
    if split:
        tests = [run for test in tests for run in split_runs(test)]
    for test in tests:
        show_test(console, test)
    if len(tests) > 1:
        console.print(f"{len(tests)} runs are fitted together, with one curve and one law", highlight=False)
    return tests


def _fit_builds(
    console: Console,
    tables: Mapping[str, Sequence[PeakVelocityTable]],
    output: Path,
    *,
    name: str | None,
    gas: GasTreatment,
) -> Verdict:
    """Fit the mean of the peak-velocity tables of several builds, and print the spread between them."""
    from eightpost.app.show import show_verdict
    from eightpost.ident.shock.peak_velocity import fit_builds
    from eightpost.shock import write_shock

    shock, spread = fit_builds(tables, name=name, gas=gas)
    write_shock(shock, output)
    console.print(f"{escape(spread.summary())}.", highlight=False, soft_wrap=True)
    assert shock.validity is not None
    show_verdict(console, shock.validity.verdict)
    console.print(f"wrote {output}", soft_wrap=True, highlight=False)
    return shock.validity.verdict


def _fit_tables(
    console: Console,
    tables: Sequence[PeakVelocityTable],
    output: Path,
    plot: Path | None,
    *,
    name: str | None,
    build: str | None,
    gas: GasTreatment,
) -> Verdict:
    """Fit the tables of a peak-velocity file and draw their curves."""
    from eightpost.app.show import show_verdict
    from eightpost.ident.shock.peak_velocity import fit_tables

    fitted = fit_tables(tables, output, name=name, build=build, gas=gas)
    for one in fitted:
        console.print(escape(str(one)), soft_wrap=True, highlight=False)
        for change in one.shock.fit["changes"]:
            console.print(f"[yellow]changed[/] {escape(change)}", highlight=False)
        if one.shock.validity:
            show_verdict(console, one.shock.validity.verdict)
    written = [one.path for one in fitted]
    if plot is not None:
        from eightpost.ident import plot_peak_velocity

        plot_peak_velocity([(one.table, one.shock) for one in fitted], plot)
        written.append(plot)
    console.print(f"wrote {', '.join(map(str, written))}", soft_wrap=True, highlight=False)
    return Verdict.combined(one.shock.validity.verdict for one in fitted if one.shock.validity)


def show_test(console: Console, test: DynoTest) -> None:
    """Print the channels of a record, its length, scale and lag, and its notes."""
    from eightpost.rig.motion import lag_statement

    series = test.series
    console.print(
        f"read {escape(str(test.source))}: {', '.join(series.names)}; {series.duration:.1f} s at "
        f"{series.sample_rate:.0f} Hz",
        soft_wrap=True,
        highlight=False,
    )
    console.print(f"  {escape(lag_statement(series))}", soft_wrap=True, highlight=False)
    for note in (*test.derived, *test.remarks):
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False)


def show_fit(console: Console, shock_fit: ShockFit) -> None:
    """Print a fit's quality, its parameters, and the settings that it changed."""
    from eightpost.app.show import show_verdict
    from eightpost.ident import fit_table, parameter_table

    console.print(fit_table([shock_fit]))
    console.print(parameter_table(shock_fit))
    if shock_fit.held_out is not None:
        console.print(f"{shock_fit.held_out}.", highlight=False, soft_wrap=True)
    if shock_fit.between_builds is not None:
        console.print(f"{escape(shock_fit.between_builds.summary())}.", highlight=False, soft_wrap=True)
    for change in shock_fit.changes:
        console.print(f"[yellow]changed[/] {escape(change)}", highlight=False)
    show_verdict(console, shock_fit.verdict)
