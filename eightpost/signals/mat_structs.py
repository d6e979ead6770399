"""Structs of MATLAB files: the struct that contains the channels, and channels that are structs themselves."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

#: Fields with the samples, the unit and the name of a channel, in lower case.
_SAMPLES = ("data", "values", "value", "samples", "y", "signal")
_UNIT = ("unit", "units", "unit_string", "yunit")
_NAME = ("name", "channel", "label", "channelname")


def opened(content: Mapping[str, Any]) -> tuple[dict[str, Any], Any]:
    """Return the variables of the only struct that has vectors, or those of the file, and the struct of their units.

    Args:
        content: Variables by name; structs are mappings, arrays of structs are sequences of mappings.
    """
    content = {name: _as_struct(_recorded(value) or value) for name, value in content.items()}
    units = content.pop("units", {})
    while True:
        content, more = _with_plain_channels(content)
        units = more if _is_empty(units) else units
        inner = [value for value in content.values() if isinstance(value, dict) and _has_vector(value)]
        if len(inner) != 1 or any(_is_vector(value) for value in content.values()):
            return content, units
        content = {name: _as_struct(value) for name, value in inner[0].items()}
        own = content.pop("units", {})
        units = units if _is_empty(own) else own


def _recorded(value: Any) -> list[dict[str, Any]]:
    """Return the channels of a recording of ControlDesk: a struct with X (times) and Y (signals), each with Data.

    Signals with other times than most have are left out. Of a path `"Model Root"/"Force"/"Out1"` the name is the
    last part that is not a port, unless it is not unique.
    """
    axes, signals = (_rows(value.get(field)) for field in "XY") if isinstance(value, Mapping) else ([], [])
    if not axes or not signals or not all("Data" in row for row in (*axes, *signals)):
        return []
    indices = [_index_of_times(row, len(axes)) for row in signals]
    if not all(1 <= index <= len(axes) for index in indices):
        return []
    most = max(indices, key=indices.count)
    times = axes[most - 1]
    signals = [row for row, index in zip(signals, indices, strict=True) if index == most]
    paths = [str(row.get("Name", "")) for row in signals]
    short = [_last_part(path) for path in paths]
    names = short if len(set(short)) == len(short) else paths
    named = zip(["time", *names], [times, *signals], strict=True)
    return [{"name": name, "data": row["Data"], "unit": _text_or_none(row.get("Unit"))} for name, row in named]


def _index_of_times(signal: Mapping[str, Any], count: int) -> int:
    """Return the number of the times of a signal, from 1 to `count`; 0 if it states none of several."""
    stated = np.asarray(signal.get("XIndex", ()))
    if stated.size == 1 and stated.dtype.kind in "iuf":
        return int(stated.item())
    return 1 if count == 1 else 0


def _text_or_none(value: Any) -> str | None:
    return value if isinstance(value, str) and value else None  # an empty text of MATLAB is an empty array


def _rows(value: Any) -> list[Mapping[str, Any]]:
    """Return the structs of a struct or of an array of structs; nothing for other values."""
    if isinstance(value, Mapping):
        return [value]
    rows = list(value) if isinstance(value, list) or _is_array_of_objects(value) else []
    return rows if all(isinstance(row, Mapping) for row in rows) else []


def _last_part(path: str) -> str:
    """Return the last part of a signal's path that is not a port (`Out1`, `Value`)."""
    parts = [part.strip().strip('"') for part in path.split("/")]
    kept = [part for part in parts if part and not re.fullmatch(r"(?:In|Out)\d+|Value|Gain", part)]
    return kept[-1] if kept else path


def _is_empty(units: Any) -> bool:
    return isinstance(units, Mapping) and not units


def _as_struct(value: Any) -> Any:
    """Return an array of structs with names as a struct of channels; other values unchanged."""
    rows = list(value) if isinstance(value, (list, tuple)) or _is_array_of_objects(value) else []
    if not rows or not all(isinstance(row, Mapping) for row in rows):
        return dict(value) if isinstance(value, Mapping) else value
    names = [_field(row, _NAME) for row in rows]
    if not all(isinstance(name, str) and name for name in names) or len(set(names)) < len(names):
        return value
    return dict(zip(names, map(dict, rows), strict=True))


def _is_array_of_objects(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1


def _with_plain_channels(content: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """Return variables in which structs of samples and unit are vectors, and the units of these."""
    found: dict[str, Any] = {}
    units: dict[str, str] = {}
    for name, value in content.items():
        samples = _field(value, _SAMPLES) if isinstance(value, Mapping) else None
        vectors = [one for one in value.values() if _is_vector(one)] if isinstance(value, Mapping) else []
        if not _is_vector(samples) or len(vectors) != 1:
            found[name] = value
            continue
        found[name] = samples
        if isinstance(unit := _field(value, _UNIT), str):
            units[name] = unit
    return found, units


def _field(struct: Mapping[str, Any], names: Sequence[str]) -> Any:
    """Return the first field of a struct with one of the names; None without one."""
    fields = {str(name).lower(): value for name, value in struct.items()}
    return next((fields[name] for name in names if name in fields), None)


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.size > 1


def _has_vector(struct: Mapping[str, Any]) -> bool:
    inner = map(_as_struct, struct.values())
    return any(_is_vector(one) or (isinstance(one, Mapping) and _has_vector(one)) for one in inner)


def runs_in(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the structs of the only array of structs if each is a recording, as in CTW's files; else the variables."""
    arrays = [rows for value in content.values() if len(rows := _rows(value)) > 1]
    if len(arrays) != 1 or any(_is_vector(_field(row, _SAMPLES)) or not _has_vector(row) for row in arrays[0]):
        return [content]
    return arrays[0]
