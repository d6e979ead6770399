"""Models and frequency responses as MATLAB files (version 5), with the property names of MATLAB's own objects.

    m = load('car.mat'); sys = ss(m.A, m.B, m.C, m.D, m.Ts);
    set(sys, 'InputName', m.InputName, 'OutputName', m.OutputName, 'InputUnit', m.InputUnit, 'OutputUnit', m.OutputUnit)

    r = load('response.mat'); sys = frd(r.H, r.Frequency, 'FrequencyUnit', 'Hz');

The variable `eightpost` is JSON with the remaining data.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from eightpost.errors import FileFormatError
from eightpost.files import atomic_path
from eightpost.ident.response import FrequencyResponse, frequency_response
from eightpost.vehicle import IdentifiedVehicle
from eightpost.vehicle.statespace import Channel
from eightpost.vehicle.storage import document

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
