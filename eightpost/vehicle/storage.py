"""Vehicle files: TOML with parameters, written by hand, and JSON of identified vehicles."""

from __future__ import annotations

import json
import re
from dataclasses import MISSING, Field, asdict, fields, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.constants import g

import eightpost
from eightpost.corners import CORNERS
from eightpost.errors import FileFormatError, InputError, ParameterError, UnknownUnitError
from eightpost.files import MALFORMED, atomic_path, check_schema, json_content, toml_content
from eightpost.units import compatible, convert
from eightpost.validity import Validity
from eightpost.vehicle.bristle import Bristle
from eightpost.vehicle.quarter_car import QuarterCar
from eightpost.vehicle.seven_dof import SevenDof
from eightpost.vehicle.statespace import Channel, StateSpace
from eightpost.vehicle.structural import Corners
from eightpost.vehicle.vehicles import Friction, IdentifiedVehicle, StructuralVehicle, Vehicle

# ==== Parameters in TOML: `track_width = "70 in"` ====================================================================

#: Newest schema of these files that can be read.
TOML_SCHEMA = 1

MODELS: dict[str, type[QuarterCar] | type[SevenDof]] = {"quarter_car": QuarterCar, "seven_dof": SevenDof}
_TOP_LEVEL = ("schema", "model", "name", "notes", "tool", "parameters", "static")
_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")
_AXLES = {"front": ("lf", "rf"), "rear": ("lr", "rr")}
# Static values of each model: key of [static], unit and places.
_STATIC: dict[str, dict[str, tuple[str, tuple[str, ...]]]] = {
    "quarter_car": {"tire_force": ("N", ("",)), "ride_height": ("m", ("",))},
    "seven_dof": {"tire_force": ("N", CORNERS), "ride_height": ("m", ("front", "rear"))},
}


def read_toml(path: str | Path) -> StructuralVehicle:
    """Read a vehicle's parameters.

    Every value is a number with its unit in quotes. A corner parameter has one value for all corners
    (`"2000 lbf/in"`), one per axle (`{ front = "1280 lbf/in", rear = "588 lbf/in" }`) or one per corner
    (`{ lf = ..., rf = ..., lr = ..., rr = ... }`). A mass may be given as a weight: `sprung_weight = "675 lbf"`.

    Raises:
        FileFormatError: The file does not exist, is not TOML, or has an unsupported schema.
        ParameterError: A key is unknown or missing, or a value is outside its range.
        UnknownUnitError: A unit is unknown or has the wrong dimension.
    """
    path = Path(path)
    content = toml_content(path)
    check_schema(content, TOML_SCHEMA, path)
    model = content.get("model")
    if model is None:
        is_other = "bank" in content or "components" in content
        what = "a study or a system, not a vehicle" if is_other else "no model of a vehicle"
        raise ParameterError(
            f"{path}: the file defines {what}; a vehicle file has model = {' or '.join(map(repr, MODELS))}"
        )
    if not isinstance(model, str) or model not in MODELS:
        raise ParameterError(f"{path}: model is {model!r}; choose one of {', '.join(MODELS)}")
    _check_known(path, "key", content, _TOP_LEVEL)
    values = _read_parameters(path, MODELS[model], _table(path, content, "parameters"))
    try:
        return StructuralVehicle(
            str(content.get("name", path.stem)),
            MODELS[model](**values),
            _read_static(path, model, _table(path, content, "static")),
        )
    except ParameterError as error:
        raise ParameterError(f"{path}, [parameters]: {error}") from error


def write_toml(path: str | Path, vehicle: StructuralVehicle) -> None:
    """Write a vehicle's parameters in SI; numbers that are read back are bitwise equal."""
    lines = [
        f"schema = {TOML_SCHEMA}",
        f"tool = {_quoted(f'eightpost {eightpost.__version__}')}",
        f"model = {_quoted(vehicle.model)}",
        f"name = {_quoted(vehicle.name)}",
        "",
        "[parameters]",
    ]
    for declared in fields(vehicle.parameters):
        value = getattr(vehicle.parameters, declared.name)
        if value is not None:
            lines.append(f"{declared.name} = {_written(value, declared.metadata['unit'])}")
    lines += ["", "[static]", *_static_lines(vehicle)] if vehicle.static else []
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _table(path: Path, content: dict[str, Any], key: str) -> dict[str, Any]:
    table = content.get(key, {})
    if not isinstance(table, dict):
        raise ParameterError(f"{path}: {key} is {table!r}; it must be a table: [{key}]")
    return table


def _check_known(path: Path, what: str, table: dict[str, Any], known: tuple[str, ...]) -> None:
    for key in table:
        if key not in known:
            raise ParameterError(f"{path}: unknown {what} {key!r}; the known ones are {', '.join(known)}")


