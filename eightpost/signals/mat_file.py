"""MATLAB files (version 5 to 7.2): one vector per channel."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy

from eightpost.errors import FileFormatError
from eightpost.files import atomic_path
from eightpost.signals.channel_map import TIME_NAMES
from eightpost.signals.header import split_header
from eightpost.signals.origin import Origin
from eightpost.signals.provenance import parse_header, time_series_header
from eightpost.signals.raw_record import RawRecord

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries


def read_mat(path: str | Path) -> RawRecord:
    """Read the vectors of a .mat file, at the top or in its only struct.

    Units come from a struct `units` with a field per variable, else from the names (`x_mm`), else from the
    caller.
    Scalars and texts are passed over; vectors must be as long as the time vector.

    Raises:
        FileFormatError: Not a .mat file that scipy reads (7.3 is HDF5), or vectors of several lengths.
    """
    path = Path(path)
    content = _load(path)
    header = parse_header(str(content.pop("eightpost")), path) if "eightpost" in content else {}
    titles = content.pop("channel_names", {})
    units = content.pop("units", {})
    if len(content) == 1 and isinstance(next(iter(content.values())), dict):
        content = next(iter(content.values()))
        units = units or content.pop("units", {})
    vectors = {name: column for name, value in content.items() if (column := _vector(value)) is not None}
    _check_lengths(vectors, path)
    units = header.get("units") or units
    split = [_named(titles.get(name, name), units) for name in vectors]
    names, said = tuple(name for name, _ in split), tuple(unit for _, unit in split)
    return RawRecord(Origin(path), names, said, tuple(vectors.values()))


def _load(path: Path) -> dict[str, Any]:
    try:
        content = scipy.io.loadmat(path, simplify_cells=True)
    except NotImplementedError as error:
        what = "it is a MATLAB 7.3 (HDF5) file, which is not read; save it again with `save(..., '-v7')`"
        raise FileFormatError(what, path=path) from error
    except (scipy.io.matlab.MatReadError, ValueError, TypeError, EOFError) as error:
        raise FileFormatError(f"not a MATLAB file: {error}", path=path) from error
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _vector(value: object) -> NDArray[np.float64] | None:
    """Return a numeric vector (N,), None for anything else."""
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or array.ndim != 1:
        return None
    return array.astype(np.float64)


def _check_lengths(vectors: Mapping[str, NDArray[np.float64]], path: Path) -> None:
    if not vectors:
        raise FileFormatError("there is no numeric vector in it", path=path)
    times = [name for name in vectors if name.lower() in TIME_NAMES] or list(vectors)
    length = vectors[times[0]].size
    for name, vector in vectors.items():
        if vector.size != length:
            raise FileFormatError(
                f"it has {vector.size} samples, {times[0]!r} has {length}; save vectors of one length",
                path=path,
                channel=name,
            )


def _named(name: str, units: Mapping[str, str]) -> tuple[str, str | None]:
    return (name, str(units[name])) if name in units else split_header(name)


def write_mat(
    series: TimeSeries, path: str | Path, *, sources: Mapping[str, str] | None = None, note: str = ""
) -> None:
    """Write a series as a .mat file: a vector per channel, structs `units` and `channel_names`, our header.

    A name that MATLAB does not admit (`lf.road`) becomes one that it does (`lf_road`); `channel_names` keeps
    the first.

    Args:
        series: The series.
        path: The file; replaced whole or not at all.
        sources: SHA-256 digest by name of each file that the series was made from.
        note: What the data are, for people.
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
