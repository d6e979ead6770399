"""Files of variables: MATLAB files, MATLAB scripts and JSON, with one vector per channel, or with matrices."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, json_content, reading
from eightpost.signals.faults import Origin
from eightpost.signals.parquet_file import parse_header, time_series_header
from eightpost.signals.raw_record import TIME_NAMES, RawRecord
from eightpost.signals.table_text import decoded, named_with_unit

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries


def read_mat(path: Path) -> tuple[RawRecord, ...]:
    """Read the vectors of a .mat file, at the top level or in the only struct that has vectors, at any depth.

    Channels may also be structs with samples and unit (`Force.data`, `Force.unit`), or an array of such structs with
    their names. An array of structs that are recordings (`File`, `Data.signals`) has a table of each. Units are taken
    from a struct `units` with one field per variable, otherwise from the names (`x_mm`), otherwise from the caller.
    Scalars, texts and vectors that are not as long as the time vector are ignored. Columns of a matrix are named as in
    MATLAB, `data(:,2)`.

    Raises:
        FileFormatError: The file cannot be read (version 7.3 needs h5py), or contains no numeric vector.
    """
    content: dict[str, Any] = read_confined("eightpost.confined.readers:load_matlab", path, True, kind="a MATLAB file")
    return tuple(_record(dict(run), path) for run in _runs_in(content))


def read_json(path: Path) -> tuple[RawRecord, ...]:
    """Read the lists of numbers of a JSON file like the vectors of a .mat file; rows of objects are columns.

    Other entries are the preamble.

    Raises:
        FileFormatError: The file is not JSON, is a file of this program, or contains no list of numbers.
    """
    content = json_content(path)
    rows = content if isinstance(content, list) else [content]
    if not rows or not all(isinstance(row, dict) for row in rows):
        raise FileFormatError("it contains no names of channels; write an object with a list for each one", path=path)
    if "kind" in rows[0]:
        raise FileFormatError(f"is a {rows[0]['kind']} file, not a record; give the record", path=path)
    if len(rows) > 1:
        rows = [{name: [row.get(name, np.nan) for row in rows] for name in rows[0]}]
    return (_record({name: _as_arrays(value) for name, value in rows[0].items()}, path),)


def _as_arrays(value: Any) -> Any:
    """Return an entry of JSON with arrays in place of lists of numbers."""
    if isinstance(value, dict):
        return {name: _as_arrays(one) for name, one in value.items()}
    try:
        return np.array(value, dtype=np.float64) if isinstance(value, list) else value
    except (TypeError, ValueError):  # texts, or rows of several lengths
        return [_as_arrays(one) for one in value]


#: A vector or a matrix of numbers, and a text, in a MATLAB script. A name begins where no other part of a name ends:
#: a search from every letter of a long word would take minutes.
_NUMBERS = re.compile(r"(?<![\w.])([A-Za-z][\w.]*+)\s*+=\s*\[([^\[\]]*)\]")
_TEXT = re.compile(r"(?<![\w.])([A-Za-z][\w.]*+)\s*+=\s*'([^'\n]*)'")


def read_script(path: Path) -> tuple[RawRecord, ...]:
    """Read the vectors of a MATLAB script, such as the damper curves of a vehicle model: one table for each struct.

    Of a vector `Damper.x`, the text `Damper.xUnit` is the unit, and `Damper.xComment` the name; without the latter its
    name is `Damper.x`, whose letters say nothing.

    Raises:
        FileFormatError: There are no two vectors of one length in a struct.
    """
    with reading(path):
        text = re.sub(r"(?m)%.*$", "", re.sub(r"\.\.\..*(?:\n|\Z)", " ", decoded(path.read_bytes())))
    texts = dict(_TEXT.findall(text))
    tables: dict[str, dict[str, Any]] = {}
    for name, cells in _NUMBERS.findall(text):
        rows = [re.split(r"[\s,]+", row.strip()) for row in re.split(r"[;\n]", cells) if row.strip()]
        with suppress(ValueError):  # an expression
            tables.setdefault(name.rpartition(".")[0], {})[name] = np.array(rows, dtype=np.float64).squeeze()
    records = []
    for stem, vectors in tables.items():
        titles = {name: f"{texts.get(f'{name}Comment', name)} [{texts.get(f'{name}Unit', '')}]" for name in vectors}
        content = {titles[name].removesuffix(" []"): value for name, value in vectors.items()}
        if len(_vectors(content)) > 1:
            records.append(_record({**content, "Setting": stem} if len(tables) > 1 else content, path))
    if not records:
        raise FileFormatError("it contains no two vectors of numbers, such as v = [...]; F = [...];", path=path)
    return tuple(records)


def _record(content: dict[str, Any], path: Path) -> RawRecord:
    """Return the table of the variables of a file."""
    header = parse_header(str(content.pop("eightpost")), path) if "eightpost" in content else {}
    titles = _texts(content.pop("channel_names", {}), "channel_names", path)
    facts = tuple((f"{name}: {value}",) for name, value in content.items() if isinstance(value, (str, int, float)))
    content, units = opened(content)
    vectors = _same_length(_vectors(content), path)
    units = header.get("units") or _texts(units, "units", path)
    names, stated = zip(*(named_with_unit(titles.get(name, name), units) for name in vectors), strict=True)
    return RawRecord(Origin(path), names, stated, tuple(vectors.values()), facts)


def _texts(struct: object, name: str, path: Path) -> dict[str, str]:
    """Return the texts of a struct by field; empty for an empty array in place of the struct."""
    if not isinstance(struct, dict):
        if isinstance(struct, np.ndarray) and struct.size == 0:
            return {}
        raise FileFormatError(f"must be a struct with one text per variable, not {_description(struct)}", path=path,
                              channel=name)  # fmt: skip
    given = {key: text for key, text in struct.items() if not isinstance(text, np.ndarray) or text.size > 0}
    for key, text in given.items():
        if not isinstance(text, str):
            what = f"must be a text such as 'mm/s', not {_description(text)}"
            raise FileFormatError(what, path=path, channel=f"{name}.{key}")
    return given


def _description(value: object) -> str:
    return repr(value) if isinstance(value, (int, float)) else f"a {type(value).__name__}"


def _vectors(content: Mapping[str, Any]) -> dict[str, NDArray[np.float64]]:
    """Return all numeric vectors by name: fields of structs as `run.force`, columns of a matrix as `data(:,2)`."""
    found: dict[str, NDArray[np.float64]] = {}
    for name, value in content.items():
        if isinstance(value, dict):
            found |= {f"{name}.{field}": vector for field, vector in _vectors(value).items()}
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 1:
            found[name] = value.astype(np.float64)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf" and value.ndim == 2:
            across = value.shape[1] > value.shape[0]
            rows = value if across else value.T
            for number, row in enumerate(rows, 1):
                found[f"{name}({number},:)" if across else f"{name}(:,{number})"] = row.astype(np.float64)
    return found


def _same_length(vectors: Mapping[str, NDArray[np.float64]], path: Path) -> dict[str, NDArray[np.float64]]:
    """Return the vectors that are as long as the time vector; without one, as long as most vectors."""
    sizes = {name: vector.size for name, vector in vectors.items() if vector.size > 1}
    if not sizes:
        raise FileFormatError("it contains no numeric vector", path=path)
    times = [name for name in sizes if re.split(r"\.", name)[-1].lower() in TIME_NAMES]
    lengths = [*sizes.values()]
    length = sizes[times[0]] if times else max(lengths, key=lengths.count)
    return {name: vectors[name] for name, size in sizes.items() if size == length}


def write_mat(
    series: TimeSeries, path: str | Path, *, sources: Mapping[str, str] | None = None, note: str = ""
) -> None:
    """Write a series as a .mat file: one vector per channel, structs `units` and `channel_names`, eightpost's header.

    Names that MATLAB does not allow are changed (`lf.road` to `lf_road`); `channel_names` contains the original names.

    Args:
        series: Series to write.
        path: Path of the file, which is replaced atomically.
        sources: SHA-256 digests by name of the files from which the series was made.
        note: Description of the data for the user.
    """
    units = {"time": "s", **dict(zip(series.names, series.units, strict=True))}
    variables = _variables(tuple(units))
    values = dict(zip(variables, (series.time, *series.values), strict=True))
    content: dict[str, Any] = {
        **values,
        "units": dict(zip(variables, units.values(), strict=True)),
        "channel_names": dict(zip(variables, units, strict=True)),
        "eightpost": time_series_header(units, sources=sources, note=note),
    }
    import scipy.io  # noqa: PLC0415  # loaded here because few runs need this writer

    with atomic_path(path) as temporary:
        scipy.io.savemat(temporary, content, long_field_names=True, oned_as="column")


def _variables(names: tuple[str, ...]) -> list[str]:
    """Return a unique MATLAB variable name for each channel name."""
    taken: list[str] = ["units", "channel_names", "eightpost"]
    for name in names:
        stem = re.sub(r"\W", "_", name, flags=re.ASCII)[:50]
        stem = stem if stem[:1].isalpha() else f"c_{stem}"
        count = sum(1 for other in taken if re.sub(r"__\d+$", "", other) == stem)
        taken.append(f"{stem}__{count}" if count else stem)
    return taken[3:]


# ---- Structs of MATLAB files: the struct that contains the channels, and channels that are structs ------------------

#: Fields with the samples, the unit and the name of a channel, in lower case.
_SAMPLES = ("data", "values", "value", "samples", "y", "signal")
_UNIT = ("unit", "units", "unit_string", "yunit")
_NAME = ("name", "channel", "label", "channelname")


def opened(content: Mapping[str, Any]) -> tuple[dict[str, Any], Any]:
    """Return the variables of the only struct that has vectors, or those of the file, and the struct of their units.

    Structs are mappings, arrays of structs are sequences of mappings.
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
    # An empty text of MATLAB is an empty array.
    return [{"name": name, "data": row["Data"], "unit": unit if isinstance(unit := row.get("Unit"), str) else None}
            for name, row in named]  # fmt: skip


