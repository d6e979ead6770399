"""Files of rigs in MTS's format RPC III (.rsp, .drv, .tim): a header of texts, then groups of samples by channel."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.errors import FileFormatError
from eightpost.files import atomic_path, reading
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import RawRecord

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries

#: Bytes of the name of an entry of the header and of the whole entry, and entries of a block.
_NAME, _ENTRY, _PER_BLOCK = 32, 128, 4
_ORDERS = {"BINARY_IEEE_LITTLE_END": "<", "BINARY": "<", "BINARY_IEEE_BIG_END": ">"}
_KINDS = {"SHORT_INTEGER": "i2", "FLOATING_POINT": "f4"}
#: Entries that become the preamble.
_FACTS = ("DATE", "OPERATION", "TIME_TYPE", "PARENT_1")
#: Fewest repeated samples of all channels at the end of the last frame that count as its filling.
_FILLED = 3
#: Points of a frame and largest integer of a file that is written.
_POINTS, _FULL_SCALE = 2048, 32752


def read_rpc(path: str | Path) -> tuple[RawRecord, ...]:
    """Read the channels of a time history with names and units as written, and the column `time` [s].

    Without the entry `SAMPLES`, what fills the last frame (the last sample of each channel) is left out with a note.

    Raises:
        FileFormatError: The file is not a time history in RPC III, or is damaged.
    """
    path = Path(path)
    with reading(path):
        content = path.read_bytes()
    header, start = _header(content, path)
    stated = {"FILE_TYPE": "TIME_HISTORY", "DATA_TYPE": "SHORT_INTEGER", **header}
    kind = _KINDS.get(stated["DATA_TYPE"])
    if kind is None or stated["FILE_TYPE"] != "TIME_HISTORY":
        what = f"contains {stated['FILE_TYPE']} of {stated['DATA_TYPE']}; TIME_HISTORY of {' or '.join(_KINDS)} is read"
        raise FileFormatError(what, path=path)
    frame, count = _integer(header, "PTS_PER_FRAME", path), _integer(header, "CHANNELS", path)
    points = frame * _integer(header, "FRAMES", path)
    group = _integer({"PTS_PER_GROUP": str(frame), **header}, "PTS_PER_GROUP", path)
    data = memoryview(content)[start:]
    values = _values(data, np.dtype(_ORDERS[header["FORMAT"]] + kind), count, group, points, path)
    notes: tuple[str, ...] = ()
    if "SAMPLES" in header:
        values = values[:, : _integer(header, "SAMPLES", path)]
    elif (filled := _filling(values[:, -frame:])) >= _FILLED:
        values = values[:, : points - filled]
        notes = (f"the last {filled} samples were left out: they fill the last frame with one value of each channel",)
    numbers = range(1, count + 1)
    names = [header.get(f"DESC.CHAN_{i}") or f"CHAN_{i}" for i in numbers]
    units = [header.get(f"UNITS.CHAN_{i}") or None for i in numbers]
    scales = [_positive(header, f"SCALE.CHAN_{i}", path) if kind == "i2" else 1.0 for i in numbers]
    time = _positive(header, "DELTA_T", path) * np.arange(values.shape[1])
    columns = [scale * row.astype(np.float64) for scale, row in zip(scales, values, strict=True)]
    facts = tuple((f"{name}: {header[name]}",) for name in _FACTS if header.get(name))
    return (RawRecord(Origin(path), ("time", *names), ("s", *units), (time, *columns), facts, notes),)


def _header(content: bytes, path: Path) -> tuple[dict[str, str], int]:
    """Return the entries of the header by name, and the number of its bytes."""
    first = _entries(content, 3)
    if [*first][:2] != ["FORMAT", "NUM_HEADER_BLOCKS"] or first["FORMAT"] not in _ORDERS:
        raise FileFormatError(f"is not a binary file in RPC III: it begins with {content[:40]!r}", path=path)
    size = _PER_BLOCK * _integer(first, "NUM_HEADER_BLOCKS", path)
    if size * _ENTRY > len(content):
        raise FileFormatError(f"ends within its header of {size * _ENTRY} bytes: copy it again", path=path)
    return _entries(content, size), size * _ENTRY


def _entries(content: bytes, count: int) -> dict[str, str]:
    pairs = (content[k * _ENTRY : (k + 1) * _ENTRY] for k in range(count))
    texts = ((pair[:_NAME], pair[_NAME:]) for pair in pairs)
    found = [tuple(text.split(b"\0")[0].decode("latin-1").strip() for text in pair) for pair in texts]
    return {name: value for name, value in found if name}


def _values(data: memoryview, kind: np.dtype[Any], count: int, group: int, points: int, path: Path) -> NDArray[Any]:
    """Return the samples (C, N) of groups (C, P) that follow each other; the last one may be shorter."""
    whole, rest = divmod(points, group)
    size = whole * count * group
    last = group if rest and len(data) >= kind.itemsize * (size + count * group) else rest
    if len(data) < kind.itemsize * (size + count * last):
        need = kind.itemsize * count * points
        raise FileFormatError(f"ends early: {len(data)} of {need} bytes of samples are there; copy it again", path=path)
    samples = np.frombuffer(data, kind, size + count * last)
    parts = samples[:size].reshape(whole, count, group).swapaxes(0, 1).reshape(count, -1)
    return np.concatenate([parts, samples[size:].reshape(count, last)[:, :rest]], axis=1)


def _filling(frame: NDArray[Any]) -> int:
    """Return how many samples at the end of a frame (C, N) repeat the one before in all channels."""
    changes = np.flatnonzero((np.diff(frame, axis=1) != 0).any(axis=0))
    return int(frame.shape[1] - 2 - changes[-1]) if changes.size else 0


def _integer(header: Mapping[str, str], name: str, path: Path) -> int:
    value = _positive(header, name, path)
    if value != int(value):
        raise FileFormatError(f"its entry {name} is {value:g}, not a whole number", path=path)
    return int(value)


def _positive(header: Mapping[str, str], name: str, path: Path) -> float:
    try:
        value = float(header[name])
    except (KeyError, ValueError):
        value = np.nan
    if not 0.0 < value < np.inf:
        given = f"is {header[name]!r}" if name in header else "is missing"
        raise FileFormatError(f"its entry {name} {given}; it must be a positive number", path=path)
    return value


def write_rpc(series: TimeSeries, path: str | Path, *, as_integers: bool = False) -> None:
    """Write an even series in SI as a time history of floating point numbers, or of short integers with scales.

    Raises:
        FileFormatError: The series is not evenly sampled, a name is too long, or the file cannot be written.
    """
    path = Path(path)
    if not series.is_uniform or len(series) < 2:
        raise FileFormatError("RPC III has one time step; resample the series to even steps", path=path)
    frames = -(-len(series) // _POINTS)
    largest = np.abs(series.values).max(axis=1)
    scales = np.where(largest > 0.0, largest / _FULL_SCALE, 1.0) if as_integers else np.ones(largest.size)
    entries: dict[str, object] = {
        "FORMAT": "BINARY_IEEE_LITTLE_END", "NUM_HEADER_BLOCKS": 0, "NUM_PARAMS": 0, "FILE_TYPE": "TIME_HISTORY",
        "TIME_TYPE": "DRIVE" if path.suffix.lower() == ".drv" else "RESPONSE",
        "DELTA_T": repr(1.0 / series.sample_rate), "CHANNELS": largest.size,
        "DATA_TYPE": "SHORT_INTEGER" if as_integers else "FLOATING_POINT", "PTS_PER_FRAME": _POINTS,
        "PTS_PER_GROUP": _POINTS, "FRAMES": frames, "SAMPLES": len(series), "HALF_FRAMES": 0, "REPEATS": 1,
        "BYPASS_FILTER": 0, "INT_FULL_SCALE": _FULL_SCALE, "PARTITIONS": 1, "PART.CHAN_1": 1,
        "PART.NCHAN_1": largest.size,
    }  # fmt: skip
    for i, (name, unit) in enumerate(zip(series.names, series.units, strict=True), 1):
        row = series.values[i - 1]
        entries |= {f"DESC.CHAN_{i}": name, f"UNITS.CHAN_{i}": unit, f"SCALE.CHAN_{i}": repr(float(scales[i - 1])),
                    f"LOWER_LIMIT.CHAN_{i}": float(row.min()), f"UPPER_LIMIT.CHAN_{i}": float(row.max()),
                    f"MAP.CHAN_{i}": i}  # fmt: skip
    blocks = -(-len(entries) // _PER_BLOCK)
    entries |= {"NUM_HEADER_BLOCKS": blocks, "NUM_PARAMS": len(entries)}
    texts = [(name.encode(), str(value).encode("latin-1", "replace")) for name, value in entries.items()]
    if too_long := [value for _, value in texts if len(value) >= _ENTRY - _NAME]:
        raise FileFormatError(f"the name {too_long[0].decode('latin-1')!r} is too long for RPC III", path=path)
    filled = np.pad(series.values / scales[:, None], ((0, 0), (0, frames * _POINTS - len(series))), mode="edge")
    groups = filled.reshape(largest.size, frames, _POINTS).swapaxes(0, 1)
    samples = np.rint(groups).astype("<i2") if as_integers else groups.astype("<f4")
    header = b"".join(name.ljust(_NAME, b"\0") + value.ljust(_ENTRY - _NAME, b"\0") for name, value in texts)
    with atomic_path(path) as temporary:
        temporary.write_bytes(header.ljust(blocks * _PER_BLOCK * _ENTRY, b"\0") + samples.tobytes())
