"""`eightpost vehicle`: modes, frequency responses and parameter studies of a vehicle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost import completion
from eightpost.app.options import FilePath, OutputFolder, Quantity, Verb, warn
from eightpost.errors import InputError
from eightpost.report.console import Table, console_table, unbroken

if TYPE_CHECKING:
    from eightpost.ident.vehicle.frequency_response import FrequencyResponse
    from eightpost.vehicle import Mode


@click.command(cls=Verb)
@click.argument("path", metavar="CAR", type=FilePath())
@click.option("--vary", "parameter", metavar="PARAMETER",
              help="Parameter to vary at all four corners alike, e.g. damping; default: none.")  # fmt: skip
@click.option("--factors", default="0.5,1,2,3", show_default=True, metavar="FACTORS",
              help="Factors that the parameter is multiplied by, separated by commas.")  # fmt: skip
@click.option("--output", "names", metavar="CHANNEL", multiple=True,
              help="Output to draw, e.g. lf.tire_force; may be repeated. Default: shock velocities, tire forces and "
              "ride heights.")  # fmt: skip
@click.option("--high", type=Quantity("Hz", bare=True), default="25 Hz", show_default=True, metavar="FREQUENCY",
              help="Highest frequency.")  # fmt: skip
@click.option("-o", "folder", default="vehicle", show_default=True, type=OutputFolder(),
              help="Output folder.")  # fmt: skip
def vehicle(path: Path, parameter: str | None, factors: str, names: tuple[str, ...], high: float, folder: Path) -> None:
    """Show modes and frequency responses of a vehicle, and the effect of a parameter on them.

    CAR is a vehicle file: parameters (.toml), or an identified model (.json), which has no parameters to vary. The
    vehicle includes its linear dampers. The command writes a picture for each output, and the responses as
    response.npz.

    \b
    Example:
      eightpost vehicle car.toml --vary damping --factors 0.5,1,2,3 -o study
    """
    from eightpost.ident.vehicle.frequency_response import response_of, write_response
    from eightpost.ident.vehicle.plots import frequencies_to, plot_magnitudes, variants_of
    from eightpost.vehicle import StructuralVehicle, read_vehicle
    from eightpost.vehicle.structural import doubts

    frequency = frequencies_to(high)
    car = read_vehicle(path)
    console = Console()
    console.print(f"read {path}: {car.name} ({car.model}), with its dampers", highlight=False, soft_wrap=True)
    for doubt in doubts(car.parameters) if isinstance(car, StructuralVehicle) else ():
        warn(f"{doubt.summary}; {doubt.remedy}")
    completion.begin(folder)
    variants = variants_of(car, parameter, _numbers(factors), frequency)
    responses = {label: variant.response for label, variant in variants.items()}
    console.print(_mode_table({label: variant.modes for label, variant in variants.items()}))
    chosen = _outputs(next(iter(responses.values())), names)
    for name in chosen:
        target = folder / f"{name}.png"
        plot_magnitudes(responses, name, target)
        console.print(f"wrote {target}", highlight=False, soft_wrap=True)
    own = response_of(car.with_damper(), frequency)
    write_response(folder / "response.npz", own)
    console.print(f"wrote {folder / 'response.npz'}", highlight=False, soft_wrap=True)


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


def _numbers(text: str) -> list[float]:
    try:
        return list(dict.fromkeys(float(part) for part in text.split(",")))
    except ValueError:
        raise InputError(f"--factors {text!r}: give numbers separated by commas, e.g. 0.5,1,2") from None
