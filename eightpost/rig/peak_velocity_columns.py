"""Columns of peak-velocity tables in all layouts: speeds, forces of both strokes, settings of the adjusters."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.errors import DataError, MissingChannelError, UnknownUnitError
from eightpost.rig.columns import dyno_map, has_channels, is_command, is_named
from eightpost.signals.faults import check_finite
from eightpost.signals.table_text import is_number, letters_of
from eightpost.units import compatible, convert, is_unit

if TYPE_CHECKING:
    from collections.abc import Callable

    from eightpost.signals.raw_record import ChannelMap, MappedChannel, RawRecord


# ==== Columns named by the caller, a column per speed, damping rates and a knee ======================================

_SIDE = {"side", "stroke", "direction", "phase"}
#: Words for the strokes, in lower case.
STROKE_WORDS = {
    "compression": ("compression", "comp", "bump", "jounce", "push", "c", "druckstufe", "druck", "compressione",
                    "compresión", "compressão"),
    "rebound": ("rebound", "reb", "extension", "droop", "ext", "pull", "r", "zugstufe", "zug", "détente", "detente",
                "estensione", "extensión", "extensão", "rebote"),
}  # fmt: skip
_SPEED = re.compile(r"\s*([-+]?\d+(?:[.,]\d+)?)\s*([^\d\s].*)")


def _is_kind(name: str, kind: str) -> bool:
    """Return whether a column's name is a usual one of `speed`, `force` or `side`."""
    if kind == "side":
        return letters_of(name) in _SIDE
    bare, channel = re.sub(r"peak[\s_]*", "", name, flags=re.IGNORECASE), "velocity" if kind == "speed" else kind
    return is_named(bare, channel) and not is_command(bare, channel)


def _stroke_of(cell: str) -> str:
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
        if i in found or not any(_is_kind(name, kind) for kind in kinds & {"speed", "force"})
    ]
    names, units, columns = list(record.names), list(record.units), [*map(record.column, range(len(record.names)))]
    for i, (name, pick) in found.items():
        names[i], units[i] = name, pick.unit or units[i]
        if (pick.gain, pick.offset) != (1.0, 0.0):
            columns[i] = pick.gain * record.numbers(i, channel=name) + pick.offset
    return _with_columns(record, [(names[i], units[i], columns[i]) for i in kept])


def _with_columns(record: RawRecord, columns: Sequence[tuple[str, str | None, NDArray[Any]]]) -> RawRecord:
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
        i for i in others if record.columns[i].dtype == object and all(map(_stroke_of, map(str, record.column(i))))
    ]
    columns = [("side" if i in sides else record.names[i], record.units[i], record.column(i)[places]) for i in others]
    forces = np.array([record.numbers(i, channel=record.names[i]) for i in speeds])
    columns += [
        ("speed", "m/s", np.tile(np.array(list(speeds.values())), record.columns[0].size)),
        ("force", None, forces.T.ravel()),
    ]
    return _with_columns(replace(record, origin=record.origin.at(places)), columns)


def _speed(name: str) -> float | None:
    """Return the speed [m/s] that is the name of a column; None for other names."""
    match = _SPEED.fullmatch(name)
    if match is None or not (is_unit(match[2]) and compatible(match[2], "m/s")):
        return None
    return float(convert(float(match[1].replace(",", ".")), match[2], "m/s"))


#: Speeds at which the curve of rates is sampled, in knees: it is rounded between those nearest to the knee.
_AT = (0.5, 0.97, 1.0, 1.03, 2.0)
_TOP, _LEAST_TOP = 4.0, 0.5  #: Highest speed of the curve, in knees and at least [m/s].


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
            (lambda name: _is_kind(name, "side"), "side"),
        )
    )
    knees, below, above = (record.si(i, unit) for i, unit in ((knee, "m/s"), (low, "N.s/m"), (high, "N.s/m")))
    top = max(_TOP * float(knees.max()), _LEAST_TOP)
    speed = np.unique([*(at * one for at in _AT for one in knees), top])
    force = below[:, None] * np.minimum(speed, knees[:, None]) + above[:, None] * np.maximum(
        speed - knees[:, None], 0.0
    )
    places = np.repeat(np.arange(knees.size), speed.size)
    note = f"force from two damping rates per stroke, to {top:.3g} m/s, rounded within 3 % of the knee"
    columns = [("side", None, record.column(side)[places]), ("speed", "m/s", np.tile(speed, knees.size)),
               ("force", "N", force.ravel())]  # fmt: skip
    return _with_columns(replace(record, origin=record.origin.at(places), steps=(*record.steps, note)), columns)


