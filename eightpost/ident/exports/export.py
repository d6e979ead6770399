"""Export of a vehicle, a frequency response or static curves of shocks, by the kind of the source."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from eightpost.errors import FileFormatError, InputError
from eightpost.files import document_kind
from eightpost.ident.exports.model_formats import write_response_mat, write_response_uff, write_vehicle_mat
from eightpost.ident.exports.shock_formats import table_format, write_shock_table
from eightpost.ident.exports.shock_table import shock_table
from eightpost.ident.response import FrequencyResponse, read_response, response_of
from eightpost.validity import judged
from eightpost.vehicle import IdentifiedVehicle, read_vehicle


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


def has_shocks(sources: Sequence[Path]) -> bool:
    """Return whether the sources are shock files.

    Raises:
        FileFormatError: Some are shocks and others are not, or there are several vehicles or responses.
    """
    kinds = [path.suffix.lower() == ".json" and document_kind(path) == "shock" for path in sources]
    if len(sources) > 1 and not all(kinds):
        wrong = next(path for path, is_shock in zip(sources, kinds, strict=True) if not is_shock)
        raise FileFormatError(
            "is not a shock file, and only shocks are exported together; export it by itself", path=wrong
        )
    return all(kinds)


def export_shocks(
    sources: Sequence[Path],
    output: Path,
    *,
    name: str | None = None,
    over: str | None = None,
    error: float = 1e-3,
    speed: float | None = None,
) -> tuple[str, ...]:
    """Write the static curves of shocks as a table for another tool; return a summary, a sentence each.

    Args:
        sources: Shock files.
        output: File to write.
        name: Name of the format in `TABLE_FORMATS`; None chooses it by the suffix.
        over: Quantity in which several shocks differ, as NAME=VALUE,VALUE,...
        error: Permitted error of linear interpolation by velocity, relative to the range of force [1].
        speed: Highest velocity [m/s]; None for the fitted range.

    Raises:
        FileFormatError: The suffix is unknown, or a source is not a shock.
        InputError: An argument is not possible, or the format takes a single shock.
    """
    table_format(output, name)
    table = shock_table(sources, over=over, error=error, speed=speed)
    return (write_shock_table(output, table, name), *table.remarks)


def _vehicle(source: Path, ports: str) -> IdentifiedVehicle:
    """Return a vehicle as it was identified, or with shock inputs that take the whole force."""
    vehicle = read_vehicle(source)
    if isinstance(vehicle, IdentifiedVehicle):
        if ports == "difference":
            return vehicle
        model = replace(vehicle, friction={}, validity=None).coupled()  # about the mean loads of the tests
        return judged(vehicle, state_space=model, baseline_damping={})
    model = vehicle.coupled() if ports == "whole" else vehicle.with_damper()
    return IdentifiedVehicle(vehicle.name, model, static=vehicle.static)


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
