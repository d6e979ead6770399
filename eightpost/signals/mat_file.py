"""Files of variables: MATLAB files, MATLAB scripts and JSON, with one vector per channel, or with matrices."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, json_content, reading
from eightpost.signals.channel_map import TIME_NAMES
from eightpost.signals.column_headers import split_header
from eightpost.signals.faults import Origin
from eightpost.signals.mat_structs import opened, runs_in
from eightpost.signals.provenance import parse_header, time_series_header
from eightpost.signals.raw_record import RawRecord
from eightpost.signals.text_cleaning import decoded

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries


def read_mat(path: str | Path) -> tuple[RawRecord, ...]:
    """Read the vectors of a .mat file, at the top level or in the only struct that has vectors, at any depth.

    Channels may also be structs with samples and unit (`Force.data`, `Force.unit`), or an array of such structs with
    their names. An array of structs that are recordings (`File`, `Data.signals`) has a table of each. Units are taken
    from a struct `units` with one field per variable, otherwise from the names (`x_mm`), otherwise from the caller.
    Scalars, texts and vectors that are not as long as the time vector are ignored. Columns of a matrix are named as in
    MATLAB, `data(:,2)`.

    Raises:
        FileFormatError: The file cannot be read (version 7.3 needs h5py), or contains no numeric vector.
    """
    path = Path(path)
    content: dict[str, Any] = read_confined("eightpost.confined.readers:load_matlab", path, True, kind="a MATLAB file")
    return tuple(_record(dict(run), path) for run in runs_in(content))


def read_json(path: str | Path) -> tuple[RawRecord, ...]:
    """Read the lists of numbers of a JSON file like the vectors of a .mat file; rows of objects are columns.

    Other entries are the preamble.

    Raises:
        FileFormatError: The file is not JSON, is a file of this program, or contains no list of numbers.
    """
    path = Path(path)
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


#: A vector or a matrix of numbers, and a text, in a MATLAB script.
_NUMBERS = re.compile(r"([A-Za-z][\w.]*)\s*=\s*\[([^\[\]]*)\]")
_TEXT = re.compile(r"([A-Za-z][\w.]*)\s*=\s*'([^'\n]*)'")


def read_script(path: str | Path) -> tuple[RawRecord, ...]:
    """Read the vectors of a MATLAB script, such as the damper curves of a vehicle model: one table for each struct.

    Of a vector `Damper.x`, the text `Damper.xUnit` is the unit, and `Damper.xComment` the name; without the latter its
    name is `Damper.x`, whose letters say nothing.

    Raises:
        FileFormatError: There are no two vectors of one length in a struct.
    """
    path = Path(path)
    with reading(path):
        text = re.sub(r"(?m)%.*$", "", re.sub(r"\.\.\..*\n", " ", decoded(path.read_bytes())))
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
    split = [_named(titles.get(name, name), units) for name in vectors]
    names, stated = tuple(name for name, _ in split), tuple(unit for _, unit in split)
    return RawRecord(Origin(path), names, stated, tuple(vectors.values()), facts)


def _texts(struct: object, name: str, path: Path) -> dict[str, str]:
    """Return the texts of a struct by field; empty for an empty array in place of the struct.

    Raises:
        FileFormatError: The value is not a struct, or a field is not a text.
    """
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


def _named(name: str, units: Mapping[str, str]) -> tuple[str, str | None]:
    return (name, units[name]) if name in units else split_header(name)


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
