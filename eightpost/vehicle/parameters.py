"""TOML files with vehicle parameters, written by hand: `track_width = "70 in"`."""

from __future__ import annotations

import re
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any

from scipy.constants import g

import eightpost
from eightpost.corners import CORNERS
from eightpost.errors import ParameterError, UnknownUnitError
from eightpost.files import atomic_path, check_schema, toml_content
from eightpost.units import compatible, convert
from eightpost.vehicle.quantities import Corners
from eightpost.vehicle.quarter_car import QuarterCar
from eightpost.vehicle.seven_dof import SevenDof
from eightpost.vehicle.vehicles import StructuralVehicle

#: Newest schema of these files that can be read.
SCHEMA = 1

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
    check_schema(content, SCHEMA, path)
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
        f"schema = {SCHEMA}",
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
