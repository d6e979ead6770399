"""`eightpost export`: models and frequency responses for other tools."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console

from eightpost.app.options import Quantity
from eightpost.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from eightpost.ident.response import FrequencyResponse
    from eightpost.vehicle import IdentifiedVehicle, StateSpace


@click.command()
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.option("--ports", type=click.Choice(["difference", "whole"]), default="difference", show_default=True,
              help="Meaning of a vehicle's shock inputs. difference: the force of the shock minus the force of the "
              "baseline damper. whole: the whole force of the shock.")  # fmt: skip
@click.option("--high", type=Quantity("Hz", bare=True), default="25 Hz", show_default=True, metavar="FREQUENCY",
              help="Highest frequency of a vehicle's response.")  # fmt: skip
@click.option("--step", type=Quantity("Hz", bare=True), default="0.05 Hz", show_default=True, metavar="FREQUENCY",
              help="Distance between the frequencies of a vehicle's response.")  # fmt: skip
@click.option("-o", "output", required=True, type=click.Path(path_type=Path), help="Output file: .mat, .uff or .unv.")
def export(source: Path, ports: str, high: float, step: float, output: Path) -> None:
    """Export models and frequency responses for other tools.

    SOURCE is a vehicle (.json, or .toml with parameters) or a frequency response (.npz). A vehicle is exported to a
    .mat file with A, B, C, D, names and units, or as its frequency response to a universal file (dataset 58). A
    frequency response is exported to either format.

    \b
    Examples:
      eightpost export vehicle.json -o car.mat
      eightpost export vehicle.json -o car.uff --high '20 Hz' --step '0.05 Hz'
      eightpost export response.npz -o response.mat
    """
    from eightpost.ident.response import read_response

    suffix = output.suffix.lower()
    if suffix not in (".mat", ".uff", ".unv"):
        raise FileFormatError("the output must be a .mat, .uff or .unv file", path=output)
    if source.suffix.lower() == ".npz":
        summary = _write(read_response(source), output)
    else:
        vehicle = _vehicle(source, ports)
        summary = _write_model(vehicle, output) if suffix == ".mat" else _write(_response(vehicle, high, step), output)
    Console(soft_wrap=True, highlight=False).print(f"read {source}; wrote {output}: {summary}", markup=False)


def _vehicle(source: Path, ports: str) -> IdentifiedVehicle:
    """Return a vehicle as it was identified, or with shock inputs that take the whole force."""
    from eightpost.vehicle import IdentifiedVehicle, read_vehicle

    vehicle = read_vehicle(source)
    model: StateSpace = vehicle.coupled() if ports == "whole" else vehicle.with_damper()
    if not isinstance(vehicle, IdentifiedVehicle):
        return IdentifiedVehicle(vehicle.name, model, static=vehicle.static)
    return replace(vehicle, state_space=model, baseline_damping={}) if ports == "whole" else vehicle


def _write_model(vehicle: IdentifiedVehicle, output: Path) -> str:
    from eightpost.ident.exports import write_vehicle_mat

    write_vehicle_mat(output, vehicle)
    model = vehicle.state_space
    time = "continuous" if model.dt is None else f"discrete, {model.dt:g} s"
    return (
        f"{vehicle.name}, {time}, {len(model.A)} states, {len(model.inputs)} inputs, {len(model.outputs)} outputs; "
        "A, B, C, D, Ts, InputName, OutputName, InputUnit, OutputUnit"
    )


def _response(vehicle: IdentifiedVehicle, high: float, step: float) -> FrequencyResponse:
    import numpy as np

    from eightpost.ident.response import response_of

    if not 0.0 < step < high < 1e4:
        raise InputError(f"--step {step:g} --high {high:g}: give 0 < step < high < 10000 Hz")
    return response_of(vehicle.state_space, step * np.arange(1, round(high / step) + 1))


def _write(response: FrequencyResponse, output: Path) -> str:
    from eightpost.ident.exports import write_response_mat, write_response_uff

    write = write_response_mat if output.suffix.lower() == ".mat" else write_response_uff
    write(output, response)
    span = f"{response.frequency[0]:g} to {response.frequency[-1]:g} Hz"
    return (
        f"{len(response.outputs)} x {len(response.inputs)} responses at {response.frequency.size} frequencies, {span}"
    )
