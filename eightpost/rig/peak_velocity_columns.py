"""Columns of peak-velocity tables: speeds, forces of both strokes, settings of the adjusters."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.errors import DataError, MissingChannelError, UnknownUnitError
from eightpost.rig.continuous_velocity import MOST_PEAKS, is_loop, loop_means
from eightpost.rig.dyno_columns import dyno_map, has_channels
from eightpost.signals.column_headers import is_number, letters_of
from eightpost.signals.faults import check_finite
from eightpost.units import compatible, convert, is_unit

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord

_LOG = logging.getLogger(__name__)

# ---- Names of columns -----------------------------------------------------------------------------------------------

_SPEED = {
    "speed", "velocity", "vel", "v", "peakvelocity", "peakspeed", "shaftspeed", "pistonspeed", "geschwindigkeit",
    "vitesse", "velocit", "velocita", "velocidad", "velocidade",
}  # fmt: skip
_FORCE = {"force", "f", "load", "peakforce"}
_SIDE = {"side", "stroke", "direction", "phase"}
_SETTING = {"setting", "settings", "clicks", "click", "adjuster"}
_WORDS = {
    "compression": ("compression", "comp", "bump", "jounce", "push", "c", "druckstufe", "druck", "compressione",
                    "compresión", "compressão"),
    "rebound": ("rebound", "reb", "extension", "droop", "ext", "pull", "r", "zugstufe", "zug", "détente", "detente",
                "estensione", "extensión", "extensão", "rebote"),
}  # fmt: skip
#: Both strokes.
STROKES = tuple(_WORDS)
#: Name of a column of one stroke: a word for the stroke, optionally followed by the clicks.
_COLUMN = {
    stroke: re.compile(
        rf"^(?:peak[\s_]*)?(?:{'|'.join(words)})(?![^\W\d_])\.?(?:[\s_]*(?:peak[\s_]*)?force)?[\s_:,-]*(.*)$",
        re.IGNORECASE,
    )
    for stroke, words in _WORDS.items()
}
_FORCE_WORD = re.compile(r"^(?:peak\s*)?(?:force|load|f)(?![a-z])[\s_:,-]*", re.IGNORECASE)
#: Words behind a stroke that name a statistic or a comparison and not a setting, and those of a mean.
_STATISTICS = {
    "std", "sd", "stdev", "stddev", "min", "minimum", "max", "maximum", "range", "spread", "dev", "deviation", "error",
    "target", "ref", "reference", "tol", "tolerance", "limit", "upper", "lower", "hyst", "hysteresis", "ratio", "slope",
}  # fmt: skip
_MEANS = {"avg", "mean", "average"}
#: Mark of a repeated name.
_REPEATED = re.compile(r"\(\d+\)$")


class Point(NamedTuple):
    """One force of a table in SI, with a positive speed."""

    setting: str
    stroke: str
    speed: float
    force: float


class StrokeColumn(NamedTuple):
    """A column of forces of one stroke at one setting."""

    place: int
    stroke: str
    clicks: str


def stroke_above(record: RawRecord) -> str | None:
    """Return the stroke that the lines above a table name: a line `Rebound` on its own."""
    for cells in reversed(record.preamble):
        text = " ".join(cells).strip().lower().rstrip(":")
        for stroke, words in _WORDS.items():
            if text in words or text.removesuffix(" stroke") in words:
                return stroke
    return None


def is_peak_velocity(record: RawRecord) -> bool:
    """Return whether a record is a peak-velocity table: it has a speed and strokes, but no time."""
    plain = [letters_of(name) for name in record.names]
    if {"t", "time", "timestamp", "times", "elapsedtime"} & set(plain) or not (
        _SPEED & set(plain) or any(map(_speed_of, record.names))
    ):
        return False
    strokes = {stroke for name in record.names if (stroke := _split(name)[0])}
    return strokes == set(STROKES) or bool((_SIDE | _FORCE) & set(plain)) or record.columns[0].size < MOST_PEAKS


def holds_peak_velocities(records: Sequence[RawRecord]) -> bool:
    """Return whether a file has peak-velocity tables: its first table is one, and none is a record over time."""
    return is_peak_velocity(records[0]) and not any(has_channels(dyno_map(record)) for record in records)


def _split(name: str) -> tuple[str, str]:
    """Return the stroke of a column's name and the text behind it; empty texts without a stroke."""
    for stroke, pattern in _COLUMN.items():
        if match := pattern.match(name):
            return stroke, match[1].strip()
    return "", ""