def _index_of_times(signal: Mapping[str, Any], count: int) -> int:
    """Return the number of the times of a signal, from 1 to `count`; 0 if it states none of several."""
    stated = np.asarray(signal.get("XIndex", ()))
    if stated.size == 1 and stated.dtype.kind in "iuf":
        return int(stated.item())
    return 1 if count == 1 else 0


def _rows(value: Any) -> list[Mapping[str, Any]]:
    """Return the structs of a struct or of an array of structs; nothing for other values."""
    if isinstance(value, Mapping):
        return [value]
    is_array = isinstance(value, np.ndarray) and value.dtype == object and value.ndim == 1
    rows = list(value) if isinstance(value, (list, tuple)) or is_array else []
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
    rows = _rows(value)
    if not rows or isinstance(value, Mapping):
        return dict(value) if isinstance(value, Mapping) else value
    names = [_field(row, _NAME) for row in rows]
    if not all(isinstance(name, str) and name for name in names) or len(set(names)) < len(names):
        return value
    return dict(zip(names, map(dict, rows), strict=True))


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


def _runs_in(content: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the structs of the only array of structs if each is a recording, as in CTW's files; else the variables."""
    arrays = [rows for value in content.values() if len(rows := _rows(value)) > 1]
    if len(arrays) != 1 or any(_is_vector(_field(row, _SAMPLES)) or not _has_vector(row) for row in arrays[0]):
        return [content]
    return arrays[0]
