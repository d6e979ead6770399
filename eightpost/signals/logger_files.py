"""Files of loggers and rigs: MoTeC's .ld, AiM's .xrk, Racelogic's .vbo, and MTS's RPC III (.rsp, .drv, .tim)."""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Iterator, Mapping
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eightpost.array_types import Stored
from eightpost.confined import read_confined
from eightpost.confined.readers import Signal
from eightpost.errors import FileFormatError
from eightpost.extras import is_installed, requirement
from eightpost.files import atomic_path, reading
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import RawRecord, tables_of
from eightpost.signals.table_text import decoded

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.signals.timeseries import TimeSeries

# ---- MoTeC .ld: a linked list of headers of channels ----------------------------------------------------------------

#: Number with which a file begins, and places of the first header of a channel and of texts of 64 and 16 bytes.
_MARK, _FIRST = 0x40, 8
_TEXTS = {"Date": (94, 16), "Time": (126, 16), "Driver": (158, 64), "Vehicle": (222, 64), "Venue": (350, 64)}
#: Header of a channel: the next header, the samples and their number, type and bytes, rate [Hz], shift, multiplier,
#: scale and decimals, name and unit.
_CHANNEL = struct.Struct("<4xIII2xHHHhhhh32s8x12s")
_FLOATS, _INTEGERS = {2: "<f2", 4: "<f4"}, {2: "<i2", 4: "<i4"}
_KINDS = {7: _FLOATS, 0: _INTEGERS, 3: _INTEGERS, 5: _INTEGERS}


class _Channel(NamedTuple):
    following: int
    place: int
    number: int
    kind: int
    size: int
    rate: int
    shift: int
    factor: int
    scale: int
    decimals: int
    name: bytes
    unit: bytes


def read_ld(path: Path) -> tuple[RawRecord, ...]:
    """Read the channels of a MoTeC log: one table for each rate and length, the one with most channels first.

    Temperatures change slowly, so the first table has those of the other tables too, interpolated.

    Raises:
        FileFormatError: The file is not a MoTeC log, is damaged, or has no channel of numbers.
    """
    content = mapped(path)
    times = lru_cache(lambda number, rate: np.arange(number) / rate)
    if len(content) < max(place + size for place, size in _TEXTS.values()) or _word(content, 0) != _MARK:
        raise FileFormatError("is not a log of MoTeC: its first number is another one", path=path)
    signals, notes = [], []
    for channel in _channels(content, path):
        name, kind = _plain(channel.name), _KINDS.get(channel.kind, {}).get(channel.size)
        if kind is None or not channel.scale or not channel.rate:
            notes.append(f"the channel {name!r} was left out: its type ({channel.kind}, {channel.size}) is unknown")
            continue
        if channel.place + channel.number * channel.size > len(content):
            raise FileFormatError("its samples end early: copy the file again", path=path, channel=name)
        samples = Stored(
            channel.number, partial(_scaled, np.frombuffer(content, kind, channel.number, channel.place), channel)
        )
        signals.append(Signal(name, _plain(channel.unit), samples, times(channel.number, channel.rate)))
    texts = ((name, _plain(content[place : place + size])) for name, (place, size) in _TEXTS.items())
    return _tables(signals, path, tuple((f"{name}: {text}",) for name, text in texts if text), tuple(notes))


def mapped(path: Path) -> mmap.mmap:
    """Return the bytes of a file, of which only those that are used are read."""
    with reading(path), path.open("rb") as stream:
        return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)


def _scaled(raw: NDArray[Any], channel: _Channel) -> NDArray[np.float64]:
    """Return the samples (N,) of a channel in its unit."""
    samples = raw.astype(np.float64)
    return (samples / channel.scale * 10.0**-channel.decimals + channel.shift) * channel.factor


def _channels(content: mmap.mmap, path: Path) -> Iterator[_Channel]:
    """Yield the headers of the channels, of which each names the place of the next one."""
    seen, place = set(), _word(content, _FIRST)
    while place:
        if place in seen or place + _CHANNEL.size > len(content):
            raise FileFormatError(f"its header of a channel at byte {place} is damaged: copy the file again", path=path)
        seen.add(place)
        channel = _Channel(*_CHANNEL.unpack_from(content, place))
        yield channel
        place = channel.following


def _word(content: mmap.mmap, place: int) -> int:
    return int.from_bytes(content[place : place + 4], "little")


def _plain(text: bytes) -> str:
    return text.split(b"\0")[0].decode("latin-1").strip()


def _tables(
    signals: list[Signal], path: Path, facts: tuple[tuple[str, ...], ...], notes: tuple[str, ...]
) -> tuple[RawRecord, ...]:
    signals = [signal for signal in signals if signal.samples.size]
    if not signals:
        raise FileFormatError("it contains no channel of numbers", path=path)
    return tables_of(signals, path, facts, notes)


