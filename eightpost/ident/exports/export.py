"""Export of a vehicle or a frequency response, by the suffixes of the two files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from eightpost.errors import FileFormatError, InputError
from eightpost.ident.exports.matlab import write_response_mat, write_vehicle_mat
from eightpost.ident.exports.universal_file import write_response_uff
from eightpost.ident.response import FrequencyResponse, read_response, response_of
from eightpost.vehicle import IdentifiedVehicle, StateSpace, read_vehicle


def export(
    source: Path,
    output: Path,
    *,
    ports: Literal["difference", "whole"] = "difference",
    high: float = 25.0,
    step: float = 0.05,
) -> str:
    """Write a vehicle (.json, .toml) or a frequency response (.npz) as .mat, .uff or .unv; return a summary.

    Args:
        source: File to export.
        output: File to write.
        ports: Meaning of a vehicle's shock inputs: the force minus that of the baseline damper, or the whole force.
        high: Highest frequency of a vehicle's response [Hz].
        step: Distance between the frequencies [Hz].

    Raises:
        FileFormatError: The suffix of the output is unknown, or the source cannot be read.
        InputError: The frequencies are not possible.
    """
    suffix = output.suffix.lower()
    if suffix not in (".mat", ".uff", ".unv"):
        raise FileFormatError("the output must be a .mat, .uff or .unv file", path=output)
    if source.suffix.lower() == ".npz":
        return _write(read_response(source), output)
    vehicle = _vehicle(source, ports)
    return _write_model(vehicle, output) if suffix == ".mat" else _write(_response(vehicle, high, step), output)


def _vehicle(source: Path, ports: str) -> IdentifiedVehicle:
    """Return a vehicle as it was identified, or with shock inputs that take the whole force."""
    vehicle = read_vehicle(source)
    model: StateSpace = vehicle.coupled() if ports == "whole" else vehicle.with_damper()
    if not isinstance(vehicle, IdentifiedVehicle):
        return IdentifiedVehicle(vehicle.name, model, static=vehicle.static)
    return replace(vehicle, state_space=model, baseline_damping={}) if ports == "whole" else vehicle


def _write_model(vehicle: IdentifiedVehicle, output: Path) -> str:
    write_vehicle_mat(output, vehicle)
    model = vehicle.state_space
    time = "continuous" if model.dt is None else f"discrete, {model.dt:g} s"
    return (
        f"{vehicle.name}, {time}, {len(model.A)} states, {len(model.inputs)} inputs, {len(model.outputs)} outputs; "
        "A, B, C, D, Ts, InputName, OutputName, InputUnit, OutputUnit"
    )


def _response(vehicle: IdentifiedVehicle, high: float, step: float) -> FrequencyResponse:
    if not 0.0 < step < high < 1e4:
        raise InputError(f"--step {step:g} --high {high:g}: give 0 < step < high < 10000 Hz")
    return response_of(vehicle.state_space, step * np.arange(1, round(high / step) + 1))


def _write(response: FrequencyResponse, output: Path) -> str:
    write = write_response_mat if output.suffix.lower() == ".mat" else write_response_uff
    write(output, response)
    span = f"{response.frequency[0]:g} to {response.frequency[-1]:g} Hz"
    return (
        f"{len(response.outputs)} x {len(response.inputs)} responses at {response.frequency.size} frequencies, {span}"
    )
