"""Export of a vehicle, a frequency response or static curves of shocks, by the kind of the source."""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from eightpost import __version__
from eightpost.array_types import Array
from eightpost.errors import FileFormatError, InputError
from eightpost.extras import needs, requirement
from eightpost.files import atomic_path, document_kind
from eightpost.ident.shock_table import shock_table, table_format, write_shock_table
from eightpost.ident.vehicle import frequency_response
from eightpost.ident.vehicle.frequency_response import FrequencyResponse, read_response, response_of
from eightpost.validity import judged
from eightpost.vehicle import IdentifiedVehicle, read_vehicle
from eightpost.vehicle.statespace import Channel
from eightpost.vehicle.vehicles import document

# ==== Models and responses: MATLAB, modal analysis (universal files) and python-control ==============================
# MATLAB files (version 5) have the property names of MATLAB's own objects:
#
# m = load('car.mat'); sys = ss(m.A, m.B, m.C, m.D, m.Ts); set(sys, 'InputName', m.InputName, 'OutputName',
# m.OutputName, 'InputUnit', m.InputUnit, 'OutputUnit', m.OutputUnit)
#
#     r = load('response.mat'); sys = frd(r.H, r.Frequency, 'FrequencyUnit', 'Hz');
#
# Their variable `eightpost` is JSON with the remaining data.
#
# Universal files (UFF) have a dataset 58 per path. They are written by pyuff, an optional dependency. The text form
# stores a response with 12 digits. Evenly spaced frequencies are stored as the first frequency and the step, with 6
# digits; other frequencies are stored one by one, with 6 digits. Dataset 164 states that all units are SI. Each channel
# has its own node, outputs from 1 and inputs after them; its name is in the first line.

# ---- MATLAB ---------------------------------------------------------------------------------------------------------

_MATRICES = ("A", "B", "C", "D")


def write_vehicle_mat(path: str | Path, vehicle: IdentifiedVehicle) -> None:
    """Write an identified vehicle as it was identified, around its baseline damping."""
    model = vehicle.state_space
    metadata = {key: value for key, value in document(vehicle).items() if key not in _MATRICES}
    content: dict[str, Any] = {name: getattr(model, name) for name in _MATRICES}
    content["Ts"] = 0.0 if model.dt is None else model.dt
    content["Name"] = vehicle.name
    _write(path, {**content, **_channel_cells(model.inputs, model.outputs), "eightpost": json.dumps(metadata)})


def write_response_mat(path: str | Path, response: FrequencyResponse) -> None:
    """Write a frequency response: `H` (output, input, frequency), `Frequency` [Hz], coherences and variance."""
    arrays: dict[str, Any] = response.arrays()
    content = {"H": arrays.pop("H"), "Frequency": arrays.pop("frequency")[:, None], **arrays}
    header, cells = frequency_response.response_header(response), _channel_cells(response.inputs, response.outputs)
    _write(path, {**content, **cells, "eightpost": json.dumps(header)})


def _channel_cells(inputs: Sequence[Channel], outputs: Sequence[Channel]) -> dict[str, NDArray[Any]]:
    return {
        "InputName": _cells([channel.name for channel in inputs]),
        "InputUnit": _cells([channel.unit for channel in inputs]),
        "OutputName": _cells([channel.name for channel in outputs]),
        "OutputUnit": _cells([channel.unit for channel in outputs]),
    }


def _cells(texts: Sequence[str]) -> NDArray[Any]:
    """Return a column of texts that MATLAB loads as a cell array."""
    return np.array(texts, dtype=object).reshape(-1, 1)


def _write(path: str | Path, content: Mapping[str, Any]) -> None:
    if Path(path).suffix.lower() != ".mat":
        raise FileFormatError("the name of a MATLAB file must end in .mat", path=path)
    with atomic_path(path) as temporary:
        savemat(temporary, dict(content), do_compression=True)


# ---- Universal files ------------------------------------------------------------------------------------------------

_FUNCTION, _COHERENCE = 4, 6
_FREQUENCY = 18
_TO = " / "
_COHERENCE_OF = "multiple coherence of "

#: Specific data type of dataset 58, and the exponents of length and force, by unit.
_TYPES = {"m": (8, 1, 0), "m/s": (11, 1, 0), "m/s2": (12, 1, 0), "N": (9, 0, 1), "N.m": (1, 1, 1), "rad": (1, 0, 0)}
_EXCITATION_FORCE = 13

#: Codes of the vertical direction, and of a scalar without direction.
_UP, _SCALAR = 3, 0


def write_response_uff(path: str | Path, response: FrequencyResponse) -> None:
    """Write a frequency response and its multiple coherence.

    Raises:
        FileFormatError: The path has another suffix, or pyuff is not installed.
        InputError: The response has a single frequency.
    """
    path = Path(path)
    if path.suffix.lower() not in (".uff", ".unv"):
        raise FileFormatError("the name of a universal file must end in .uff or .unv", path=path)
    if response.frequency.size < 2:
        raise InputError(f"{path}: the response has a single frequency; a universal file needs two or more")
    pyuff = _pyuff(path)
    sets = [_units(), *_functions(response), *_coherences(response)]
    with atomic_path(path) as temporary:
        pyuff.UFF(str(temporary)).write_sets(sets, mode="overwrite")