def read_xrk(path: Path) -> tuple[RawRecord, ...]:
    """Read the channels of a log of AiM with libxrk: one table for each set of times, as of a log of MoTeC.

    Raises:
        FileFormatError: libxrk is not installed or cannot read the file, or there is no channel.
    """
    if not is_installed("libxrk"):
        raise FileFormatError(requirement("reading logs of AiM", "libxrk", "aim"), path=path)
    signals, facts = read_confined("eightpost.confined.readers:load_xrk", path, kind="a log of AiM that libxrk reads")
    return _tables(signals, path, tuple((fact,) for fact in facts), ())


# ---- Racelogic .vbo: sections of text -------------------------------------------------------------------------------

#: Units of the columns that every file has; those of the other columns are in a section, in the same order.
_UNITS = {"velocity": "km/h", "heading": "deg", "height": "m"}


def read_vbo(path: Path) -> tuple[RawRecord, ...]:
    """Read the columns of a Racelogic file; its time of day (hhmmss.ss) is the column `time` [s].

    Raises:
        FileFormatError: A section is missing, a line has another number of cells, or a cell is not a number.
    """
    with reading(path):
        text = decoded(path.read_bytes())
    parts = re.split(r"(?m)^\[(.+?)\]\s*$", text)
    sections = {name.strip().lower(): [line.strip() for line in body.splitlines() if line.strip()]
                for name, body in zip(parts[1::2], parts[2::2], strict=True)}  # fmt: skip
    if missing := [name for name in ("column names", "data") if not sections.get(name)]:
        raise FileFormatError(f"is not a file of Racelogic: it has no section [{missing[0]}]", path=path)
    names = " ".join(sections["column names"]).split()
    start = text[: re.search(r"(?mi)^\[data\]", text).start()].count("\n") + 2  # type: ignore[union-attr]
    rows = [line.split() for line in sections["data"]]
    for number, row in enumerate(rows):
        if len(row) != len(names):
            what = f"has {len(row)} cells, but [column names] has {len(names)}"
            raise FileFormatError(what, path=path, line=start + number)
    try:
        values = np.array(rows, dtype=np.float64).T
    except ValueError as error:
        raise FileFormatError(f"a cell of [data] is not a number: {error}", path=path) from error
    own = sections.get("channel units", [])
    own = own if len(own) <= len(names) else []
    units = [_UNITS.get(name) for name in names[: len(names) - len(own)]] + [unit.strip("()") or None for unit in own]
    columns = dict(zip(names, values, strict=True))
    if "time" in columns:
        columns["time"] = _seconds(columns["time"])
        units[names.index("time")] = "s"
    facts = tuple((line,) for line in [*parts[0].splitlines(), *sections.get("comments", [])] if line.strip())
    return (RawRecord(Origin(path), tuple(names), tuple(units), tuple(columns[name] for name in names), facts),)


