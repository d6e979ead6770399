"""Files with tables of peak velocities and forces (PVP)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.errors import (
    DataError,
    MissingChannelError,
    UnknownUnitError,
    WrongSignError,
)
from eightpost.files import sha256_of
from eightpost.rig.continuous_velocity import MOST_PEAKS, is_loop, loop_means
from eightpost.rig.dyno_conditions import conditions_from
from eightpost.rig.peak_velocity_table import PeakVelocityTable
from eightpost.signals.faults import check_finite
from eightpost.signals.formats import read_records
from eightpost.signals.raw_record import is_number, letters_of
from eightpost.units import compatible, convert

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord


_SPEED = {"speed", "velocity", "vel", "v", "peakvelocity", "peakspeed", "shaftspeed", "pistonspeed"}
_FORCE = {"force", "f", "load", "peakforce"}
_STROKE = {"side", "stroke", "direction", "phase"}
_SETTING = {"setting", "settings", "clicks", "click", "adjuster"}
_WORDS = {
    "compression": ("compression", "comp", "bump", "jounce", "push", "c"),
    "rebound": ("rebound", "reb", "extension", "droop", "ext", "pull", "r"),
}
#: Name of a column of one stroke: a word for the stroke, optionally followed by the clicks.
_COLUMN = {
    stroke: re.compile(
        rf"^(?:{'|'.join(words)})(?![a-z])\.?(?:[\s_]*(?:peak[\s_]*)?force)?[\s_:,-]*(.*)$", re.IGNORECASE
    )
    for stroke, words in _WORDS.items()
}
_FORCE_WORD = re.compile(r"^(?:peak\s*)?(?:force|load|f)(?![a-z])[\s_:,-]*", re.IGNORECASE)
#: Maximum difference of two forces at the same speed, as a share of the largest force.
SAME_SPEED = 0.05


class _Point(NamedTuple):
    """One force of a table in SI, with a positive speed."""

    setting: str
    stroke: str
    speed: float
    force: float


def read_peak_velocity(path: str | Path, *, units: Mapping[str, str] | None = None) -> tuple[PeakVelocityTable, ...]:
    """Read the peak-velocity tables of a text file: one per setting of the adjusters, in the file's order.

    The layout is recognised by the column names (with units in the names or in a row under them):

    - `speed, compression, rebound`, optionally with a column `clicks`, or with the clicks in the names (`comp 3, reb 3,
      comp 6, reb 6`);
    - `side, setting, speed, force`, one line per point, where side is compression or rebound (comp, bump, reb, ...);
    - a signed `speed` (compression positive) and one column of force per setting.

    Several blocks are several settings. A long table of velocity and force without time is a continuous-velocity loop,
    and the means of its branches are its points. The signs are changed so that compression is positive and rebound
    negative. The sum of the forces of each stroke in the whole file shows whether the file contains magnitudes, these
    signs or the opposite signs. Points at zero speed are friction and gas force; the gas force is found from them or
    from the lowest speeds, and subtracted. If the strokes have different speeds, both curves are interpolated linearly
    at all speeds in their common range. Two forces at the same speed are averaged if they agree within 5 % of the
    largest force.

    Args:
        path: Path of a text file or a spreadsheet; several blocks, one below the other, are several settings.
        units: Units by column name, or for `speed` and `force`, for columns without a unit in the file.

    Raises:
        FileFormatError: The file cannot be read.
        MissingChannelError: There is no speed or force, or a setting lacks a stroke.
        MissingUnitError: A column has no unit.
        UnknownUnitError: A unit is unknown or has the wrong dimension.
        NotANumberError: A cell is empty or not a number.
        DataError: Two forces at the same speed differ by too much.
        WrongSignError: Both strokes have negative forces.
    """
    path = Path(path)
    points = _with_signs(list(_points_of(read_records(path), dict(units or {}))), path)
    settings = list(dict.fromkeys(point.setting for point in points))
    return tuple(_table(setting, [point for point in points if point.setting == setting], path) for setting in settings)


def _points_of(records: Sequence[RawRecord], units: Mapping[str, str]) -> Iterator[_Point]:
    """Yield the points of all blocks of a file; the lines above a block may name its setting and its stroke."""
    setting = ""
    for number, record in enumerate(records, 1):
        record.log_notes()
        clicks = conditions_from(record.preamble)[0].clicks
        stroke = _stroke_above(record)
        named = clicks or (setting if stroke else f"block {number}" if len(records) > 1 else "")
        setting = named
        for point in _Columns(record, units, stroke).points():
            yield point._replace(setting=" ".join(filter(None, (named if len(records) > 1 else "", point.setting))))


def _stroke_above(record: RawRecord) -> str | None:
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
    if {"t", "time", "timestamp", "times", "elapsedtime"} & set(plain) or not _SPEED & set(plain):
        return False
    strokes = {stroke for name in record.names for stroke in _WORDS if _COLUMN[stroke].match(name)}
    return strokes == set(_WORDS) or bool((_STROKE | _FORCE) & set(plain)) or record.columns[0].size < MOST_PEAKS


@dataclass(frozen=True, slots=True)
class _Columns:
    """Columns of a table and their contents."""

    record: RawRecord
    units: Mapping[str, str]
    stroke: str | None = None

    def points(self) -> Iterator[_Point]:
        """Yield the points of the table in any of the layouts."""
        speed = self._values(self._need(_SPEED, "speed"), "speed", "m/s")
        strokes = {i: stroke for i in range(len(self.record.names)) if (stroke := self._stroke_column(i))}
        sides = self._find(_STROKE)
        if sides is not None:
            yield from self._by_side(speed, self.record.columns[sides])
        elif strokes:
            yield from self._by_stroke(speed, strokes)
        elif self.stroke is not None:
            force = self._values(self._need(_FORCE, "force"), "force", "N")
            for setting, v, f in zip(self._settings(), np.abs(speed), force, strict=True):
                yield _Point(setting, self.stroke, float(v), float(f))
        else:
            yield from self._by_sign(speed)

    def _by_side(self, speed: Array, sides: NDArray[np.object_]) -> Iterator[_Point]:
        force = self._values(self._need(_FORCE, "force"), "force", "N")
        settings = self._settings()
        for row, (v, f) in enumerate(zip(np.abs(speed), force, strict=True)):
            yield _Point(settings[row], self._side(str(sides[row]), row), float(v), float(f))

    def _by_stroke(self, speed: Array, strokes: Mapping[int, tuple[str, str]]) -> Iterator[_Point]:
        settings = self._settings()
        for i, (stroke, clicks) in strokes.items():
            force = self._values(i, self.record.names[i], "N")
            for row, (v, f) in enumerate(zip(np.abs(speed), force, strict=True)):
                yield _Point(" ".join(filter(None, (settings[row], clicks))), stroke, float(v), float(f))

    def _by_sign(self, speed: Array) -> Iterator[_Point]:
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
                yield _Point(" ".join(filter(None, (settings[row], name))), stroke, abs(float(v)), float(f))

    def _stroke_column(self, i: int) -> tuple[str, str] | None:
        """Return the stroke and the clicks in a column's name, or None."""
        for stroke, pattern in _COLUMN.items():
            match = pattern.match(self.record.names[i])
            if match:
                return stroke, match[1].strip()
        return None

    def _is_force(self, i: int) -> bool:
        unit = self.record.units[i] or self.units.get(self.record.names[i]) or self.units.get("force")
        taken = self._is_setting(i) or letters_of(self.record.names[i]) in _SPEED | _STROKE
        try:
            return unit is not None and compatible(unit, "N") and not taken
        except UnknownUnitError:
            return False

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

    def _find(self, names: set[str]) -> int | None:
        return next((i for i, name in enumerate(self.record.names) if letters_of(name) in names), None)

    def _need(self, names: set[str], channel: str) -> int:
        found = self._find(names)
        if found is None:
            what = f"there is no column for this channel; the file has: {', '.join(self.record.names)}"
            raise self.record.origin.header_fault(MissingChannelError, what, channel=channel)
        return found

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