def _read_parameters(path: Path, kind: type[QuarterCar] | type[SevenDof], table: dict[str, Any]) -> dict[str, Any]:
    known = tuple(declared.name for declared in fields(kind))
    weights = tuple(_weight(name) for name in known if name.endswith("mass"))
    _check_known(path, "parameter", table, known + weights)
    values = {}
    for declared in fields(kind):
        key = _key_of(path, declared, table)
        if key is not None:
            values[declared.name] = _read_value(path, key, table[key], declared)
    return values


def _weight(name: str) -> str:
    return name.removesuffix("mass") + "weight"


def _key_of(path: Path, declared: Field[Any], table: dict[str, Any]) -> str | None:
    """Return the key of a parameter in the table, or None if its default applies."""
    name = declared.name
    candidates = (name, _weight(name)) if name.endswith("mass") else (name,)
    given = [key for key in candidates if key in table]
    if len(given) == 2:
        raise ParameterError(f"{path}, [parameters]: both {given[0]} and {given[1]} are given; keep one")
    if given:
        return given[0]
    if declared.default is MISSING:
        unit = declared.metadata["unit"]
        raise ParameterError(
            f'{path}, [parameters]: {" or ".join(candidates)} is missing; add it, e.g. {name} = "... {unit}"'
        )
    return None


def _read_value(path: Path, key: str, value: Any, declared: Field[Any]) -> float | Corners:
    weight = key != declared.name
    unit = "N" if weight else str(declared.metadata["unit"])
    per_corner = declared.type in (Corners, "Corners")
    where = f"{path}, [parameters] {key}"
    numbers = _spread(where, value, unit, CORNERS if per_corner else ("",))
    if weight:
        numbers = {place: number / g for place, number in numbers.items()}
    return Corners(**numbers) if per_corner else numbers[""]


def _read_static(path: Path, model: str, table: dict[str, Any]) -> dict[str, float]:
    known = _STATIC[model]
    _check_known(path, "static value", table, tuple(known))
    static = {}
    for key, value in table.items():
        unit, places = known[key]
        for place, number in _spread(f"{path}, [static] {key}", value, unit, places).items():
            static[f"{place}.{key}" if place else key] = number
    return static


def _spread(where: str, value: Any, unit: str, places: tuple[str, ...]) -> dict[str, float]:
    """Return one number per place from one value for all, one per axle or one per place."""
    if not isinstance(value, dict):
        return dict.fromkeys(places, _quantity(where, value, unit))
    numbers = {}
    for group, text in value.items():
        for place in _AXLES.get(group, (group,)) if places == CORNERS else (group,):
            if place not in places or place in numbers:
                raise ParameterError(f"{where}: {group!r} is not valid here; {_layouts(places)}")
            numbers[place] = _quantity(f"{where}.{group}", text, unit)
    missing = [place for place in places if place not in numbers]
    if missing:
        raise ParameterError(f"{where}: {', '.join(missing)} is missing; {_layouts(places)}")
    return numbers


def _layouts(places: tuple[str, ...]) -> str:
    if places == ("",):
        return "give one value"
    axles = " or front and rear" if places == CORNERS else ""
    return f"give one value for all, or {', '.join(places)}{axles}"


def _quantity(where: str, value: Any, unit: str) -> float:
    """Return the number of a text such as "70 in", converted to `unit`."""
    match = _QUANTITY.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise ParameterError(f'{where} is {value!r}; write a number with its unit in quotes, e.g. "1.5 {unit}"')
    number, given = float(match[1]), match[2]
    if not given:
        raise ParameterError(f'{where}: {value!r} has no unit; add it, e.g. "{match[1]} {unit}"')
    try:
        fits = compatible(given, unit)
    except UnknownUnitError as error:
        raise UnknownUnitError(f"{where}: {error}") from error
    if not fits:
        what = f"{where}: {value!r} has the wrong dimension; give it in {unit} or a unit of the same dimension"
        raise UnknownUnitError(what)
    return convert(number, given, unit)


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def _written(value: float | Corners, unit: str) -> str:
    if isinstance(value, Corners):
        return "{ " + ", ".join(f'{corner} = "{v!r} {unit}"' for corner, v in value._asdict().items()) + " }"
    return f'"{float(value)!r} {unit}"'


def _static_lines(vehicle: StructuralVehicle) -> list[str]:
    lines = []
    for key, (unit, places) in _STATIC[vehicle.model].items():
        named = {place: vehicle.static.get(f"{place}.{key}" if place else key, 0.0) for place in places}
        table = ", ".join(f'{place} = "{number!r} {unit}"' for place, number in named.items())
        lines.append(f"{key} = {{ {table} }}" if places != ("",) else f'{key} = "{named[""]!r} {unit}"')
    return lines


# ==== Reading and writing of vehicle files ===========================================================================

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
