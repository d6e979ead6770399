"""`eightpost fit`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape

from eightpost.app.options import UNITS, Quantity, flip_option, map_option
from eightpost.errors import InputError
from eightpost.shock import LAWS
from eightpost.verdict import Verdict

if TYPE_CHECKING:
    from eightpost.ident import ShockFit
    from eightpost.ident.shock.curve import Shape
    from eightpost.ident.shock.fit import GasTreatment, LawName, RecipeName
    from eightpost.ident.shock.robust import Robust
    from eightpost.rig import DynoTest, PeakVelocityTable
    from eightpost.shock import Shock
    from eightpost.signals import ChannelMap

RECIPES = ("joint", "boggs")
SHAPES = ("auto", "free", "monotone", "passive")
WEIGHTINGS = ("auto", "none", "huber", "tukey")
GAS_TREATMENTS = ("estimate", "included", "subtracted")


# ---- `eightpost fit` of a peak-velocity table -----------------------------------------------------------------------

_TEXT = (".csv", ".txt", ".tsv")


def peak_tables(files: Sequence[Path], units: Mapping[str, str]) -> tuple[PeakVelocityTable, ...]:
    """Return the tables of a peak-velocity file; empty if the files are records over time.

    Raises:
        InputError: A peak-velocity file is given together with other files.
    """
    from eightpost.rig import read_peak_velocity
    from eightpost.rig.peak_velocity import is_peak_velocity
    from eightpost.signals import read_records

    tables = [path for path in files if path.suffix.lower() in _TEXT and is_peak_velocity(read_records(path)[0])]
    if tables and len(files) > 1:
        raise InputError(f"{tables[0]} is a peak-velocity table: fit it alone")
    return read_peak_velocity(tables[0], units=units) if tables else ()


def fit_peak_tables(
    console: Console, tables: Sequence[PeakVelocityTable], output: Path, *, name: str | None, build: str | None
) -> Verdict:
    """Fit and write a shock for each table, print the deviation of each curve from its points, and draw them.

    Returns:
        The verdict on all shocks.
    """
    from eightpost.ident import fit_peak_velocity, plot_peak_velocity
    from eightpost.rig import PeakVelocityTable
    from eightpost.shock import Shock, write_shock

    shocks, paths = list[tuple[PeakVelocityTable, Shock]](), list[Path]()
    for table in tables:
        several = len(tables) > 1
        shock = _named(fit_peak_velocity(table, name=name), table.clicks if several else None, build)
        path = output.with_stem(f"{output.stem}_{_slug(table.clicks)}") if several else output
        _show(console, table, shock)
        write_shock(shock, path)
        shocks.append((table, shock))
        paths.append(path)
    picture = output.with_suffix(".png")
    plot_peak_velocity(shocks, picture)
    console.print(f"wrote {', '.join(map(str, [*paths, picture]))}", soft_wrap=True, highlight=False)
    return Verdict.combined(shock.validity.verdict for _, shock in shocks if shock.validity)


def refuse_dynamics(ctx: click.Context, law: str) -> None:
    """Refuse a law with dynamics if --law names one: such a table has no information on them."""
    is_given = ctx.get_parameter_source("law") != click.core.ParameterSource.DEFAULT
    if is_given and law != "polylinear":
        raise InputError(
            f"a peak-velocity table has forces over speeds and no information on lag, which {law} has: omit --law, "
            "or use --law polylinear"
        )


def _named(shock: Shock, clicks: str | None, build: str | None) -> Shock:
    conditions = dict(shock.conditions) | ({"build": build} if build else {})
    return replace(shock, name=f"{shock.name} {clicks}" if clicks else shock.name, conditions=conditions)


def _slug(clicks: str | None) -> str:
    return re.sub(r"[^A-Za-z0-9.+-]+", "_", clicks or "").strip("_") or "setting"


def _show(console: Console, table: PeakVelocityTable, shock: Shock) -> None:
    from eightpost.app.show import show_verdict

    fit = shock.fit or {}
    console.print(
        f"{escape(shock.name)}: {len(table)} speeds on each side, up to {table.speed[-1]:.4g} m/s; the curve deviates "
        f"from its points by at most {fit['greatest_error_at_points [N]']:.3g} N, {fit['rms [N]']:.3g} N RMS",
        soft_wrap=True,
        highlight=False,
    )
    for change in fit["changes"]:
        console.print(f"[yellow]changed[/] {escape(change)}", highlight=False)
    if shock.validity is not None:
        show_verdict(console, shock.validity.verdict)


# ---- `eightpost fit` ------------------------------------------------------------------------------------------------


@click.command()
@click.argument("dyno_files", metavar="DYNO...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--law", type=click.Choice(list(LAWS)), default="lpnl2", show_default=True,
              help="Shock law to fit (docs/shock_models.md).")  # fmt: skip
@click.option("-o", "--output", type=click.Path(path_type=Path),
              help="Output shock file; default: the name of the first DYNO with the suffix .json, in the current "
              "folder.")  # fmt: skip
@click.option("--recipe", type=click.Choice(RECIPES), default="joint", show_default=True,
              help="Order of the fit. joint: all parameters together. boggs: one after the other, as in "
              "3.3.")  # fmt: skip
@click.option("--shape", type=click.Choice(SHAPES), default="auto", show_default=True,
              help="Constraint on the static curve. auto: monotonic, but only if the unconstrained curve would fall. "
              "free: unconstrained. monotone: monotonic. passive: the force never acts in the direction of the "
              "motion.")  # fmt: skip
@click.option("--order", default="auto", show_default=True, metavar="auto|N",
              help="Order of the curve's inner polynomial: 1 to 15, or auto for cross-validation.")  # fmt: skip
@click.option("--robust", type=click.Choice(WEIGHTINGS), default="auto", show_default=True,
              help="Weighting of outliers. auto: outliers are down-weighted if there are any. none: no weighting. "
              "huber, tukey: always weighted by this function.")  # fmt: skip
@click.option("--gas", type=click.Choice(GAS_TREATMENTS), default="estimate", show_default=True,
              help="Gas force in the force channel. estimate: it is fitted and kept in the shock. included: it is "
              "fitted and left out of the shock, because the static load of the car already counts it. subtracted: "
              "the dynamometer already subtracted it, so it is not fitted.")  # fmt: skip
@UNITS
@map_option("docs/signs_and_units.md", "file")
@flip_option("force")
@click.option("--split", is_flag=True,
              help="Split each record at its pauses and where a sine changes, and fit the parts as runs.")  # fmt: skip
@click.option("--segment", nargs=2, type=Quantity("s", bare=True), metavar="START STOP",
              help="Start and end of the part of the record to fit; default '1 s' '10 s'.")  # fmt: skip
@click.option("--cutoff", type=Quantity("Hz", bare=True), metavar="FREQUENCY",
              help="Cut-off frequency of the low-pass on model and data; default '50 Hz'.")  # fmt: skip
@click.option("--transition-speed", type=Quantity("m/s"), metavar="SPEED",
              help="Velocity at which the inner polynomial of the curve ends; default '15 in/s', less for a slow "
              "record.")  # fmt: skip
@click.option("--name", help="Name of the shock; default: the name of the file.")
@click.option("--build", help="Team's own name for the shock build; default: that in the file.")
@click.option("--clicks", metavar="TEXT",
              help="Settings of the adjusters and how they are counted, e.g. '14 from closed, rebound'; default: those "
              "in the file.")  # fmt: skip
@click.option("--gas-pressure", type=Quantity("Pa"), metavar="PRESSURE",
              help="Gas pressure of the shock, e.g. '150 psi'; default: that in the file.")  # fmt: skip
@click.option("--plot", type=click.Path(path_type=Path),
              help="Force-velocity picture; default: the output file with the suffix .png.")  # fmt: skip
@click.pass_context
def fit(  # one parameter per option
    ctx: click.Context,
    dyno_files: tuple[Path, ...],
    law: LawName,
    output: Path | None,
    recipe: RecipeName,
    shape: Shape,
    order: str,
    robust: Robust,
    gas: GasTreatment,
    units: tuple[tuple[str, str], ...],
    channel_map: ChannelMap | None,
    flip: tuple[str, ...],
    split: bool,
    segment: tuple[float, float] | None,
    cutoff: float | None,
    transition_speed: float | None,
    name: str | None,
    build: str | None,
    clicks: str | None,
    gas_pressure: float | None,
    plot: Path | None,
) -> None:
    """Fit a shock law to a dynamometer file, or to several runs of one build together.

    DYNO is a .csv, .txt, .parquet, .mat or .mf4 file with time, force, and velocity or displacement. Units are in its
    header, in a channel map, or given by --units. Several tables in a file are several runs. A table of forces over
    peak velocities gives a polylinear shock for each setting of the adjusters. The exit code is 1 if the shock is not
    usable (docs/verdict.md).

    \b
    Examples:
      eightpost fit dyno.csv --law lpnl2 -o shock.json
      eightpost fit run1.csv run2.csv --law lpf1 --order 9 --shape monotone -o shock.json
      eightpost fit sines.csv --split -o shock.json
      eightpost fit peak_velocities.csv -o shock.json
      eightpost fit run7.csv --units force=lbf --flip force --gas included -o dist/run7.json
    """
    from eightpost.ident import fit_shock, plot_force_velocity
    from eightpost.rig import DynoConditions, read_dyno_tests, split_runs
    from eightpost.shock import write_shock

    console = Console()
    output = output or Path(f"{dyno_files[0].stem}.json")
    _check_output(output, dyno_files[0])
    given = dict(units)
    if tables := peak_tables(dyno_files, given):
        refuse_dynamics(ctx, law)
        verdict = fit_peak_tables(console, tables, output, name=name, build=build)
        ctx.exit(0 if verdict.is_acceptable else 1)
    tests = [
        test
        for dyno_file in dyno_files
        for test in read_dyno_tests(
            dyno_file,
            channel_map=channel_map,
            units=given,
            flip=flip,
            conditions=DynoConditions(build, clicks, gas_pressure),
            cutoff=cutoff,
        )
    ]
    if split:
        tests = [run for test in tests for run in split_runs(test)]
    for test in tests:
        show_test(console, test)
    if len(tests) > 1:
        console.print(f"{len(tests)} runs are fitted together, with one curve and one law", highlight=False)
    shock_fit = fit_shock(
        tests,
        law,
        recipe=recipe,
        gas=gas,
        shape=shape,
        order=_order(order),
        robust=robust,
        name=name,
        segment=segment,
        cutoff=cutoff,
        transition_speed=transition_speed,
    )
    show_fit(console, shock_fit)
    plot = plot or output.with_suffix(".png")
    write_shock(shock_fit.shock, output)
    plot_force_velocity(shock_fit, plot)
    console.print(f"wrote {output}, {plot}", soft_wrap=True, highlight=False)
    ctx.exit(0 if shock_fit.verdict.is_acceptable else 1)


def show_test(console: Console, test: DynoTest) -> None:
    """Print the channels of a record, its length and its notes."""
    series = test.series
    console.print(
        f"read {escape(str(test.source))}: {', '.join(series.names)}; {series.duration:.1f} s at "
        f"{series.sample_rate:.0f} Hz",
        soft_wrap=True,
        highlight=False,
    )
    for note in test.derived:
        console.print(f"[yellow]note[/] {escape(note)}", highlight=False)


def show_fit(console: Console, shock_fit: ShockFit) -> None:
    """Print a fit's quality, its parameters, and the settings that it changed."""
    from eightpost.app.show import show_verdict
    from eightpost.ident import fit_table, parameter_table

    console.print(fit_table([shock_fit]))
    console.print(parameter_table(shock_fit))
    for change in shock_fit.changes:
        console.print(f"[yellow]changed[/] {escape(change)}", highlight=False)
    show_verdict(console, shock_fit.verdict)


def _check_output(output: Path, dyno_file: Path) -> None:
    """Refuse an output that would overwrite a folder or a file that is not a shock file."""
    if output.is_dir():
        raise InputError(f"{output} is a folder; name a file in it, such as {output / dyno_file.stem}.json")
    if output.suffix != ".json":
        raise InputError(f"{output}: a shock file ends in .json; write -o {output.with_suffix('.json')}")


def _order(word: str) -> int | None:
    if word == "auto":
        return None
    if not word.isdigit():
        raise click.BadParameter(f"{word!r}: write auto, or a number from 1 to 15", param_hint="--order")
    return int(word)