def _with_signs(points: list[_Point], path: Path) -> list[_Point]:
    """Return the points, with positive forces in compression and negative forces in rebound."""
    moving = [point for point in points if point.speed > 0.0]
    sums = {stroke: sum(point.force for point in moving if point.stroke == stroke) for stroke in _WORDS}
    if sums["compression"] < 0.0 and sums["rebound"] < 0.0:
        what = (
            "compression and rebound both have negative forces, so the sign convention is not clear; change the sign "
            "of one column"
        )
        raise WrongSignError(what, path=path, channel="force")
    signs = {"compression": np.sign(sums["compression"]) or 1.0, "rebound": -np.sign(sums["rebound"]) or 1.0}
    return [point._replace(force=float(signs[point.stroke]) * point.force) for point in points]


def _table(setting: str, points: list[_Point], path: Path) -> PeakVelocityTable:
    """Return the table of one setting at the speeds of both strokes in their common range."""
    moving = [point for point in points if point.speed > 0.0]
    curves = {stroke: _curve(setting, stroke, moving, path) for stroke in _WORDS}
    (low, _), (high, _) = curves.values()
    speeds = np.union1d(low, high)
    speeds = speeds[(speeds >= max(low[0], high[0])) & (speeds <= min(low[-1], high[-1]))]
    compression, rebound = (np.interp(speeds, *curve) for curve in curves.values())
    gas, source = _gas(curves["compression"], curves["rebound"], [p.force for p in points if p.speed == 0.0])
    return PeakVelocityTable(
        speeds, compression - gas, rebound - gas, clicks=setting or None, source=path, sha256=sha256_of(path),
        gas_force=gas, gas_source=source,
    )  # fmt: skip


