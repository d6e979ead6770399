"""`eightpost fit`."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console
from rich.markup import escape

from eightpost import units
from eightpost.commands.fit_peaks import fit_peak_tables, peak_tables, refuse_dynamics
from eightpost.commands.show_verdict import show_verdict
from eightpost.errors import InputError
from eightpost.ident import ShockFit, fit_shock, fit_table, parameter_table, plot_force_velocity
from eightpost.ident.shock.curve.shape import Shape
from eightpost.ident.shock.fit import GasTreatment, LawName, RecipeName
from eightpost.ident.shock.solvers.robust import Robust
from eightpost.rig import DynoConditions, DynoTest, read_dyno_tests, split_runs
from eightpost.shock import write_shock
from eightpost.signals import ChannelMap


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
    unit_words: tuple[str, ...],
    map_file: Path | None,
    flip: tuple[str, ...],
    split: bool,
    segment: tuple[float, float] | None,
    cutoff: float | None,
    transition_speed: str | None,
    name: str | None,
    build: str | None,
    clicks: str | None,
    gas_pressure: str | None,
    plot: Path | None,
) -> None:
    """Fit a shock law to a dynamometer file, or to several runs of one build together."""
    console = Console()
    output = output or Path(f"{dyno_files[0].stem}.json")
    _check_output(output, dyno_files[0])
    given = dict(_pair(word) for word in unit_words)
    if tables := peak_tables(dyno_files, given):
        refuse_dynamics(ctx, law)
        verdict = fit_peak_tables(console, tables, output, name=name, build=build)
        ctx.exit(0 if verdict.is_acceptable else 1)
    channel_map = ChannelMap.read(map_file) if map_file else None
    tests = [
        test
        for dyno_file in dyno_files
        for test in read_dyno_tests(
            dyno_file,
            channel_map=channel_map,
            units=given,
            flip=flip,
            conditions=DynoConditions(build, clicks, _si(gas_pressure, "Pa")),
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
        transition_speed=_si(transition_speed, "m/s"),
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


def _pair(word: str) -> tuple[str, str]:
    channel, equals, unit = word.partition("=")
    if not (channel and equals and unit):
        raise click.BadParameter(f"{word!r}: write it as CHANNEL=UNIT", param_hint="--units")
    return channel, unit


def _si(text: str | None, unit: str) -> float | None:
    if text is None:
        return None
    number, given = units.quantity(text)
    return units.convert(number, given, unit)