def _place(record: RawRecord, test: Callable[[str], bool], what: str) -> int:
    for i, name in enumerate(record.names):
        if test(name):
            return i
    advice = "a table of damping rates has the columns `side, low [N.s/m], knee [m/s], high [N.s/m]`"
    raise record.origin.header_fault(MissingChannelError, f"there is no column {what!r}; {advice}", channel="force")


def _is_setting(name: str) -> bool:
    """Return whether a column contains the setting of each line; a column `0 clicks` contains forces instead."""
    words = {"setting", "settings", "clicks", "click", "adjuster", "current"}
    return letters_of(name) in words and not re.search(r"\d", name)


# ==== A column per stroke or setting =================================================================================

STROKES = tuple(STROKE_WORDS)  #: Both strokes.
#: Name of a column of one stroke: a word for the stroke, optionally followed by the clicks.
_COLUMN = {
    stroke: re.compile(
        rf"^(?:peak[\s_]*)?(?:{'|'.join(words)})(?![^\W\d_])\.?(?:[\s_]*(?:peak[\s_]*)?force)?[\s_:,-]*(.*)$",
        re.IGNORECASE,
    )
    for stroke, words in STROKE_WORDS.items()
}
#: SI unit of a damping coefficient.
_COEFFICIENT = "N.s/m"
_FORCE_WORD = re.compile(r"^(?:peak\s*)?(?:force|load|f)(?![a-z])[\s_:,-]*", re.IGNORECASE)
#: Words behind a stroke that name a statistic or a comparison and not a setting, and those of a mean.
_STATISTICS = {
    "std", "sd", "stdev", "stddev", "min", "minimum", "max", "maximum", "range", "spread", "dev", "deviation", "error",
    "target", "ref", "reference", "tol", "tolerance", "limit", "upper", "lower", "hyst", "hysteresis", "ratio", "slope",
}  # fmt: skip
_MEANS = {"avg", "mean", "average"}
_REPEATED = re.compile(r"\(\d+\)$")  #: Mark of a repeated name.


class Point(NamedTuple):
    """One force of a table in SI, with a positive speed."""

    setting: str
    stroke: str
    speed: float
    force: float


class _StrokeColumn(NamedTuple):
    """A column of forces of one stroke at one setting."""

    place: int
    stroke: str
    clicks: str


def stroke_above(record: RawRecord) -> str | None:
    """Return the stroke that the lines above a table name: a line `Rebound` on its own."""
    return next((stroke for cells in reversed(record.preamble) if (stroke := _stroke_of(" ".join(cells)))), None)


def _is_peak_velocity(record: RawRecord, channel_map: ChannelMap | None = None) -> bool:
    """Return whether a record is a peak-velocity table: it has a speed and strokes, but no time."""
    record = in_columns(record, channel_map)
    names = record.names
    is_timed = {"t", "time", "timestamp", "times", "elapsedtime"} & set(map(letters_of, names))
    if is_timed or not any(_is_kind(name, "speed") or _speed_of(name) for name in names):
        return False
    strokes = {stroke for name in names if (stroke := _split(name)[0])}
    has_force = any(_is_kind(name, kind) for name in names for kind in ("force", "side"))
    return strokes == set(STROKES) or has_force or record.columns[0].size < MOST_PEAKS