#: Gas force that is reported, as a share of the largest force.
GAS_SHARE = 0.03
#: The lowest speed of a table must be below this share of the highest speed for an extrapolation to zero.
_LOW_SPEED = 0.15


def _gas(compression: tuple[Array, Array], rebound: tuple[Array, Array], at_rest: Sequence[float]) -> tuple[float, str]:
    """Return the gas force [N] of a table and how it was found; 0 and an empty text without gas.

    Gas adds the same force to both strokes, so that the means of both strokes at zero speed, in which friction cancels,
    are not zero. Gas pushes: a negative force is attributed to the valves, not to gas.
    """
    largest = max(float(np.abs(forces).max()) for _, forces in (compression, rebound))
    if len(at_rest) >= 2:
        gas, source = float(np.mean(at_rest)), "the points at zero speed"
    elif max(compression[0][0], rebound[0][0]) <= _LOW_SPEED * min(compression[0][-1], rebound[0][-1]):
        gas = 0.5 * (_at_zero(*compression, 2) + _at_zero(*rebound, 2))
        other = 0.5 * (_at_zero(*compression, 3) + _at_zero(*rebound, 3))
        source = f"the lowest speeds of both strokes; between {min(gas, other):.4g} and {max(gas, other):.4g} N"
        if other < 0.5 * gas:
            return 0.0, ""
    else:
        return 0.0, ""
    return (gas, source) if gas > GAS_SHARE * largest else (0.0, "")


def _at_zero(speed: Array, force: Array, count: int) -> float:
    """Return the force at zero speed of the polynomial through the lowest `count` points."""
    speed, force = speed[:count], force[:count]
    return float(np.polyval(np.polyfit(speed, force, speed.size - 1), 0.0))


def _curve(setting: str, stroke: str, points: list[_Point], path: Path) -> tuple[Array, Array]:
    """Return the increasing speeds (K,) and the forces (K,) of a stroke."""
    rows = np.array([(point.speed, point.force) for point in points if point.stroke == stroke])
    if not rows.size:
        name = repr(setting) if setting else "of the file"
        what = f"the setting {name} has no point in {stroke}; a table needs both strokes"
        raise MissingChannelError(what, path=path, channel=stroke)
    speeds, places = np.unique(rows[:, 0], return_inverse=True)
    counts = np.bincount(places)
    forces = np.bincount(places, weights=rows[:, 1]) / counts
    worst = int(np.argmax(np.abs(rows[:, 1] - forces[places])))
    if abs(rows[worst, 1] - forces[places[worst]]) > SAME_SPEED * np.abs(rows[:, 1]).max():
        what = f"{setting or 'the table'} has different forces at {rows[worst, 0]:g} m/s; name every setting"
        raise DataError(what, path=path, channel=stroke)
    return speeds, forces
