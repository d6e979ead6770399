"""Tables of peak velocities and forces (PVP), and their files in the layouts of manufacturers and dynamometers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.display import Summarized, Summary
from eightpost.errors import DataError, MissingChannelError, TooShortError, WrongSignError
from eightpost.files import sha256_of
from eightpost.labelled import data_frame
from eightpost.rig.dyno_conditions import conditions_from, reversed_channels, stated_units
from eightpost.rig.peak_velocity_columns import STROKES, Columns, Point, holds_peak_velocities, in_columns, stroke_above
from eightpost.signals.formats import read_records

if TYPE_CHECKING:
    import pandas as pd

    from eightpost.signals.raw_record import ChannelMap, RawRecord


FEWEST = 2  #: Minimum number of speeds for a curve.


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PeakVelocityTable(Summarized):
    """Force by speed in both strokes, at one setting of the adjusters and without dynamics.

    Raises:
        TooShortError: There are fewer than two speeds.
        DataError: The columns differ in length or contain NaN, or the speeds are not positive and increasing.
    """

    speed: Array  #: Peak speeds (K,) [m/s], positive and increasing.
    compression: Array  #: Force in compression (K,) [N], positive.
    rebound: Array  #: Force in rebound (K,) [N], negative.
    clicks: str | None = None  #: Adjuster settings and how they are counted, in the team's words.
    source: Path | None = None  #: Path of the file, None for a table created in memory.
    sha256: str = ""  #: SHA-256 digest of the file, empty without a file.
    gas_force: float = 0.0  #: Gas force in the table [N]; `compression` and `rebound` are without it.
    gas_source: str = ""  #: Description of how the gas force was found; empty without a gas force.
    rest_force: float = 0.0  #: Mean force at zero speed [N]; 0 without such points.
    notes: tuple[str, ...] = ()  #: Sentences on what was left out or computed while reading.

    def __post_init__(self) -> None:
        for name in ("speed", "compression", "rebound"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            object.__setattr__(self, name, values)
            if values.shape != (len(self),):
                what = f"has {values.size} values, but speed has {len(self)}; every row needs all three values"
                raise DataError(what, path=self.source, channel=name)
            if not np.isfinite(values).all():
                row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
                what = f"row {row} is not a number; enter a number or delete the row"
                raise DataError(what, path=self.source, channel=name)
        if len(self) < FEWEST:
            what = f"the table has {len(self)} speeds; a curve needs at least {FEWEST}"
            raise TooShortError(what, path=self.source)
        if self.speed[0] <= 0.0 or (np.diff(self.speed) <= 0.0).any():
            what = f"speeds must be positive and increase from row to row, not {self.speed.tolist()}"
            raise DataError(what, path=self.source, channel="speed")

    def _summary(self) -> Summary:
        gas = f"{self.gas_force:.4g} N, not in the table: {self.gas_source}" if self.gas_force else ""
        return Summary.of(
            "Peak-velocity table",
            ("file", self.source.name if self.source else ""),
            ("clicks", self.clicks or ""),
            ("speed", f"{self.speed[0]:.3g} to {self.speed[-1]:.3g} m/s, {len(self)} speeds"),
            ("compression", f"{self.compression[0]:.4g} to {self.compression[-1]:.4g} N"),
            ("rebound", f"{self.rebound[0]:.4g} to {self.rebound[-1]:.4g} N"),
            ("gas force", gas),
            ("notes", "; ".join(self.notes)),
        )

    def to_pandas(self) -> pd.DataFrame:
        """Return the forces of both strokes [N] over the speed [m/s].

        Raises:
            MissingExtraError: pandas is not installed.
        """
        forces = {"compression": self.compression, "rebound": self.rebound}
        return data_frame(forces, self.speed, "speed", dict.fromkeys(forces, "N"))

    def __len__(self) -> int:
        """Return the number of speeds K."""
        return int(np.size(self.speed))


# ---- Files ----------------------------------------------------------------------------------------------------------

SAME_SPEED = 0.05  #: Maximum difference of two forces at the same speed, as a share of the largest force.
#: Suffixes of files that are records over time.
_RECORDS = (".mf4", ".mdf", ".tdms", ".lvm", ".parquet", ".rsp", ".drv", ".tim", ".rpc", ".ld", ".vbo", ".xrk", ".xrz")


def read_peak_velocity(
    path: str | Path, *, units: Mapping[str, str] | None = None, channel_map: ChannelMap | None = None
) -> tuple[PeakVelocityTable, ...]:
    """Read the peak-velocity tables of a text file: one per setting of the adjusters, in the file's order.

    The layout is recognised by the column names (with units in the names or in a row under them):

    - `speed, compression, rebound`, optionally with a column `clicks`, or with the clicks in the names (`comp 3, reb 3,
      comp 6, reb 6`);
    - `side, setting, speed, force`, one line per point, where side is compression or rebound (comp, bump, reb, ...);
    - a signed `speed` (compression positive) and one column of force per setting, or pairs of such columns;
    - a row for each stroke and a column for each speed (`side, clicks, 25 mm/s, 50 mm/s`), or all rows as channels;
    - `side, low [N.s/m], knee [m/s], high [N.s/m]`: damping rates below and above a knee.

    Several blocks are several settings. A long table of velocity and force without time is a continuous-velocity loop,
    and the means of its branches are its points. The signs are changed so that compression is positive and rebound
    negative. The sum of the forces of each stroke in the whole file shows whether the file contains magnitudes, these
    signs or the opposite signs. Points at zero speed are friction and gas force; the gas force is found from them or
    from the lowest speeds, and subtracted. If the strokes have different speeds, both curves are interpolated linearly
    at all speeds in their common range. Two forces at the same speed are averaged if they agree within 5 % of the
    largest force. A damping coefficient (N.s/m) instead of a force is multiplied by its speed.

    Args:
        path: Path of a text file or a spreadsheet; several blocks, one below the other, are several settings.
        units: Units by column name, or for `velocity` and `force`, for columns without a unit in the file.
        channel_map: Columns of `velocity`, `force`, `compression`, `rebound` or `setting` with unusual names.

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
    return _tables(path, read_records(path), units, channel_map)


