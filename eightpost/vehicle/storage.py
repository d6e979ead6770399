"""Reading and writing of vehicle files (.toml and .json), and the JSON of identified vehicles."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

import eightpost
from eightpost.errors import FileFormatError, InputError, ParameterError
from eightpost.files import MALFORMED, atomic_path, check_schema, json_content
from eightpost.validity import Validity
from eightpost.vehicle.bristle import Bristle
from eightpost.vehicle.parameters import read_toml, write_toml
from eightpost.vehicle.statespace import Channel, StateSpace
from eightpost.vehicle.vehicles import Friction, IdentifiedVehicle, StructuralVehicle, Vehicle

# ---- Vehicle files --------------------------------------------------------------------------------------------------


def read_vehicle(path: str | Path) -> Vehicle:
    """Read a vehicle: parameters from a .toml file, an identified model from a .json file.

    >>> read_vehicle(shipped("seven_dof")).model
    'seven_dof'

    Raises:
        FileFormatError: The file does not exist, does not have the format of its suffix, or has an unsupported schema.
        ParameterError: A key or a value is invalid, or the model is not consistent.
        UnknownUnitError: A unit is unknown or has the wrong dimension.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".toml":
        return read_toml(path)
    if suffix == ".json":
        return from_document(Path(path), _content(Path(path)))
    raise FileFormatError("a vehicle is a .toml file (parameters) or a .json file (identified model)", path=path)


def write_vehicle(path: str | Path, vehicle: Vehicle) -> None:
    """Write a vehicle; an existing file is replaced only when the new one is complete.

    Numbers that are read back are bitwise equal.

    Raises:
        FileFormatError: The suffix does not match the vehicle: .toml for parameters, .json for an identified model.
    """
    suffix = Path(path).suffix.lower()
    if isinstance(vehicle, StructuralVehicle) and suffix == ".toml":
        write_toml(path, vehicle)
    elif isinstance(vehicle, IdentifiedVehicle) and suffix == ".json":
        with atomic_path(path) as temporary:
            temporary.write_text(_rows_on_lines(document(vehicle)), encoding="utf-8")
    else:
        needed = ".toml" if isinstance(vehicle, StructuralVehicle) else ".json"
        raise FileFormatError(f"the vehicle {vehicle.name!r} ({vehicle.model}) must be written as {needed}", path=path)


def shipped(model: Literal["quarter_car", "seven_dof"]) -> Path:
    """Return the path of the file with the dissertation's Table 4.1 (quarter car) or Table 5.1 (seven-DOF car)."""
    return Path(__file__).with_name(f"{model}.toml")


# ---- JSON files of identified vehicles ------------------------------------------------------------------------------

#: Newest schema of these files that can be read: 2 has bristles and port springs, 3 their mean travel. A file has the
#: oldest schema that is sufficient.
SCHEMA = 3

_NEEDED = ("name", "inputs", "outputs", "A", "B", "C", "D")
_OPTIONAL = ("schema", "kind", "tool", "model", "dt", "baseline_damping", "static", "sources", "friction", "validity")


def _content(path: Path) -> dict[str, Any]:
    content = json_content(path)
    if not isinstance(content, dict):
        raise FileFormatError("is JSON, but not a vehicle: it must be an object in braces", path=path)
    return content


def from_document(path: Path, content: dict[str, Any]) -> IdentifiedVehicle:
    """Return the vehicle of a document that `document` made.

    Args:
        path: Path of the file, for messages.
        content: Document.

    Raises:
        FileFormatError: The schema is not supported.
        ParameterError: The model is not consistent.
        UnknownUnitError: A channel's unit is not SI.
    """
    check_schema(content, SCHEMA, path)
    _check_keys(path, content)
    try:
        return _vehicle(content, path.name)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    except MALFORMED as error:
        what = f"does not contain a vehicle in the format of this version ({error})"
        raise FileFormatError(what, path=path) from error


