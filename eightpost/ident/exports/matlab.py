"""Models and frequency responses as MATLAB files (version 5), with the property names of MATLAB's own objects.

    m = load('car.mat'); sys = ss(m.A, m.B, m.C, m.D, m.Ts);
    set(sys, 'InputName', m.InputName, 'OutputName', m.OutputName, 'InputUnit', m.InputUnit, 'OutputUnit', m.OutputUnit)

    r = load('response.mat'); sys = frd(r.H, r.Frequency, 'FrequencyUnit', 'Hz');

The variable `eightpost` is JSON with the remaining data, so that a file that is read back gives an equal object.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.files import MALFORMED, atomic_path, check_schema, parse_json
from eightpost.ident.response import FrequencyResponse, frequency_response
from eightpost.vehicle import IdentifiedVehicle
from eightpost.vehicle.statespace import Channel
from eightpost.vehicle.storage import document, from_document

_MATRICES = ("A", "B", "C", "D")


def write_vehicle_mat(path: str | Path, vehicle: IdentifiedVehicle) -> None:
    """Write an identified vehicle as it was identified, around its baseline damping.

    Args:
        path: Path of the .mat file; it is replaced completely or not at all.
        vehicle: Vehicle to write.
    """
    model = vehicle.state_space
    metadata = {key: value for key, value in document(vehicle).items() if key not in _MATRICES}
    content: dict[str, Any] = {name: getattr(model, name) for name in _MATRICES}
    content["Ts"] = 0.0 if model.dt is None else model.dt
    content["Name"] = vehicle.name
    _write(path, {**content, **_channel_cells(model.inputs, model.outputs), "eightpost": json.dumps(metadata)})


def read_vehicle_mat(path: str | Path) -> IdentifiedVehicle:
    """Read an identified vehicle that `write_vehicle_mat` wrote; it is bitwise equal to the original.

    Raises:
        FileFormatError: The file does not exist, has no vehicle written by eightpost, or has a newer schema.
    """
    path = Path(path)
    content = _read(path)
    metadata = _metadata(content, path, kind="vehicle")
    for name in _MATRICES:
        if name not in content:
            raise FileFormatError(f"contains no vehicle: the matrix {name} is missing", path=path)
    return from_document(path, {**metadata, **{name: np.asarray(content[name]).tolist() for name in _MATRICES}})


def write_response_mat(path: str | Path, response: FrequencyResponse) -> None:
    """Write a frequency response: `H` (output, input, frequency), `Frequency` [Hz], coherences and variance.

    Args:
        path: Path of the .mat file; it is replaced completely or not at all.
        response: Frequency response to write.
    """
    arrays: dict[str, Any] = response.arrays()
    content = {"H": arrays.pop("H"), "Frequency": arrays.pop("frequency")[:, None], **arrays}
    header, cells = frequency_response.response_header(response), _channel_cells(response.inputs, response.outputs)
    _write(path, {**content, **cells, "eightpost": json.dumps(header)})


def read_response_mat(path: str | Path) -> FrequencyResponse:
    """Read a frequency response that `write_response_mat` wrote; it is bitwise equal to the original.

    Raises:
        FileFormatError: The file does not exist, has no response written by eightpost, or has a newer schema.
    """
    path = Path(path)
    content = _read(path)
    metadata = _metadata(content, path, kind="frequency_response")
    check_schema(metadata, frequency_response.SCHEMA, path)
    try:
        return _response(content, metadata)
    except MALFORMED as error:
        raise FileFormatError(
            f"does not contain a response in the format of this version ({error})", path=path
        ) from error


def _response(content: Mapping[str, Any], metadata: Mapping[str, Any]) -> FrequencyResponse:
    inputs, outputs = frequency_response.channels_of(metadata)
    frequency = np.asarray(content["Frequency"]).ravel()
    p, m, count = len(outputs), len(inputs), frequency.size
    shapes = zip(frequency_response.OPTIONAL, ((p, count), (p, m, count), (p, m, count)), strict=True)
    # MATLAB drops trailing dimensions of one.
    optional = [np.reshape(content[name], shape) if name in content else None for name, shape in shapes]
    return FrequencyResponse(frequency, np.reshape(content["H"], (p, m, count)), inputs, outputs, *optional)


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


def _read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = read_confined(
        "eightpost.confined.readers:load_matlab", path, False, kind="a MATLAB file of version 5 to 7.2"
    )
    return content


def _metadata(content: Mapping[str, Any], path: Path, *, kind: str) -> dict[str, Any]:
    try:
        text = str(content["eightpost"][0])
    except (LookupError, TypeError):
        raise FileFormatError(
            "was not written by eightpost: it has no variable `eightpost` with the kind of its content", path=path
        ) from None
    metadata = parse_json(text, path)
    if not isinstance(metadata, dict) or metadata.get("kind") != kind:
        found = metadata.get("kind") if isinstance(metadata, dict) else metadata
        raise FileFormatError(f"contains no {kind.replace('_', ' ')}: its kind is {found!r}", path=path)
    return metadata
