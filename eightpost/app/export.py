"""`eightpost export`: models, frequency responses, shock curves and systems for other tools."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import click
from rich.console import Console

from eightpost.api.reading import is_system
from eightpost.app.options import STATED, FilePath, OutputFile, Quantity, argument, group, option, setting, verb
from eightpost.app.show import show_files, show_notes, show_text
from eightpost.outputs import EXPORT, PACKAGE, check_file

#: Settings of a vehicle or a response, and options and settings of shocks.
_VEHICLE_SETTINGS, _OF_SHOCKS = {"ports", "high", "step"}, {"error", "speed", "--format", "--over"}


def _default_package(given: Mapping[str, Any]) -> Path:
    """Return the package of a system; other sources have no default."""
    (first, *_) = given["sources"]
    if not is_system(first):
        raise click.UsageError("Missing option '-o' / '--output'.")
    return Path(first).with_suffix(".ssp")


@dataclass(frozen=True, slots=True)
class ExportOptions:
    """Options of `eightpost export`."""

    # fmt: off
    sources: tuple[Path, ...] = argument("SOURCE...", kind=FilePath())
    output: Path = option(
        "Output file: of a vehicle .mat, .uff or .unv; of shocks .csv, .mat, .m, .txt or .dpr; of a system .ssp. "
        "Default: of a system its name with the suffix .ssp (of a package _new.ssp); no default for others.",
        "-o", "--output", kind=OutputFile(EXPORT, default=_default_package),
    )
    table_format: str | None = option(
        "Shocks: format of the table: csv (.csv), mat and m (Simulink lookup tables, .mat and .m), modelica "
        "(CombiTable, .txt), dpr (Adams TeimOrbit, .dpr), carmaker (lines of a vehicle file, any suffix). Default: by "
        "the suffix of the output.",
        "--format", kind=("csv", "mat", "m", "modelica", "dpr", "carmaker"),
    )
    over: str | None = option(
        "Shocks: setting in which several shocks differ, with a value for each in the order of the files, e.g. "
        "clicks=0,4,8; or settings of one shock that was fitted over them, e.g. rebound=0,7,14 or 'temperature "
        "[degC]=20,60'. Default: none, for one shock at its reference setting.",
        metavar="NAME=VALUE,...",
    )
    ports: Literal["difference", "whole"] = setting(
        "Meaning of a vehicle's shock inputs. difference: the force of the shock minus the force of the baseline "
        "damper. whole: the whole force of the shock.",
        kind=("difference", "whole"), default="difference",
    )
    high: float = setting("Highest frequency of a vehicle's response.", kind=Quantity("Hz", bare=True), default="25 Hz")
    step: float = setting(
        "Distance between the frequencies of a vehicle's response.", kind=Quantity("Hz", bare=True), default="0.05 Hz"
    )
    error: float = setting(
        "Shocks: maximum error of linear interpolation by velocity [% of the range of force]; a smaller one gives "
        "more points.",
        kind=click.FLOAT, default=0.1,
    )
    speed: float | None = setting(
        "Shocks: highest velocity in both directions, e.g. '2 m/s'; default: the fitted range.", kind=Quantity("m/s")
    )
    # fmt: on


@verb
def export(ctx: click.Context, asked: ExportOptions = group(ExportOptions)) -> None:
    """Export models, frequency responses, shock curves and systems for other tools.

    SOURCE is a vehicle (.json, or .toml with parameters), a frequency response (.npz), or one or more shocks (.json). A
    vehicle is exported to a .mat file with A, B, C, D, names and units, or as its frequency response to a universal
    file (dataset 58). A frequency response is exported to either format.

    A shock is exported as a table of its static curve. Several shocks, or one that was fitted over its settings, are a
    table over a setting, which --over names. Gas force, seal friction and lag are not in a table; the file states them
    in its comments. For conventions of signs and the origin of each format see docs/how_to/exports.md.

    A system file or package becomes an SSP 1.0 package with its FMUs, their connections, and for each component a file
    of its settable parameters, resources/<component>.ssv; subsystems become one flat system. A package cannot hold a
    drive file: the tool that imports it drives the open inputs.

    \b
    Examples:
      eightpost export vehicle.json -o car.mat
      eightpost export vehicle.json -o car.uff --set high='20 Hz' --set step='0.05 Hz'
      eightpost export response.npz -o response.mat
      eightpost export shock.json -o shock.dpr
      eightpost export shock.json --format carmaker -o damper_front.info --set error=0.5
      eightpost export c0.json c4.json c8.json --over clicks=0,4,8 -o clicks.mat
      eightpost export adjustable.json --over rebound=0,7,14,21,28 -o clicks.txt
      eightpost export examples/seven_dof.toml -o car.ssp
    """
    from eightpost.ident.export import export as write
    from eightpost.ident.export import export_shocks, has_shocks

    console = Console(soft_wrap=True, highlight=False)
    if is_system(asked.sources[0]):
        _export_system(console, asked.sources[0], asked.output)
        return
    is_shock = has_shocks(asked.sources)
    options = {"--format": asked.table_format, "--over": asked.over}
    stated = {*ctx.meta[STATED], *(name for name, given in options.items() if given)}
    wrong, kind = (_VEHICLE_SETTINGS, "shocks") if is_shock else (_OF_SHOCKS, "vehicles and responses")
    if refused := stated & wrong:
        raise click.BadParameter(f"it does not apply to {kind}; omit it", param_hint=", ".join(sorted(refused)))
    if is_shock:
        error, speed = asked.error / 100.0, asked.speed
        summary, *remarks = export_shocks(
            asked.sources, asked.output, name=asked.table_format, over=asked.over, error=error, speed=speed
        )  # fmt: skip
        show_notes(console, remarks)
    else:
        summary = write(asked.sources[0], asked.output, ports=asked.ports, high=asked.high, step=asked.step)
    show_files(console, [asked.output], f": {summary}")


def _export_system(console: Console, system: Path, output: Path) -> None:
    from builder.ssp import write_ssp
    from cosim.system_file import read_case

    check_file(output, PACKAGE, "-o")
    case = read_case(system)
    open_inputs = write_ssp(output, case.wiring)
    count = len(case.system.components)
    show_text(console, f"wrote {output}: {count} components, {len(case.system.all_connections)} connections, SSP 1.0")
    if open_inputs:
        show_text(console, f"open inputs, 0 unless driven: {', '.join(open_inputs)}", begin="  ")