def _units() -> dict[str, Any]:
    return {
        "type": 164, "units_code": 1, "units_description": "SI: m, N", "temp_mode": 1,
        "length": 1.0, "force": 1.0, "temp": 1.0, "temp_offset": 273.15,
    }  # fmt: skip


def _functions(response: FrequencyResponse) -> list[dict[str, Any]]:
    sets = []
    for i, output in enumerate(response.outputs):
        for j, source in enumerate(response.inputs):
            ordinate = _axis("ordinate", output, _TYPES.get(output.unit, (0, 0, 0))[0])
            force = _EXCITATION_FORCE if source.unit == "N" else _TYPES.get(source.unit, (0, 0, 0))[0]
            sets.append(
                {
                    **_common(response, f"{output.name}{_TO}{source.name}", response.H[i, j]),
                    **ordinate,
                    **_axis("orddenom", source, force),
                    "func_type": _FUNCTION,
                    "id4": f"[{output.unit}] / [{source.unit}]",
                    "rsp_node": 1 + i,
                    "rsp_dir": _direction(output),
                    "ref_node": 1 + len(response.outputs) + j,
                    "ref_dir": _direction(source),
                }
            )
    return sets


def _coherences(response: FrequencyResponse) -> list[dict[str, Any]]:
    if response.coherence is None:
        return []
    return [
        {
            **_common(response, f"{_COHERENCE_OF}{output.name}", response.coherence[i]),
            "func_type": _COHERENCE,
            "rsp_node": 1 + i,
            "rsp_dir": _direction(output),
            "ref_node": 0,
            "ref_dir": _SCALAR,
            "orddenom_spec_data_type": 0,
        }
        for i, output in enumerate(response.outputs)
    ]


def _common(response: FrequencyResponse, title: str, values: NDArray[Any]) -> dict[str, Any]:
    return {
        "type": 58,
        "id1": title,
        "id2": f"eightpost {__version__}",
        "x": response.frequency,
        "data": values,
        "abscissa_spacing": int(_is_even(response.frequency)),
        "abscissa_spec_data_type": _FREQUENCY,
        "abscissa_axis_lab": "Frequency",
        "abscissa_axis_units_lab": "Hz",
    }


def _axis(kind: str, channel: Channel, data_type: int) -> dict[str, Any]:
    _, length, force = _TYPES.get(channel.unit, (0, 0, 0))
    return {
        f"{kind}_spec_data_type": data_type,
        f"{kind}_len_unit_exp": length,
        f"{kind}_force_unit_exp": force,
        f"{kind}_axis_lab": channel.name.rpartition(".")[2][:20],
        f"{kind}_axis_units_lab": channel.unit,
    }


def _direction(channel: Channel) -> int:
    return _UP if channel.unit in ("m", "m/s", "m/s2", "N") else _SCALAR


def _is_even(frequency: Array) -> bool:
    """Return whether the first frequency and the step, with the format's 6 digits, give all frequencies."""
    first, step = (float(f"{value:.5e}") for value in (frequency[0], frequency[1] - frequency[0]))
    grid = first + step * np.arange(frequency.size)
    return bool(np.allclose(grid, frequency, rtol=1e-9, atol=0.0))


def _pyuff(path: Path) -> Any:
    try:
        return importlib.import_module("pyuff")
    except ImportError as error:
        raise FileFormatError(requirement("export of universal files", "pyuff", "uff"), path=path) from error


# ---- python-control -------------------------------------------------------------------------------------------------


def to_frd(response: FrequencyResponse) -> Any:
    """Return the response as a continuous `control.FrequencyResponseData`, with frequencies in rad/s.

    python-control does not allow dots in names, so they become colons (`lf.road` -> `lf:road`). Units, coherence and
    variance are lost.
    """
    with needs("control", "exchange with python-control"):
        import control  # noqa: PLC0415  because loading it takes seconds

    return control.FrequencyResponseData(
        response.H,
        2.0 * np.pi * response.frequency,
        inputs=[name.replace(".", ":") for name in response.input_names],
        outputs=[name.replace(".", ":") for name in response.output_names],
    )


# ==== Export =========================================================================================================


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
        return _write_response(read_response(source), output)
    vehicle = _vehicle(source, ports)
    return (
        _write_model(vehicle, output) if suffix == ".mat" else _write_response(_response(vehicle, high, step), output)
    )


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
        raise InputError(f"--step {step:g} --set high={high:g}: give 0 < step < high < 10000 Hz")
    return response_of(vehicle.state_space, step * np.arange(1, round(high / step) + 1))


def _write_response(response: FrequencyResponse, output: Path) -> str:
    write = write_response_mat if output.suffix.lower() == ".mat" else write_response_uff
    write(output, response)
    span = f"{response.frequency[0]:g} to {response.frequency[-1]:g} Hz"
    return (
        f"{len(response.outputs)} x {len(response.inputs)} responses at {response.frequency.size} frequencies, {span}"
    )