def holds_peak_velocities(records: Sequence[RawRecord], channel_map: ChannelMap | None = None) -> bool:
    """Return whether a file has peak-velocity tables: its first table is one, and none is a record over time."""
    if any(has_channels(dyno_map(record)) for record in records) or (channel_map and channel_map.time):
        return False
    return _is_peak_velocity(records[0], channel_map)


def _split(name: str) -> tuple[str, str]:
    """Return the stroke of a column's name and the text behind it; empty texts without a stroke."""
    for stroke, pattern in _COLUMN.items():
        if match := pattern.match(name):
            return stroke, match[1].strip()
    return "", ""


def _speed_of(name: str) -> str:
    """Return the stroke to which a column of speeds belongs: `Comp Vel`; empty for other columns."""
    stroke, rest = _split(name)
    return stroke if rest and _is_kind(rest, "speed") else ""


# ---- Points of a table ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Columns:
    """Columns of a table and their contents."""

    record: RawRecord  #: Columns of the file.
    units: Mapping[str, str]  #: Units of the caller, by column name, or for `speed` and `force`.
    stroke: str | None = None  #: Stroke of the whole table, if the lines above it name one.
    reversed_by: str = ""  #: Statement of the file that a positive speed is rebound; empty without one.
    notes: list[str] = field(default_factory=list)  #: Sentences on what was left out or computed, which `points` adds.

    def points(self) -> Iterator[Point]:
        """Yield the points of the table in any of the layouts.

        Raises:
            DataError: The table has a fault; see read_peak_velocity.
        """
        words = [self.record.column(i) for i in self._all("side")]
        sides = next(
            (cells for cells in words if cells.dtype == object and not all(map(is_number, map(str, cells)))), None
        )
        if sides is None and self._strokes:
            yield from self._by_stroke()
        elif sides is None and self.stroke is None:
            yield from self._by_sign()
        else:
            settings = self._settings()
            for row, v, f in self._pairs(self._need("speed"), self._need("force"), "force"):
                stroke = self.stroke or "" if sides is None else self._side(str(sides[row]), row)
                yield Point(settings[row], stroke, abs(v), f)

    def _by_stroke(self) -> Iterator[Point]:
        settings = self._settings()
        for column in self._strokes:
            name = self.record.names[column.place]
            for row, v, f in self._pairs(self._speed_place(column.place, column.stroke), column.place, name):
                yield Point(" ".join(filter(None, (settings[row], column.clicks))), column.stroke, abs(v), f)

    def _by_sign(self) -> Iterator[Point]:
        settings, above = self._settings(), self._above()
        positive, negative = STROKES[::-1] if self.reversed_by else STROKES
        if self.reversed_by:
            self.notes.append(f"positive speeds are rebound, because the file states {self.reversed_by!r}")
        columns = [i for i in range(len(self.record.names)) if self._is_force(i)] or [self._need("force")]
        for i in columns:
            name = _FORCE_WORD.sub("", self.record.names[i]) if len(columns) > 1 else ""
            name = above[i] if above else name
            pairs = list(self._pairs(self._speed_place(i), i, self.record.names[i]))
            rows, speed, force = (np.array(one) for one in zip(*pairs, strict=True))
            if speed.min() >= 0.0:
                what = (
                    "the strokes are not given: there are no columns for compression and rebound, there is no column "
                    "`side`, and no speed is negative"
                )
                raise self.record.origin.header_fault(MissingChannelError, what, channel="rebound")
            points = _loop_means(speed, force) if _is_loop(speed) else (speed, force)
            for row, v, f in zip(rows.tolist(), *points, strict=False):
                stroke = positive if v > 0.0 else negative
                yield Point(" ".join(filter(None, (settings[row], name))), stroke, abs(float(v)), float(f))

    # ---- Columns of one stroke --------------------------------------------------------------------------------------

    @cached_property
    def _strokes(self) -> tuple[_StrokeColumn, ...]:
        """Columns of forces of one stroke; what else a name with a stroke may mean is left out with a note.

        These are slopes and temperatures, statistics beside the mean, and columns without a unit if others have one.
        """
        above = self._above()
        named = [_StrokeColumn(i, *_split(name)) for i, name in enumerate(self.record.names)]
        if above:
            named = [one._replace(clicks=above[one.place]) if _is_plain(one) else one for one in named]
        named = [one for one in named if one.stroke and not (one.clicks and _is_kind(one.clicks, "speed"))]
        known = [one for one in named if not _words(one) & _STATISTICS]
        plain = [one for one in known if self._has_unit(one.place, "N")]
        plain = plain or [one for one in known if self._has_unit(one.place, _COEFFICIENT)]
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
            self.notes.append(f"not read, because they are not the force of a stroke: {names}")
        return tuple(kept)

    def _above(self) -> list[str]:
        """Return the setting above each column, from a row above repeated names; an empty cell repeats the last one."""
        row = self.record.preamble[-1] if self.record.preamble else ()
        is_repeated = any(_REPEATED.search(name) for name in self.record.names)
        if not is_repeated or not 1 < len(row) <= len(self.record.names):
            return []
        cells = [cell.strip() for cell in row] + [""] * (len(self.record.names) - len(row))
        above = [next((c for c in cells[i::-1] if c), "") for i in range(len(cells))]
        named = [_StrokeColumn(i, *_split(name)) for i, name in enumerate(self.record.names)]
        forces = [(one.stroke, above[one.place]) for one in named if one.stroke and _is_plain(one)]
        forces = forces or [("", above[i]) for i in range(len(above)) if self._is_force(i)]
        return above if len(set(forces)) == len(forces) else []  # a line of other words is no row of settings

    def _speed_place(self, place: int, stroke: str = "") -> int:
        """Return the speed of a column of forces: of its stroke, or the nearest one before it, or the first one."""
        own = [i for i, name in enumerate(self.record.names) if stroke and _speed_of(name) == stroke]
        before = [i for i in own or self._all("speed") if i < place]
        return before[-1] if before else own[0] if own else self._need("speed")

    def _has_unit(self, i: int, si: str) -> bool:
        unit = self.record.units[i] or self.units.get(self.record.names[i]) or self.units.get("force")
        return unit is not None and is_unit(unit) and compatible(unit, si)

    # ---- Cells and other columns ------------------------------------------------------------------------------------

    def _is_force(self, i: int) -> bool:
        name = self.record.names[i]
        taken = _is_setting(name) or _is_kind(name, "speed") or _is_kind(name, "side")
        return (self._has_unit(i, "N") or self._has_unit(i, _COEFFICIENT)) and not taken

    def _settings(self) -> list[str]:
        """Return the setting of each line, from the column of settings; empty without this column."""
        i = next((i for i in range(len(self.record.names)) if _is_setting(self.record.names[i])), None)
        count = self.record.columns[0].size
        if i is None:
            return [""] * count
        cells = self.record.column(i)
        name = self.record.names[i].lower()
        return [f"{name} {float(cell):g}" if is_number(str(cell)) else str(cell) for cell in cells]

    def _side(self, cell: str, row: int) -> str:
        if stroke := _stroke_of(cell):
            return stroke
        what = f"{cell!r} is neither compression nor rebound; write comp or reb"
        raise self.record.origin.fault(DataError, what, channel="side", sample=row)

    def _all(self, kind: str) -> list[int]:
        return [i for i, name in enumerate(self.record.names) if _is_kind(name, kind)]

    def _need(self, kind: str) -> int:
        found = self._all(kind)
        if not found:
            advice = f"name it with --channel {kind.replace('speed', 'velocity')}=COLUMN"
            what = f"there is no column for this channel; {advice}; the file has: {self.record.listed}"
            raise self.record.origin.header_fault(MissingChannelError, what, channel=kind)
        return found[0]

    def _pairs(self, speeds: int, forces: int, channel: str) -> Iterator[tuple[int, float, float]]:
        """Yield row, speed [m/s] and force [N] of two columns; rows in which both are empty are left out.

        A damping coefficient gives the force at its speed.
        """
        is_filled = np.ones(self.record.columns[0].size, dtype=bool)
        if all(self.record.columns[i].dtype != object for i in (speeds, forces)):
            is_filled = ~(np.isnan(self.record.column(speeds)) & np.isnan(self.record.column(forces)))
        rows = np.flatnonzero(is_filled)
        speed = self._values(speeds, "speed", "m/s", rows)
        is_slope = _STATISTICS & set(re.findall(r"[a-z]+", self.record.names[forces].lower()))
        if self._has_unit(forces, _COEFFICIENT) and not is_slope:
            coefficient = self._values(forces, channel, _COEFFICIENT, rows)
            name = self.record.names[forces]
            self.notes.append(f"{name!r} is a damping coefficient: force = coefficient x speed; a slope would be less")
            force = coefficient * speed
        else:
            force = self._values(forces, channel, "N", rows)
        yield from zip(rows.tolist(), speed.tolist(), force.tolist(), strict=True)

    def _values(self, i: int, channel: str, si: str, rows: NDArray[np.intp]) -> Array:
        """Return rows (K,) of a column in SI."""
        given = dict(self.units)
        if "velocity" in given:
            given.setdefault("speed", given["velocity"])
        if si != "m/s" and "force" in given:
            given.setdefault(channel, given["force"])
        unit = self.record.unit(i, channel=channel, given=given, mapped=None)
        try:
            fits = compatible(unit, si)
        except UnknownUnitError as error:
            raise self.record.origin.header_fault(UnknownUnitError, str(error), channel=channel) from error
        if not fits:
            what = f"the unit {unit!r} cannot be converted to {si!r}; check that it is the right column"
            raise self.record.origin.header_fault(UnknownUnitError, what, channel=channel)
        raw = self.record.numbers(i, channel=channel)[rows]
        lines = self.record.origin.lines
        origin = replace(self.record.origin, lines=rows + 1 if lines is None else lines[rows])
        check_finite(raw, channel=channel, origin=origin)
        return convert(raw, unit, si)


