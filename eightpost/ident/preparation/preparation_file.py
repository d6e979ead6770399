"""TOML files with the settings of a preparation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from eightpost.errors import InputError, ParameterError
from eightpost.files import toml_content
from eightpost.ident.preparation.decimation import Decimation
from eightpost.ident.preparation.preparation import Preparation
from eightpost.rig.post.car import Geometry
from eightpost.units import convert, quantity

_KEYS = ("rate", "pot_cutoff", "settling", "same_start", "mass", "delays", "geometry")
#: Value of `pot_cutoff` that keeps the records' own velocities.
_OWN = "own"


def read_preparation(path: str | Path) -> Preparation:
    """Read the settings of a preparation from a TOML file; missing keys take the defaults of `Preparation`.

    Every number needs a unit::

        rate = "125 Hz"
        pot_cutoff = "50 Hz"        # or "own": keep the records' velocities
        settling = "2 s"
        same_start = "lf.road"
        mass = "1400 kg"

        [delays]
        "lf.force" = "4.2 ms"

        [geometry]                  # complete, or omit the table
        front_axle = "60 in"

    Raises:
        FileFormatError: The file does not exist or is not TOML.
        ParameterError: A key or a value is invalid.
    """
    path = Path(path)
    content = toml_content(path)
    _check_keys(path, content, _KEYS, "")
    given: dict[str, Any] = {}
    rate = _si(path, "rate", content["rate"], "Hz") if "rate" in content else None
    if "pot_cutoff" in content:
        own = content["pot_cutoff"] == _OWN
        given["pot_cutoff"] = None if own else _si(path, "pot_cutoff", content["pot_cutoff"], "Hz")
    if "settling" in content:
        given["settling"] = _si(path, "settling", content["settling"], "s")
    if "mass" in content:
        given["mass"] = _si(path, "mass", content["mass"], "kg")
    if "same_start" in content:
        given["same_start"] = str(content["same_start"])
    delays = _table(path, content, "delays")
    given["delays"] = {name: _si(path, f"delays.{name}", value, "s") for name, value in delays.items()}
    if "geometry" in content:
        given["geometry"] = _geometry(path, _table(path, content, "geometry"))
    try:
        if rate is not None:
            given["decimation"] = Decimation(rate)
        return Preparation(**given)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from error


def _geometry(path: Path, table: Mapping[str, Any]) -> Geometry:
    names = tuple(declared.name for declared in fields(Geometry))
    _check_keys(path, table, names, "geometry.")
    missing = [name for name in names if name not in table]
    if missing:
        raise ParameterError(f"{path}: [geometry] lacks {', '.join(missing)}; add them, e.g. {missing[0]} = '60 in'")
    return Geometry(**{name: _si(path, f"geometry.{name}", table[name], "m") for name in names})


def _check_keys(path: Path, table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in known:
            raise ParameterError(f"{path}: unknown key {where + key!r}; the known keys are {', '.join(known)}")


def _table(path: Path, content: Mapping[str, Any], key: str) -> dict[str, Any]:
    table = content.get(key, {})
    if not isinstance(table, dict):
        raise ParameterError(f"{path}: {key!r} must be a table, [{key}], not {table!r}")
    return table


def _si(path: Path, key: str, value: object, unit: str) -> float:
    try:
        number, given = quantity(str(value))
        return float(convert(number, given, unit))
    except InputError as error:
        raise ParameterError(f"{path}: {key!r} is {value!r}; write a number with a unit of {unit}: {error}") from error
