"""Limits of a curve: a master curve with tolerances, and whether measured curves are within them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import InputError
from eightpost.ident.dyno_report.curve import STROKES, Stroke, VelocityCurve, forces_at
from eightpost.ident.dyno_report.entry import Band, Entry
from eightpost.ident.dyno_report.found import Unknown
from eightpost.signals.raw_record import RawRecord
from eightpost.units import compatible, convert

#: Beginning of the name of a column of tolerances, in letters of any case.
_TOLERANCE = "tol"


@dataclass(frozen=True, slots=True, eq=False)
class Limits:
    """A master curve with its tolerance."""

    #: Name of the file.
    name: str
    #: Curve in the middle of the limits.
    master: VelocityCurve
    #: Tolerance in either direction at the velocities of the curve (K,) [N].
    tolerance: Array

    def at(self, speed: float, stroke: Stroke) -> tuple[float, float] | None:
        """Return the force of the master and its tolerance [N] at a speed [m/s]; None beyond the curve."""
        force = self.master.force_at(speed, stroke)
        if isinstance(force, Unknown):
            return None
        velocity = speed if stroke == "compression" else -speed
        return force, float(np.interp(velocity, self.master.velocity, self.tolerance))

    @property
    def band(self) -> Band:
        """Limits over velocity."""
        master = self.master
        return Band(master.velocity, master.force - self.tolerance, master.force + self.tolerance)


@dataclass(frozen=True, slots=True)
class Judgement:
    """Stroke of an entry, judged at the speed at which it is farthest from the master."""

    entry: Entry
    stroke: Stroke
    #: Number of speeds that were judged.
    count: int
    #: Speed [m/s], force [N], and force and tolerance of the master [N] there.
    speed: float
    force: float
    master: float
    tolerance: float

    @property
    def deviation(self) -> float:
        """Force minus that of the master [N]."""
        return self.force - self.master

    @property
    def passed(self) -> bool:
        """Whether the deviation is within the tolerance."""
        return abs(self.deviation) <= self.tolerance

    @property
    def text(self) -> str:
        """Force and limits at that speed, as text."""
        values = (convert(v, "N", "lbf") for v in (self.force, self.master, self.tolerance))
        force, master, tolerance = (f"{value:.3g}" for value in values)
        return f"{force} lbf at {convert(self.speed, 'm/s', 'in/s'):.3g} in/s, master {master} ± {tolerance} lbf"


def judgements(limits: Limits, entries: Sequence[Entry], speeds: Sequence[float]) -> Iterator[Judgement]:
    """Yield the judgement of each stroke of runs and tables at speeds [m/s] that the entry and the master reach."""
    for entry in entries:
        for stroke in STROKES if entry.kind != "law" else ():
            found = []
            for speed in speeds:
                force, limit = forces_at(entry.curve, speed, stroke), limits.at(speed, stroke)
                if isinstance(force, float) and limit is not None:
                    found.append((abs(force - limit[0]) / max(limit[1], 1e-12), speed, force, *limit))
            if found:
                yield Judgement(entry, stroke, len(found), *max(found)[1:])


def limits_of(entry: Entry, records: Sequence[RawRecord], tolerances: Sequence[tuple[float, str]]) -> Limits:
    """Return the limits of a master curve.

    Args:
        entry: Entry of the master's file.
        records: Tables of this file; a column of tolerances (`tolerance [N]` or `[%]`) by speed takes precedence.
        tolerances: Values with the unit `%` of the master's force or `N`; the largest one counts.

    Raises:
        InputError: The curve is unknown, or there is no tolerance, or one is not positive.
    """
    name = entry.source.name if entry.source else entry.name
    if isinstance(entry.curve, Unknown):
        raise InputError(f"--limits {name}: the file has no curve: {entry.curve.reason}")
    curve = entry.curve
    columns = [_column(record, entry.source) for record in records]
    found = next((column for column in columns if column is not None), None)
    given = [value for value, _ in tolerances] if found is None else found[1].tolist()
    if wrong := [value for value in given if not value > 0.0]:
        raise InputError(f"--limits {name}: a tolerance must be above 0, not {wrong[0]:g}")
    if found is not None:
        speeds, values, unit = found
        size = np.interp(np.abs(curve.velocity), speeds, values)
        return Limits(name, curve, size if unit == "N" else 0.01 * size * np.abs(curve.force))
    if not tolerances:
        raise InputError(f"--limits {name} has no column of tolerances; add --tolerance '5 %' or --tolerance '20 N'")
    sizes = [np.full(curve.force.size, v) if unit == "N" else 0.01 * v * np.abs(curve.force) for v, unit in tolerances]
    return Limits(name, curve, np.max(sizes, axis=0))


def _column(record: RawRecord, path: Path | None) -> tuple[Array, Array, str] | None:
    """Return speeds [m/s] and tolerances by speed, with their unit, `N` or `%`; None without such a column."""
    places = [k for k, name in enumerate(record.names) if name.strip().lower().startswith(_TOLERANCE)]
    speeds = [(k, unit) for k, unit in enumerate(record.units) if unit and compatible(unit, "m/s")]
    if not places or not speeds:
        return None
    (speed, speed_unit), unit = speeds[0], record.units[places[0]] or ""
    if unit != "%" and not compatible(unit, "N"):
        raise InputError(f"{path}: the tolerance needs the unit % or one of force, such as [N], not {unit!r}")
    at = np.abs(convert(record.numbers(speed, channel="speed"), speed_unit, "m/s"))
    values = record.numbers(places[0], channel="tolerance")
    order = np.argsort(at)
    return at[order], (values if unit == "%" else convert(values, unit, "N"))[order], "%" if unit == "%" else "N"