def _is_plain(column: _StrokeColumn) -> bool:
    """Return whether a column's name has the stroke alone, at most with the mark of a repeated name."""
    return not column.clicks or bool(_REPEATED.fullmatch(column.clicks))


def _words(column: _StrokeColumn) -> set[str]:
    return set(re.findall(r"[a-z]+", column.clicks.lower()))


def _without_mean(clicks: str) -> str:
    """Return the setting behind a stroke without the word for a mean."""
    return " ".join(word for word in clicks.split() if word.lower() not in _MEANS)


# ==== Static points from the loops of a continuous-velocity plot (CVP) without time ==================================

CLASSES = 25  #: Number of classes of speed on each side.
MOST_PEAKS = 200  #: A table with more rows than this, or whose velocity turns back, is a loop and not a list of peaks.


def _is_loop(velocity: Array) -> bool:
    """Return whether velocities (N,) are samples around a loop, not peaks from the lowest to the highest."""
    signs = np.sign(np.diff(velocity))
    return velocity.size > MOST_PEAKS and bool(np.diff(signs[signs != 0.0]).any())


def _loop_means(velocity: Array, force: Array) -> tuple[Array, Array]:
    """Return mean velocities (K,) and mean forces (K,) in classes of velocity, in which both branches count equally.

    The difference between the branches, which is caused by lag and gas stiffness, is not used: without time it does not
    determine a lag.
    """
    rising = np.gradient(velocity) > 0.0
    found = []
    for side in (-1.0, 1.0):
        edges = np.linspace(0.0, float((side * velocity).max()), CLASSES + 1)
        for low, high in pairwise(edges.tolist()):
            inside = (side * velocity > low) & (side * velocity <= high)
            branches = [inside & rising, inside & ~rising]
            if all(branch.any() for branch in branches):
                found.append([np.mean([row[b].mean() for b in branches]) for row in (velocity, force)])
    means = np.array(found, dtype=np.float64).reshape(-1, 2)
    return means[:, 0], means[:, 1]