def _seconds(clock: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return seconds since the first sample (N,) of times of day as numbers hhmmss.ss, past midnight too."""
    hours, rest = np.divmod(clock, 1e4)
    minutes, seconds = np.divmod(rest, 100.0)
    time = 3600.0 * hours + 60.0 * minutes + seconds
    time = time + 86400.0 * np.concatenate([[0], np.cumsum(np.diff(time) < -43200.0)])
    return np.asarray(np.round(time - time[0], 6))


# ==== RPC III: a header of texts, then groups of samples by channel ==================================================

#: Bytes of the name of an entry of the header and of the whole entry, and entries of a block.
_NAME, _ENTRY, _PER_BLOCK = 32, 128, 4
_ORDERS = {"BINARY_IEEE_LITTLE_END": "<", "BINARY": "<", "BINARY_IEEE_BIG_END": ">"}
_RPC_KINDS = {"SHORT_INTEGER": "i2", "FLOATING_POINT": "f4"}
_FACTS = ("DATE", "OPERATION", "TIME_TYPE", "PARENT_1")  #: Entries that become the preamble.
_FILLED = 3  #: Fewest repeated samples of all channels at the end of the last frame that count as its filling.
_POINTS, _FULL_SCALE = 2048, 32752  #: Points of a frame and largest integer of a file that is written.


def read_rpc(path: Path) -> tuple[RawRecord, ...]:
    """Read the channels of a time history with names and units as written, and the column `time` [s].

    Without the entry `SAMPLES`, what fills the last frame (the last sample of each channel) is left out with a note.

    Raises:
        FileFormatError: The file is not a time history in RPC III, or is damaged.
    """
    content = mapped(path)
    header, start = _header(content, path)
    stated = {"FILE_TYPE": "TIME_HISTORY", "DATA_TYPE": "SHORT_INTEGER", **header}
    kind = _RPC_KINDS.get(stated["DATA_TYPE"])
    if kind is None or stated["FILE_TYPE"] != "TIME_HISTORY":
        readable = " or ".join(_RPC_KINDS)
        what = f"contains {stated['FILE_TYPE']} of {stated['DATA_TYPE']}; TIME_HISTORY of {readable} is read"
        raise FileFormatError(what, path=path)
    frame, count = _integer(header, "PTS_PER_FRAME", path), _integer(header, "CHANNELS", path)
    points = frame * _integer(header, "FRAMES", path)
    group = _integer({"PTS_PER_GROUP": str(frame), **header}, "PTS_PER_GROUP", path)
    data = memoryview(content)[start:]
    groups, rest = _samples(data, np.dtype(_ORDERS[header["FORMAT"]] + kind), count, group, points, path)
    notes = _half_frames(header, len(data) - np.dtype(kind).itemsize * count * points, path)
    last = np.concatenate([*groups[-frame // group :], rest], axis=1)[:, -frame:]
    size = points
    if "SAMPLES" in header:
        size = min(points, _integer(header, "SAMPLES", path))
    elif (filled := _repeats_at_end(last)) >= _FILLED:
        size -= filled
        notes += (f"the last {filled} samples were left out: they fill the last frame with one value of each channel",)
    numbers = range(1, count + 1)
    names = [header.get(f"DESC.CHAN_{i}") or f"CHAN_{i}" for i in numbers]
    units = [header.get(f"UNITS.CHAN_{i}") or None for i in numbers]
    scales = [_positive(header, f"SCALE.CHAN_{i}", path) if kind == "i2" else 1.0 for i in numbers]
    time = _positive(header, "DELTA_T", path) * np.arange(size)

    def samples(k: int) -> NDArray[np.float64]:
        return scales[k] * np.concatenate([groups[:, k].ravel(), rest[k]], dtype=np.float64)[:size]

    columns = (Stored(size, partial(samples, k)) for k in range(count))
    facts = tuple((f"{name}: {header[name]}",) for name in _FACTS if header.get(name))
    return (RawRecord(Origin(path), ("time", *names), ("s", *units), (time, *columns), facts, notes),)


def _header(content: mmap.mmap, path: Path) -> tuple[dict[str, str], int]:
    """Return the entries of the header by name, and the number of its bytes."""
    first = _entries(content, 3)
    if [*first][:2] != ["FORMAT", "NUM_HEADER_BLOCKS"] or first["FORMAT"] not in _ORDERS:
        raise FileFormatError(f"is not a binary file in RPC III: it begins with {content[:40]!r}", path=path)
    size = _PER_BLOCK * _integer(first, "NUM_HEADER_BLOCKS", path)
    if size * _ENTRY > len(content):
        raise FileFormatError(f"ends within its header of {size * _ENTRY} bytes: copy it again", path=path)
    return _entries(content, size), size * _ENTRY


def _entries(content: mmap.mmap, count: int) -> dict[str, str]:
    pairs = (content[k * _ENTRY : (k + 1) * _ENTRY] for k in range(count))
    texts = ((pair[:_NAME], pair[_NAME:]) for pair in pairs)
    found = [tuple(text.split(b"\0")[0].decode("latin-1").strip() for text in pair) for pair in texts]
    return {name: value for name, value in found if name}


def _samples(
    data: memoryview, kind: np.dtype[Any], count: int, group: int, points: int, path: Path
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the samples of groups (G, C, P) that follow each other, and of the last one (C, R), which is shorter."""
    whole, rest = divmod(points, group)
    size = whole * count * group
    last = group if rest and len(data) >= kind.itemsize * (size + count * group) else rest
    if len(data) < kind.itemsize * (size + count * last):
        need = kind.itemsize * count * points
        raise FileFormatError(f"ends early: {len(data)} of {need} bytes of samples are there; copy it again", path=path)
    samples = np.frombuffer(data, kind, size + count * last)
    return samples[:size].reshape(whole, count, group), samples[size:].reshape(count, last)[:, :rest]


def _half_frames(header: Mapping[str, str], more: int, path: Path) -> tuple[str, ...]:
    """Return a note about half frames at both ends; refuse a file with bytes that its number of frames excludes."""
    if header.get("HALF_FRAMES", "0").strip() in ("", "0"):
        return ()
    if more:
        what = f"has half frames and {more} bytes besides its FRAMES; export it without half frames"
        raise FileFormatError(what, path=path)
    return ("it has half frames: its first and last half frame may be a fade, cut them with a time window",)


def _repeats_at_end(frame: NDArray[Any]) -> int:
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
