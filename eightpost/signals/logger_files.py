"""Files of loggers: MoTeC's .ld and Racelogic's .vbo, one table for each rate, names and units as written."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.confined.readers import Signal
from eightpost.errors import FileFormatError
from eightpost.files import reading
from eightpost.signals.faults import Origin
from eightpost.signals.raw_record import RawRecord, by_time, temperatures_at
from eightpost.signals.table_text import decoded

if TYPE_CHECKING:
    from numpy.typing import NDArray

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


def read_ld(path: str | Path) -> tuple[RawRecord, ...]:
    """Read the channels of a MoTeC log: one table for each rate and length, the one with most channels first.

    Temperatures change slowly, so the first table has those of the other tables too, interpolated.

    Raises:
        FileFormatError: The file is not a MoTeC log, is damaged, or has no channel of numbers.
    """
    path = Path(path)
    with reading(path):
        content = path.read_bytes()
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
        raw = np.frombuffer(content, kind, channel.number, channel.place).astype(np.float64)
        samples = (raw / channel.scale * 10.0**-channel.decimals + channel.shift) * channel.factor
        times = np.arange(channel.number) / channel.rate
        signals.append(Signal(name, _plain(channel.unit), samples, times))
    texts = ((name, _plain(content[place : place + size])) for name, (place, size) in _TEXTS.items())
    return _tables(signals, path, tuple((f"{name}: {text}",) for name, text in texts if text), tuple(notes))


def _channels(content: bytes, path: Path) -> Iterator[_Channel]:
    """Yield the headers of the channels, of which each names the place of the next one."""
    seen, place = set(), _word(content, _FIRST)
    while place:
        if place in seen or place + _CHANNEL.size > len(content):
            raise FileFormatError(f"its header of a channel at byte {place} is damaged: copy the file again", path=path)
        seen.add(place)
        channel = _Channel(*_CHANNEL.unpack_from(content, place))
        yield channel
        place = channel.following


def _word(content: bytes, place: int) -> int:
    return int.from_bytes(content[place : place + 4], "little")


def _plain(text: bytes) -> str:
    return text.split(b"\0")[0].decode("latin-1").strip()


def _tables(
    signals: list[Signal], path: Path, facts: tuple[tuple[str, ...], ...], notes: tuple[str, ...]
) -> tuple[RawRecord, ...]:
    if not any(signal.samples.size for signal in signals):
        raise FileFormatError("it contains no channel of numbers", path=path)
    first, *others = by_time([signal for signal in signals if signal.samples.size])
    tables = [[*first, *temperatures_at(first[0].times, others)], *others]
    return tuple(
        RawRecord(Origin(path), ("time", *(one.name for one in table)), ("s", *(one.unit or None for one in table)),
                  (table[0].times, *(one.samples for one in table)), facts, notes)
        for table in tables
    )  # fmt: skip


# ---- Racelogic .vbo: sections of text -------------------------------------------------------------------------------

#: Units of the columns that every file has; those of the other columns are in a section, in the same order.
_UNITS = {"velocity": "km/h", "heading": "deg", "height": "m"}


def read_vbo(path: str | Path) -> tuple[RawRecord, ...]:
    """Read the columns of a Racelogic file; its time of day (hhmmss.ss) is the column `time` [s].

    Raises:
        FileFormatError: A section is missing, a line has another number of cells, or a cell is not a number.
    """
    path = Path(path)
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
