"""A static curve to reach with the adjusters of a shock: from a table or from a shock file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eightpost import units
from eightpost.array_types import Array
from eightpost.errors import FileFormatError, MissingUnitError
from eightpost.ident.shock.curve import curve_forces
from eightpost.shock import read_shock
from eightpost.signals import read_record
from eightpost.signals.table_text import letters_of

#: Names of the columns of a curve, in lower case letters.
_COLUMNS = {
    "velocity": ({"v", "vel", "velocity", "speed", "dampervelocity", "shockvelocity"}, "m/s"),
    "force": ({"f", "force", "load", "damperforce", "shockforce"}, "N"),
}

#: Number of speeds at which the curve of a shock file is compared.
_POINTS = 121


@dataclass(frozen=True, slots=True, eq=False)
class TargetCurve:
    """A static curve to reach."""

    name: str  #: Name of the file.
    velocity: Array  #: Velocities (M,) [m/s], positive in compression.
    force: Array  #: Forces (M,) [N] without gas force.
    notes: tuple[str, ...] = ()  #: Notes on how it was read, one sentence each.


def read_target(path: str | Path) -> TargetCurve:
    """Read a target curve: a shock file, or a table with the columns velocity and force, with units.

    A force at zero velocity in a table is taken for gas force and subtracted.

    Raises:
        FileFormatError: The file has no such columns.
        MissingUnitError: A column has no unit.
        InputError: The velocities do not include both strokes.
    """
    path = Path(path)
    if path.suffix == ".json":
        curve = read_shock(path).law.curve
        velocity = np.linspace(-curve.rebound_speed, curve.compression_speed, _POINTS)
        return TargetCurve(path.name, velocity, curve_forces(curve, velocity))
    record = read_record(path)
    record.log_notes()
    found = {}
    for wanted, (names, unit) in _COLUMNS.items():
        places = [i for i, name in enumerate(record.names) if letters_of(name) in names]
        if not places:
            known = ", ".join(record.names)
            raise FileFormatError(f"has no column {wanted!r}; it has: {known}", path=path)
        given = record.units[places[0]]
        if given is None:
            raise MissingUnitError(
                f"has no unit; write it in the header, e.g. {wanted} [{unit}]", path=path, channel=wanted
            )
        values = np.asarray(record.columns[places[0]], dtype=np.float64)
        found[wanted] = np.asarray(units.convert(values, given, unit), dtype=np.float64)
    return _target(path, found["velocity"], found["force"])


def _target(path: Path, velocity: Array, force: Array) -> TargetCurve:
    order = np.argsort(velocity, kind="stable")
    velocity, force = velocity[order], force[order]
    if not (np.isfinite(velocity).all() and np.isfinite(force).all()) or velocity.size < 3:
        raise FileFormatError("needs three or more points of finite numbers", path=path)
    if not velocity[0] <= 0.0 <= velocity[-1]:
        return TargetCurve(path.name, velocity, force)
    offset = float(np.interp(0.0, velocity, force))
    notes = (
        (f"{offset:.4g} N at zero velocity is taken for gas force and subtracted from the target",) if offset else ()
    )
    return TargetCurve(path.name, velocity, force - offset, notes)
