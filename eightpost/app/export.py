"""`eightpost export`: models, frequency responses and shock curves for other tools."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click
from click.core import ParameterSource
from rich.console import Console

from eightpost.app.options import FilePath, OutputFile, Quantity, Verb
from eightpost.outputs import EXPORT

#: Options of a vehicle or a response, and of shocks.
_VEHICLE_OPTIONS, _SHOCK_OPTIONS = ("ports", "high", "step"), ("table_format", "over", "error", "speed")


@click.command(cls=Verb)
@click.argument("sources", metavar="SOURCE...", nargs=-1, required=True, type=FilePath())
@click.option("--ports", type=click.Choice(["difference", "whole"]), default="difference", show_default=True,
              help="Meaning of a vehicle's shock inputs. difference: the force of the shock minus the force of the "
              "baseline damper. whole: the whole force of the shock.")  # fmt: skip
@click.option("--high", type=Quantity("Hz", bare=True), default="25 Hz", show_default=True, metavar="FREQUENCY",
              help="Highest frequency of a vehicle's response.")  # fmt: skip
@click.option("--step", type=Quantity("Hz", bare=True), default="0.05 Hz", show_default=True, metavar="FREQUENCY",
              help="Distance between the frequencies of a vehicle's response.")  # fmt: skip
@click.option("--format", "table_format", type=click.Choice(["csv", "mat", "m", "modelica", "dpr", "carmaker"]),
              help="Shocks: format of the table: csv (.csv), mat and m (Simulink lookup tables, .mat and .m), modelica "
              "(CombiTable, .txt), dpr (Adams TeimOrbit, .dpr), carmaker (lines of a vehicle file, any suffix). "
              "Default: by the suffix of the output.")  # fmt: skip
@click.option("--over", metavar="NAME=VALUE,...",
              help="Shocks: setting in which several shocks differ, with a value for each in the order of the files, "
              "e.g. clicks=0,4,8; or settings of one shock of `eightpost settings`, e.g. rebound=0,7,14 or "
              "'temperature [degC]=20,60'. Default: none, for one shock at its reference setting.")  # fmt: skip
@click.option("--error", metavar="PERCENT", type=float, default=0.1, show_default=True,
              help="Shocks: maximum error of linear interpolation by velocity [% of the range of force]; a smaller one "
              "gives more points.")  # fmt: skip
@click.option("--speed", metavar="SPEED", type=Quantity("m/s"),
              help="Shocks: highest velocity in both directions, e.g. '2 m/s'; default: the fitted range.")  # fmt: skip
@click.option("-o", "output", required=True, type=OutputFile(EXPORT),
              help="Output file: .mat, .uff or .unv; for shocks .csv, .mat, .m, .txt or .dpr.")  # fmt: skip
@click.pass_context
def export(  # one parameter per option
    ctx: click.Context,
    sources: tuple[Path, ...],
    ports: Literal["difference", "whole"],
    high: float,
    step: float,
    table_format: str | None,
    over: str | None,
    error: float,
    speed: float | None,
    output: Path,
) -> None:
    """Export models, frequency responses and shock curves for other tools.

    SOURCE is a vehicle (.json, or .toml with parameters), a frequency response (.npz), or one or more shocks (.json). A
    vehicle is exported to a .mat file with A, B, C, D, names and units, or as its frequency response to a universal
    file (dataset 58). A frequency response is exported to either format.

    A shock is exported as a table of its static curve. Several shocks, or one that was fitted over its settings, are a
    table over a setting, which --over names.
    Gas force, seal friction and lag are not in a table; the file states them in its comments. For conventions of signs
    and the origin of each format see docs/how_to/exports.md.

    \b
    Examples:
      eightpost export vehicle.json -o car.mat
      eightpost export vehicle.json -o car.uff --high '20 Hz' --step '0.05 Hz'
      eightpost export response.npz -o response.mat
      eightpost export shock.json -o shock.dpr
      eightpost export shock.json --format carmaker -o damper_front.info --error 0.5
      eightpost export c0.json c4.json c8.json --over clicks=0,4,8 -o clicks.mat
      eightpost export adjustable.json --over rebound=0,7,14,21,28 -o clicks.txt
    """
    from eightpost.ident.export import export as write
    from eightpost.ident.export import export_shocks, has_shocks

    console = Console(soft_wrap=True, highlight=False)
    is_shock = has_shocks(sources)
    _refuse(ctx, _VEHICLE_OPTIONS if is_shock else _SHOCK_OPTIONS, "shocks" if is_shock else "vehicles and responses")
    if is_shock:
        summary, *remarks = export_shocks(
            sources, output, name=table_format, over=over, error=error / 100.0, speed=speed
        )
        for remark in remarks:
            console.print(remark, markup=False)
    else:
        summary = write(sources[0], output, ports=ports, high=high, step=step)
    read = ", ".join(str(path) for path in sources)
    console.print(f"read {read}; wrote {output}: {summary}", markup=False)


def _refuse(ctx: click.Context, names: tuple[str, ...], kind: str) -> None:
    """Refuse options that do not apply to the kind of source."""
    for parameter in ctx.command.params:
        given = ctx.get_parameter_source(parameter.name or "") == ParameterSource.COMMANDLINE
        if parameter.name in names and given:
            raise click.BadParameter(f"it does not apply to {kind}; omit it", ctx, parameter)
