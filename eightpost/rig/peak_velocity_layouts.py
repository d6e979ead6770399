"""Layouts of peak-velocity tables: columns named by the caller, a column per speed, damping rates and a knee."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import MissingChannelError
from eightpost.rig.dyno_columns import is_command, is_named
from eightpost.signals.column_headers import is_number, letters_of
from eightpost.units import compatible, convert, is_unit

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    from eightpost.signals.channel_map import ChannelMap, MappedChannel
    from eightpost.signals.raw_record import RawRecord

_SIDE = {"side", "stroke", "direction", "phase"}
#: Words for the strokes, in lower case.
STROKE_WORDS = {
    "compression": ("compression", "comp", "bump", "jounce", "push", "c", "druckstufe", "druck", "compressione",
                    "compresión", "compressão"),
    "rebound": ("rebound", "reb", "extension", "droop", "ext", "pull", "r", "zugstufe", "zug", "détente", "detente",
                "estensione", "extensión", "extensão", "rebote"),
}  # fmt: skip
_SPEED = re.compile(r"\s*([-+]?\d+(?:[.,]\d+)?)\s*([^\d\s].*)")


def is_kind(name: str, kind: str) -> bool:
    """Return whether a column's name is a usual one of `speed`, `force` or `side`."""
    if kind == "side":
        return letters_of(name) in _SIDE
    bare, channel = re.sub(r"peak[\s_]*", "", name, flags=re.IGNORECASE), "velocity" if kind == "speed" else kind
    return is_named(bare, channel) and not is_command(bare, channel)


def stroke_of(cell: str) -> str:
    """Return the stroke that a cell names (`Comp`, `Rebound stroke`); empty for other cells."""
    text = cell.strip().lower().rstrip(":").removesuffix(" stroke")
    return next((stroke for stroke, words in STROKE_WORDS.items() if text in words), "")


def in_columns(record: RawRecord, channel_map: ChannelMap | None = None) -> RawRecord:
    """Return a table with a column for each quantity.

    The caller may name the columns of `velocity`, `force`, `compression`, `rebound` and `setting`. A column whose name
    is a speed (`50 mm/s`) has the forces at this speed. A table of damping rates below and above a knee
    (`side, low [N.s/m], knee [m/s], high [N.s/m]`) becomes forces at speeds around the knees.

    Raises:
        DataError: A column that the caller names does not exist, or a rate is not a number.
    """
    if channel_map is not None and channel_map.channels:
        record = _with_names(record, channel_map.channels)
    return _of_rates(_of_speeds(record))


def _with_names(record: RawRecord, picks: Mapping[str, MappedChannel]) -> RawRecord:
    """Return a record whose columns have the names of the channels for which the caller chose them."""
    found = {record.index(pick.source, channel=name): (name, pick) for name, pick in picks.items()}
    kinds = {"speed" if name in ("speed", "velocity") else name for name in picks}
    kept = [
        i
        for i, name in enumerate(record.names)
        if i in found or not any(is_kind(name, kind) for kind in kinds & {"speed", "force"})
    ]
    names, units, columns = list(record.names), list(record.units), list(record.columns)
    for i, (name, pick) in found.items():
        names[i], units[i] = name, pick.unit or units[i]
        if (pick.gain, pick.offset) != (1.0, 0.0):
            columns[i] = pick.gain * record.numbers(i, channel=name) + pick.offset
    return _with_columns(record, [(names[i], units[i], columns[i]) for i in kept])


def _with_columns(record: RawRecord, columns: Sequence[tuple[str, str | None, NDArray[np.generic]]]) -> RawRecord:
    names, units, values = zip(*columns, strict=True)
    return replace(record, names=names, units=units, columns=values)