def document(vehicle: IdentifiedVehicle) -> dict[str, Any]:
    """Return the content of a vehicle file: texts, numbers, lists and tables."""
    model = vehicle.state_space
    return {
        "schema": max((_schema(law) for law in vehicle.friction.values()), default=1),
        "kind": "vehicle",
        "tool": f"eightpost {eightpost.__version__}",
        "model": vehicle.model,
        "name": vehicle.name,
        "sources": dict(vehicle.sources),
        "dt": model.dt,
        "model_name": model.name,
        "inputs": [{"name": channel.name, "unit": channel.unit} for channel in model.inputs],
        "outputs": [{"name": channel.name, "unit": channel.unit} for channel in model.outputs],
        "baseline_damping": dict(vehicle.baseline_damping),
        "static": dict(vehicle.static),
        **_friction(vehicle),
        **({} if vehicle.validity is None else {"validity": vehicle.validity.to_json()}),
        **{field: getattr(model, field).tolist() for field in ("A", "B", "C", "D")},
    }


def _schema(law: Friction) -> int:
    """Return the oldest schema that has all of a law."""
    return 3 if law.mean_travel else 2 if law[2:] != Friction()[2:] else 1


def _friction(vehicle: IdentifiedVehicle) -> dict[str, Any]:
    """Return the entry of the friction; empty without friction, so that older versions can read the file."""
    entries = {
        port: {"force": law.force, "velocity": law.velocity}
        | ({"bristle": asdict(law.bristle), "spring": law.spring} if _schema(law) > 1 else {})
        | ({"mean_travel": law.mean_travel} if law.mean_travel else {})
        for port, law in vehicle.friction.items()
    }
    return {"friction": entries} if entries else {}


def _law(entry: dict[str, Any]) -> Friction:
    springs = (entry.get(name, 0.0) for name in ("spring", "mean_travel"))
    return Friction(entry["force"], entry["velocity"], Bristle(**entry.get("bristle", {})), *springs)


def _rows_on_lines(content: dict[str, Any]) -> str:
    """Return JSON with one matrix row or channel per line, which makes files easy to compare."""
    entries = []
    for key, value in content.items():
        if isinstance(value, list) and value:
            rows = ",\n".join(f"    {json.dumps(row, allow_nan=False)}" for row in value)
            entries.append(f"  {json.dumps(key)}: [\n{rows}\n  ]")
        else:
            entries.append(f"  {json.dumps(key)}: {json.dumps(value, allow_nan=False)}")
    return "{\n" + ",\n".join(entries) + "\n}\n"


def _check_keys(path: Path, content: dict[str, Any]) -> None:
    if (kind := content.get("kind", "vehicle")) != "vehicle":
        raise FileFormatError(f"is a {kind} file, not a vehicle; eightpost identify makes vehicles", path=path)
    if content.get("model", "state_space") != "state_space":
        raise FileFormatError(f"model is {content['model']!r}; a JSON vehicle is a 'state_space'", path=path)
    for key in _NEEDED:
        if key not in content:
            raise ParameterError(f"{path}: {key!r} is missing; a vehicle needs {', '.join(_NEEDED)}")
    for key in content:
        if key not in (*_NEEDED, *_OPTIONAL, "model_name"):
            raise ParameterError(f"{path}: unknown key {key!r}; the known keys are {', '.join((*_NEEDED, *_OPTIONAL))}")


def _vehicle(content: dict[str, Any], origin: str) -> IdentifiedVehicle:
    inputs, outputs = (
        tuple(Channel(channel["name"], channel["unit"]) for channel in content[side]) for side in ("inputs", "outputs")
    )
    n, m, p = len(content["A"]), len(inputs), len(outputs)
    name = str(content["name"])
    model = StateSpace(
        _matrix(content["A"], (n, n)),
        _matrix(content["B"], (n, m)),
        _matrix(content["C"], (p, n)),
        _matrix(content["D"], (p, m)),
        inputs,
        outputs,
        content.get("dt"),
        str(content.get("model_name", name)),
    )
    vehicle = IdentifiedVehicle(
        name,
        model,
        content.get("baseline_damping", {}),
        content.get("static", {}),
        content.get("sources", {}),
        {port: _law(entry) for port, entry in content.get("friction", {}).items()},
    )
    if "validity" not in content:
        return vehicle
    return replace(vehicle, validity=Validity.from_json(content["validity"]).checked(vehicle.numbers, origin))


def _matrix(rows: Any, shape: tuple[int, ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the rows as a matrix; an empty list gives an empty matrix of the given shape."""
    matrix = np.asarray(rows, dtype=np.float64)
    return np.zeros(shape) if matrix.size == 0 and 0 in shape else matrix