def peak_velocity_tables(
    path: Path, *, units: Mapping[str, str] | None = None, channel_map: ChannelMap | None = None
) -> tuple[PeakVelocityTable, ...]:
    """Return the peak-velocity tables of a file; nothing if it is a record over time. See `read_peak_velocity`."""
    if path.suffix.lower() in _RECORDS:
        return ()
    records = read_records(path)
    return _tables(path, records, units, channel_map) if holds_peak_velocities(records, channel_map) else ()


def _tables(
    path: Path, records: Sequence[RawRecord], units: Mapping[str, str] | None, channel_map: ChannelMap | None
) -> tuple[PeakVelocityTable, ...]:
    notes: list[str] = []
    points = _with_signs(list(_points_of(records, dict(units or {}), channel_map, notes)), path)
    settings = list(dict.fromkeys(point.setting for point in points))
    tables = (_table(setting, [point for point in points if point.setting == setting], path) for setting in settings)
    return tuple(replace(table, notes=tuple(notes)) for table in tables)


def _points_of(
    records: Sequence[RawRecord], units: Mapping[str, str], channel_map: ChannelMap | None, notes: list[str]
) -> Iterator[Point]:
    """Yield the points of all blocks of a file; lines above a block may name setting and stroke. Add to the notes."""
    setting = ""
    for number, record in enumerate((in_columns(one, channel_map) for one in records), 1):
        clicks = conditions_from(record.preamble)[0].clicks
        stroke = stroke_above(record)
        named = clicks or (setting if stroke else f"block {number}" if len(records) > 1 else "")
        setting = named
        given = {**stated_units(record.preamble), **units}
        stated, statement = reversed_channels(record.preamble, record.origin.path or Path())
        columns = Columns(record, given, stroke, statement if stated.get("velocity") else "")
        for point in columns.points():
            yield point._replace(setting=" ".join(filter(None, (named if len(records) > 1 else "", point.setting))))
        notes += [note for note in (*record.notes, *record.steps, *columns.notes) if note not in notes]


def _with_signs(points: list[Point], path: Path) -> list[Point]:
    """Return the points, with positive forces in compression and negative forces in rebound."""
    moving = [point for point in points if point.speed > 0.0]
    sums = {stroke: sum(point.force for point in moving if point.stroke == stroke) for stroke in STROKES}
    if sums["compression"] < 0.0 and sums["rebound"] < 0.0:
        what = (
            "compression and rebound both have negative forces, so the sign convention is not clear; change the sign "
            "of one column"
        )
        raise WrongSignError(what, path=path, channel="force")
    signs = {"compression": np.sign(sums["compression"]) or 1.0, "rebound": -np.sign(sums["rebound"]) or 1.0}
    return [point._replace(force=float(signs[point.stroke]) * point.force) for point in points]


def _table(setting: str, points: list[Point], path: Path) -> PeakVelocityTable:
    """Return the table of one setting at the speeds of both strokes in their common range."""
    moving = [point for point in points if point.speed > 0.0]
    curves = {stroke: _curve(setting, stroke, moving, path) for stroke in STROKES}
    (low, _), (high, _) = curves.values()
    speeds = np.union1d(low, high)
    speeds = speeds[(speeds >= max(low[0], high[0])) & (speeds <= min(low[-1], high[-1]))]
    compression, rebound = (np.interp(speeds, *curve) for curve in curves.values())
    at_rest = [point.force for point in points if point.speed == 0.0]
    gas, source = _gas(curves["compression"], curves["rebound"], at_rest)
    return PeakVelocityTable(
        speeds, compression - gas, rebound - gas, clicks=setting or None, source=path, sha256=sha256_of(path),
        gas_force=gas, gas_source=source, rest_force=float(np.mean(at_rest)) if len(at_rest) > 1 else 0.0,
    )  # fmt: skip


GAS_SHARE = 0.03  #: Gas force that is reported, as a share of the largest force.
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


def _curve(setting: str, stroke: str, points: list[Point], path: Path) -> tuple[Array, Array]:
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
