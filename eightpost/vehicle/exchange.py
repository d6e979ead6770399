"""Exchange of vehicles with python-control, and their discretisation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal

import numpy as np

import eightpost
from eightpost.errors import FileFormatError, InputError, ParameterError
from eightpost.files import MALFORMED, atomic_path, check_schema, json_content
from eightpost.validity import Validity
from eightpost.vehicle import kernel
from eightpost.vehicle.statespace import Channel, StateSpace
from eightpost.vehicle.vehicles import Friction, IdentifiedVehicle

# ---- Conversion of a continuous model to the equivalent discrete model ----------------------------------------------

Hold = Literal["zero", "first"]


def discretise(model: StateSpace, step: float, hold: Hold = "zero") -> StateSpace:
    """Return the discrete model whose samples equal those of the continuous model.

    "zero": Inputs are held over the step. `x[k+1] = Ad x[k] + (B0 + B1) u[k]`; C and D do not change, so an output
    without a direct term does not get one.

    "first": Inputs are linear over the step. `x[k+1] = Ad x[k] + B0 u[k] + B1 u[k+1]` becomes a proper state
    space with the state `xi = x - B1 u`:

        xi[k+1] = Ad xi[k] + (B0 + Ad B1) u[k],    y[k] = C xi[k] + (D + C B1) u[k]

    The new direct term is not a property of the vehicle: it is the effect, at the sample, of an input that is linear
    up to the sample. With a shock it gives an algebraic loop; coupled runs use the continuous model.

    Args:
        model: Continuous model.
        step: Sample time [s].
        hold: Input values between samples: "zero" (held) or "first" (linear).

    Returns:
        Discrete model with the same channels.

    Raises:
        ParameterError: The model is already discrete, or the step or the hold is invalid.
    """
    if model.dt is not None:
        raise ParameterError(f"{model.name}: the model is already discrete (dt = {model.dt:g} s)")
    try:
        Ad, B0, B1 = kernel.discretise(model.A, model.B, step)
    except ValueError as error:
        raise ParameterError(f"{model.name}: {error}") from error
    if hold == "zero":
        return StateSpace(Ad, B0 + B1, model.C, model.D, model.inputs, model.outputs, float(step), model.name)
    if hold == "first":
        return StateSpace(
            Ad,
            B0 + Ad @ B1,
            model.C,
            model.D + model.C @ B1,
            model.inputs,
            model.outputs,
            float(step),
            model.name,
        )
    raise ParameterError(f"{model.name}: unknown hold {hold!r}; choose 'zero' or 'first'")


# ---- JSON files of identified vehicles ------------------------------------------------------------------------------

#: Newest schema of these files that can be read.
SCHEMA = 1

_NEEDED = ("name", "inputs", "outputs", "A", "B", "C", "D")
_OPTIONAL = ("schema", "kind", "tool", "model", "dt", "baseline_damping", "static", "sources", "friction", "validity")


def read_json(path: str | Path) -> IdentifiedVehicle:
    """Read an identified vehicle.

    Raises:
        FileFormatError: The file does not exist, is not JSON, or has an unsupported schema.
        ParameterError: The model is not consistent.
        UnknownUnitError: A channel's unit is not SI.
    """
    path = Path(path)
    return from_document(path, _load(path))


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
        return _vehicle(content)
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error
    except MALFORMED as error:
        what = f"does not contain a vehicle in the format of this version ({error})"
        raise FileFormatError(what, path=path) from error


def write_json(path: str | Path, vehicle: IdentifiedVehicle) -> None:
    """Write an identified vehicle; numbers that are read back are bitwise equal."""
    with atomic_path(path) as temporary:
        temporary.write_text(_rows_on_lines(document(vehicle)), encoding="utf-8")


def document(vehicle: IdentifiedVehicle) -> dict[str, Any]:
    """Return the content of a vehicle file: texts, numbers, lists and tables."""
    model = vehicle.state_space
    return {
        "schema": SCHEMA,
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


def _friction(vehicle: IdentifiedVehicle) -> dict[str, Any]:
    """Return the entry of the friction; empty without friction, so that older versions can read the file."""
    entries = {port: {"force": law.force, "velocity": law.velocity} for port, law in vehicle.friction.items()}
    return {"friction": entries} if entries else {}


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


def _load(path: Path) -> dict[str, Any]:
    content = json_content(path)
    if not isinstance(content, dict):
        raise FileFormatError("is JSON, but not a vehicle: it must be an object in braces", path=path)
    return content


def _check_keys(path: Path, content: dict[str, Any]) -> None:
    if content.get("model", "state_space") != "state_space":
        raise FileFormatError(f"model is {content['model']!r}; a JSON vehicle is a 'state_space'", path=path)
    for key in _NEEDED:
        if key not in content:
            raise ParameterError(f"{path}: {key!r} is missing; a vehicle needs {', '.join(_NEEDED)}")
    for key in content:
        if key not in (*_NEEDED, *_OPTIONAL, "model_name"):
            raise ParameterError(f"{path}: unknown key {key!r}; the known keys are {', '.join((*_NEEDED, *_OPTIONAL))}")


def _vehicle(content: dict[str, Any]) -> IdentifiedVehicle:
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
    return IdentifiedVehicle(
        name,
        model,
        content.get("baseline_damping", {}),
        content.get("static", {}),
        content.get("sources", {}),
        {port: Friction(law["force"], law["velocity"]) for port, law in content.get("friction", {}).items()},
        Validity.from_json(content["validity"]) if "validity" in content else None,
    )


def _matrix(rows: Any, shape: tuple[int, ...]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the rows as a matrix; an empty list gives an empty matrix of the given shape."""
    matrix = np.asarray(rows, dtype=np.float64)
    return np.zeros(shape) if matrix.size == 0 and 0 in shape else matrix