def _speed_of(name: str) -> str:
    """Return the stroke to which a column of speeds belongs: `Comp Vel`; empty for other columns."""
    stroke, rest = _split(name)
    return stroke if letters_of(rest) in _SPEED else ""


# ---- Points of a table ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Columns:
    """Columns of a table and their contents.

    Attributes:
        record: Columns of the file.
        units: Units of the caller, by column name, or for `speed` and `force`.
        stroke: Stroke of the whole table, if the lines above it name one.
    """

    record: RawRecord
    units: Mapping[str, str]
    stroke: str | None = None

    def points(self) -> Iterator[Point]:
        """Yield the points of the table in any of the layouts.

        Raises:
            DataError: The table has a fault; see read_peak_velocity.
        """
        sides = next((i for i in self._all(_SIDE) if not self._is_numeric(i)), None)
        if sides is not None:
            yield from self._by_side(self._speed(), self.record.columns[sides])
        elif self._strokes:
            yield from self._by_stroke()
        elif self.stroke is not None:
            force = self._values(self._need(_FORCE, "force"), "force", "N")
            for setting, v, f in zip(self._settings(), np.abs(self._speed()), force, strict=True):
                yield Point(setting, self.stroke, float(v), float(f))
        else:
            yield from self._by_sign(self._speed())

    def _speed(self) -> Array:
        return self._values(self._need(_SPEED, "speed"), "speed", "m/s")

    def _by_side(self, speed: Array, sides: NDArray[np.object_]) -> Iterator[Point]:
        force = self._values(self._need(_FORCE, "force"), "force", "N")
        settings = self._settings()
        for row, (v, f) in enumerate(zip(np.abs(speed), force, strict=True)):
            yield Point(settings[row], self._side(str(sides[row]), row), float(v), float(f))

    def _by_stroke(self) -> Iterator[Point]:
        settings = self._settings()
        for column in self._strokes:
            force = self._values(column.place, self.record.names[column.place], "N")
            speed = np.abs(self._values(self._speed_place(column), "speed", "m/s"))
            for row, (v, f) in enumerate(zip(speed, force, strict=True)):
                yield Point(" ".join(filter(None, (settings[row], column.clicks))), column.stroke, float(v), float(f))

    def _by_sign(self, speed: Array) -> Iterator[Point]:
        if speed.min() >= 0.0:
            what = (
                "the strokes are not given: there are no columns for compression and rebound, there is no column "
                "`side`, and no speed is negative"
            )
            raise self.record.origin.header_fault(MissingChannelError, what, channel="rebound")
        settings = self._settings()
        columns = [i for i in range(len(self.record.names)) if self._is_force(i)]
        if not columns:
            self._need(_FORCE, "force")
        for i in columns:
            force = self._values(i, self.record.names[i], "N")
            name = _FORCE_WORD.sub("", self.record.names[i]) if len(columns) > 1 else ""
            points = loop_means(speed, force) if is_loop(speed) else (speed, force)
            for row, (v, f) in enumerate(zip(*points, strict=True)):
                stroke = "compression" if v > 0.0 else "rebound"
                yield Point(" ".join(filter(None, (settings[row], name))), stroke, abs(float(v)), float(f))

    # ---- Columns of one stroke --------------------------------------------------------------------------------------

    @cached_property
    def _strokes(self) -> tuple[StrokeColumn, ...]:
        """Columns of forces of one stroke; what else a name with a stroke may mean is left out with a note.

        These are slopes and temperatures, statistics beside the mean, and columns without a unit if others have one.
        """
        above = self._above()
        named = [StrokeColumn(i, *_split(name)) for i, name in enumerate(self.record.names)]
        if above:
            named = [one._replace(clicks=above[one.place]) if _is_plain(one) else one for one in named]
        named = [one for one in named if one.stroke and letters_of(one.clicks) not in _SPEED]
        plain = [one for one in named if self._has_unit_of_force(one.place) and not _words(one) & _STATISTICS]
        means = [one for one in plain if _words(one) & _MEANS]
        if len(means) < len(plain):
            kept = [one for one in plain if one not in means]
        else:
            kept = [one._replace(clicks=_without_mean(one.clicks)) for one in means]
        if {one.stroke for one in kept} != {one.stroke for one in named}:
            return tuple(named)
        left_out = [self.record.names[one.place] for one in named if one.place not in {two.place for two in kept}]
        if left_out:
            names = ", ".join(map(repr, left_out))
            _LOG.warning("%s: not read, because they are not the force of a stroke: %s", self.record.origin.path, names)
        return tuple(kept)

    def _above(self) -> list[str]:
        """Return the setting above each column, from a row above repeated names; an empty cell repeats the last one."""
        row = self.record.preamble[-1] if self.record.preamble else ()
        is_repeated = any(_split(name)[0] and _REPEATED.search(name) for name in self.record.names)
        if not is_repeated or not 1 < len(row) <= len(self.record.names):
            return []
        cells = [cell.strip() for cell in row] + [""] * (len(self.record.names) - len(row))
        above = [next((c for c in cells[i::-1] if c), "") for i in range(len(cells))]
        named = (StrokeColumn(i, *_split(name)) for i, name in enumerate(self.record.names))
        forces = [(one.stroke, above[one.place]) for one in named if one.stroke and _is_plain(one)]
        return above if len(set(forces)) == len(forces) else []  # a line of other words is no row of settings

    def _speed_place(self, column: StrokeColumn) -> int:
        """Return the speed of a column of forces: of its stroke, or the nearest one before it, or the first one."""
        own = [i for i, name in enumerate(self.record.names) if _speed_of(name) == column.stroke]
        shared = self._all(_SPEED)
        before = [i for i in own or shared if i < column.place]
        return before[-1] if before else own[0] if own else self._need(_SPEED, "speed")

    def _has_unit_of_force(self, i: int) -> bool:
        unit = self.record.units[i] or self.units.get(self.record.names[i]) or self.units.get("force")
        return unit is not None and is_unit(unit) and compatible(unit, "N")

    # ---- Cells and other columns ------------------------------------------------------------------------------------

    def _is_force(self, i: int) -> bool:
        taken = self._is_setting(i) or letters_of(self.record.names[i]) in _SPEED | _SIDE
        return self._has_unit_of_force(i) and not taken

    def _is_numeric(self, i: int) -> bool:
        column = self.record.columns[i]
        return column.dtype != object or all(is_number(str(cell)) for cell in column)

    def _is_setting(self, i: int) -> bool:
        """Return whether a column contains the setting of each line; a column `0 clicks` contains forces instead."""
        name = self.record.names[i]
        return letters_of(name) in _SETTING and not re.search(r"\d", name)

    def _settings(self) -> list[str]:
        """Return the setting of each line, from the column of settings; empty without this column."""
        i = next((i for i in range(len(self.record.names)) if self._is_setting(i)), None)
        count = self.record.columns[0].size
        if i is None:
            return [""] * count
        cells = self.record.columns[i]
        name = self.record.names[i].lower()
        return [f"{name} {float(cell):g}" if is_number(str(cell)) else str(cell) for cell in cells]

    def _side(self, cell: str, row: int) -> str:
        for stroke, words in _WORDS.items():
            if cell.strip().lower() in words:
                return stroke
        what = f"{cell!r} is neither compression nor rebound; write comp or reb"
        raise self.record.origin.fault(DataError, what, channel="side", sample=row)

    def _all(self, names: set[str]) -> list[int]:
        return [i for i, name in enumerate(self.record.names) if letters_of(name) in names]

    def _need(self, names: set[str], channel: str) -> int:
        found = self._all(names)
        if not found:
            what = f"there is no column for this channel; the file has: {', '.join(self.record.names)}"
            raise self.record.origin.header_fault(MissingChannelError, what, channel=channel)
        return found[0]

    def _values(self, i: int, channel: str, si: str) -> Array:
        """Return a column (K,) in SI."""
        given = dict(self.units)
        if si == "N" and "force" in given:
            given.setdefault(channel, given["force"])
        unit = self.record.unit(i, channel=channel, given=given, mapped=None)
        try:
            fits = compatible(unit, si)
        except UnknownUnitError as error:
            raise self.record.origin.header_fault(UnknownUnitError, str(error), channel=channel) from error
        if not fits:
            what = f"the unit {unit!r} cannot be converted to {si!r}; check that it is the right column"
            raise self.record.origin.header_fault(UnknownUnitError, what, channel=channel)
        raw = self.record.numbers(i, channel=channel)
        check_finite(raw, channel=channel, origin=self.record.origin)
        return convert(raw, unit, si)


def _is_plain(column: StrokeColumn) -> bool:
    """Return whether a column's name has the stroke alone, at most with the mark of a repeated name."""
    return not column.clicks or bool(_REPEATED.fullmatch(column.clicks))


def _words(column: StrokeColumn) -> set[str]:
    return set(re.findall(r"[a-z]+", column.clicks.lower()))


def _without_mean(clicks: str) -> str:
    """Return the setting behind a stroke without the word for a mean."""
    return " ".join(word for word in clicks.split() if word.lower() not in _MEANS)