def _of_speeds(record: RawRecord) -> RawRecord:
    """Return a record with a line per speed and force instead of a column per speed."""
    speeds = {i: speed for i, name in enumerate(record.names) if (speed := _speed(name)) is not None}
    if len(speeds) < 2:
        return record
    others = [i for i in range(len(record.names)) if i not in speeds]
    places = np.repeat(np.arange(record.columns[0].size), len(speeds))
    sides = [
        i for i in others if record.columns[i].dtype == object and all(map(stroke_of, map(str, record.columns[i])))
    ]
    columns = [("side" if i in sides else record.names[i], record.units[i], record.columns[i][places]) for i in others]
    forces = np.array([record.numbers(i, channel=record.names[i]) for i in speeds])
    columns += [
        ("speed", "m/s", np.tile(np.array(list(speeds.values())), record.columns[0].size)),
        ("force", None, forces.T.ravel()),
    ]
    lines = record.origin.lines
    origin = replace(record.origin, lines=None if lines is None else lines[places])
    return _with_columns(replace(record, origin=origin), columns)


def _speed(name: str) -> float | None:
    """Return the speed [m/s] that is the name of a column; None for other names."""
    match = _SPEED.fullmatch(name)
    if match is None or not (is_unit(match[2]) and compatible(match[2], "m/s")):
        return None
    return float(convert(float(match[1].replace(",", ".")), match[2], "m/s"))


#: Speeds at which the curve of rates is sampled, in knees: it is rounded between those nearest to the knee.
_AT = (0.5, 0.97, 1.0, 1.03, 2.0)
#: Highest speed of the curve, in knees and at least [m/s].
_TOP, _LEAST_TOP = 4.0, 0.5


def _of_rates(record: RawRecord) -> RawRecord:
    """Return the forces of a table of two damping rates and a knee for each stroke."""
    knee = next((i for i, name in enumerate(record.names) if letters_of(name).startswith("knee")), None)
    if knee is None:
        return record
    low, high, side = (
        _place(record, test, what)
        for test, what in (
            (lambda name: letters_of(name).startswith(("low", "ls")), "low [N.s/m]"),
            (lambda name: letters_of(name).startswith(("high", "hs")), "high [N.s/m]"),
            (lambda name: is_kind(name, "side"), "side"),
        )
    )
    knees, below, above = (record.si(i, unit) for i, unit in ((knee, "m/s"), (low, "N.s/m"), (high, "N.s/m")))
    top = max(_TOP * float(knees.max()), _LEAST_TOP)
    speed = np.unique([*(at * one for at in _AT for one in knees), top])
    force = below[:, None] * np.minimum(speed, knees[:, None]) + above[:, None] * np.maximum(
        speed - knees[:, None], 0.0
    )
    sides = np.repeat(record.columns[side], speed.size)
    note = f"force from two damping rates per stroke, to {top:.3g} m/s, rounded within 3 % of the knee"
    lines = record.origin.lines
    origin = replace(record.origin, lines=None if lines is None else np.repeat(lines, speed.size))
    columns = [("side", None, sides), ("speed", "m/s", np.tile(speed, knees.size)), ("force", "N", force.ravel())]
    return _with_columns(replace(record, origin=origin, steps=(*record.steps, note)), columns)


def _place(record: RawRecord, test: Callable[[str], bool], what: str) -> int:
    for i, name in enumerate(record.names):
        if test(name):
            return i
    advice = "a table of damping rates has the columns `side, low [N.s/m], knee [m/s], high [N.s/m]`"
    raise record.origin.header_fault(MissingChannelError, f"there is no column {what!r}; {advice}", channel="force")


def is_setting(name: str) -> bool:
    """Return whether a column contains the setting of each line; a column `0 clicks` contains forces instead."""
    words = {"setting", "settings", "clicks", "click", "adjuster", "current"}
    return letters_of(name) in words and not re.search(r"\d", name)


def is_numeric(column: NDArray[np.generic]) -> bool:
    """Return whether all cells of a column are numbers."""
    return column.dtype != object or all(is_number(str(cell)) for cell in column)
