"""Columns of rig records with a team's own names: recognition, and a proposed channel map."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from eightpost.corners import CORNERS
from eightpost.errors import UnknownUnitError
from eightpost.signals.channel_map import TIME_NAMES
from eightpost.units import compatible

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord

#: Words for a corner and for an axle, in lower case.
_CORNER = {"lf": "lf", "fl": "lf", "vl": "lf", "rf": "rf", "fr": "rf", "vr": "rf",
           "lr": "lr", "rl": "lr", "hl": "lr", "rr": "rr", "hr": "rr"}  # fmt: skip
_AXLE = {"front": "front", "frt": "front", "rear": "rear"}
_SIDES = {("front", "left"): "lf", ("front", "right"): "rf", ("rear", "left"): "lr", ("rear", "right"): "rr"}

#: Words for the part that a sensor belongs to, and the channel of each SI unit there; the first part that fits applies.
_PARTS: tuple[tuple[Collection[str], Mapping[str, str]], ...] = (
    ({"al", "aero", "aeroloader", "downforce"}, {"m": "aero_position", "N": "aero"}),
    ({"rh", "ride", "rideheight"}, {"m": "ride_height"}),
    ({"damper", "shock", "dmp", "pot"}, {"m": "displacement", "N": "force", "m/s": "velocity"}),
    ({"body", "chassis", "frame", "sprung", "tower"}, {"m/s2": "chassis_acceleration"}),
    ({"hub", "upright", "unsprung", "axle", "wheel"}, {"m/s2": "hub_acceleration", "N": "tire_force"}),
    ({"wl", "loader", "wheelloader", "wheelpan", "pan", "road", "platen", "post", "shaker", "actuator", "tire", "tyre"},
     {"m": "road", "N": "tire_force"}),
)  # fmt: skip

#: Words for the SI unit of a column without a unit.
_QUANTITIES = {
    "m": {"pos", "position", "disp", "displacement", "travel", "stroke", "height", "pot"},
    "N": {"load", "force", "fz"},
    "m/s": {"vel", "velocity", "speed"},
    "m/s2": {"acc", "accel", "acceleration"},
}
_COMMAND = {"cmd", "command", "demand", "target"}
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")

#: Number of columns at each corner from which a file looks like a rig record.
_FEWEST = 2


@dataclass(frozen=True, slots=True)
class ProposedMap:
    """Columns of a file that look like channels of a rig."""

    columns: Mapping[str, tuple[str, ...]]  #: Columns that each channel could be, by channel.
    time: str  #: Column of the time; empty if none has a usual name.
    per_corner: int  #: Minimum number of columns at a corner.

    @property
    def finding(self) -> str:
        """What the file looks like, as a clause."""
        return f"looks like a rig record: it has {self.per_corner} or more columns at each corner"

    def toml(self) -> str:
        """Return the proposal as a channel map; if several columns could be a channel, they are comments."""
        lines = ["[time]", f'source = "{self.time}"', "", "[channels]"]
        for name, columns in self.columns.items():
            lines += [f'{"# " * (len(columns) > 1)}"{name}" = {{ source = "{column}" }}' for column in columns]
        return "\n".join(lines)


def propose_map(record: RawRecord) -> ProposedMap | None:
    """Return what the columns of a rig record look like, by the words in their names and their units.

    None if the file does not look like a rig record: it needs two columns at each of the four corners.
    """
    found: dict[str, tuple[str, ...]] = {}
    counts = dict.fromkeys(CORNERS, 0)
    for column, unit in zip(record.names, record.units, strict=True):
        words = [word.lower() for word in _WORD.findall(column)]
        axle = next((_AXLE[word] for word in words if word in _AXLE), "")
        side = next((word for word in words if word in ("left", "right")), "")
        corner = _SIDES.get((axle, side)) or next((_CORNER[word] for word in words if word in _CORNER), "")
        if corner:
            counts[corner] += 1
        kind = _kind({*words}, unit)
        if place := axle if kind == "ride_height" else corner:
            name = f"{place}.{kind}{'_command' * bool(_COMMAND & {*words} and kind in ('road', 'aero'))}"
            found |= {name: (*found.get(name, ()), column)} if kind else {}
    if min(counts.values()) < _FEWEST:
        return None
    return ProposedMap(found, next((n for n in record.names if n.lower() in TIME_NAMES), ""), min(counts.values()))


def _kind(words: Collection[str], unit: str | None) -> str:
    """Return the quantity of a channel that words and unit of a column stand for; empty if none."""
    try:
        by_unit = [si for si in _QUANTITIES if unit and compatible(unit, si)]
    except UnknownUnitError:
        by_unit = []
    si = next(iter(by_unit or [si for si, names in _QUANTITIES.items() if names & {*words}]), "")
    return next((kinds[si] for part, kinds in _PARTS if {*part} & {*words} and si in kinds), "")
