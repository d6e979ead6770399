"""MATLAB files (version 5 to 7.2) with one vector per channel."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.confined import read_confined
from eightpost.errors import FileFormatError
from eightpost.files import atomic_path
from eightpost.signals.channel_map import TIME_NAMES
from eightpost.signals.faults import Origin
from eightpost.signals.provenance import parse_header, time_series_header
from eightpost.signals.raw_record import RawRecord, split_header

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries


def read_mat(path: str | Path) -> RawRecord:
    """Read the vectors of a .mat file, at the top level or in its only struct.

    Units are taken from a struct `units` with one field per variable, otherwise from the names (`x_mm`), otherwise from
    the caller. Scalars and texts are ignored; vectors must be as long as the time vector.

    Raises:
        FileFormatError: scipy cannot read the file (version 7.3 is HDF5), or the vectors have different lengths.
    """
    path = Path(path)
    content: dict[str, Any] = read_confined("eightpost.confined.readers:load_matlab", path, True, kind="a MATLAB file")
    header = parse_header(str(content.pop("eightpost")), path) if "eightpost" in content else {}
    titles = _texts(content.pop("channel_names", {}), "channel_names", path)
    units = content.pop("units", {})
    if len(content) == 1 and isinstance(next(iter(content.values())), dict):
        content = next(iter(content.values()))
        units = units or content.pop("units", {})
    vectors = {name: column for name, value in content.items() if (column := _vector(value)) is not None}
    _check_lengths(vectors, path)
    units = header.get("units") or _texts(units, "units", path)
    split = [_named(titles.get(name, name), units) for name in vectors]
    names, stated = tuple(name for name, _ in split), tuple(unit for _, unit in split)
    return RawRecord(Origin(path), names, stated, tuple(vectors.values()))


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


def _vector(value: object) -> NDArray[np.float64] | None:
    """Return a numeric vector (N,), or None for any other value."""
    if not isinstance(value, np.ndarray) or value.dtype.kind not in "iuf" or value.ndim != 1:
        return None
    return value.astype(np.float64)


def _check_lengths(vectors: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    if not vectors:
        raise FileFormatError("it contains no numeric vector", path=path)
    times = [name for name in vectors if name.lower() in TIME_NAMES] or list(vectors)
    length = vectors[times[0]].size
    for name, vector in vectors.items():
        if vector.size != length:
            raise FileFormatError(
                f"it has {vector.size} samples, but {times[0]!r} has {length}; save vectors of equal length",
                path=path,
                channel=name,
            )


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
