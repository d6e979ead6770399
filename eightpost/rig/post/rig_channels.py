"""Names and units of the rig's channels (Table 6.1; docs/rig.md)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eightpost.signals.channel_map import ChannelMap, MappedChannel, find_time

if TYPE_CHECKING:
    from eightpost.signals.raw_record import RawRecord

_AT_CORNERS = {
    "road": "m",
    "road_command": "m",
    "aero": "N",
    "aero_command": "N",
    "aero_position": "m",
    "tire_force": "N",
    "displacement": "m",
    "velocity": "m/s",
    "force": "N",
    "hub_acceleration": "m/s2",
    "chassis_acceleration": "m/s2",
}
_ONCE = {
    "aero_force": "N",
    "aero_force_command": "N",
    "ride_height": "m",
    "front.ride_height": "m",
    "rear.ride_height": "m",
    "driver.acceleration": "m/s2",
    **{f"cg.{axis}_acceleration": "m/s2" for axis in ("vertical", "longitudinal", "lateral")},
    "heave_force": "N",
    "heave_force_command": "N",
    **{f"{mode}_moment{kind}": "N.m" for mode in ("roll", "pitch") for kind in ("", "_command")},
    "aero.heave": "m",
    **{f"aero.{mode}": "rad" for mode in ("pitch", "roll", "warp")},
    **{f"aero.heave_force{kind}": "N" for kind in ("", "_command")},
    **{f"aero.{mode}_moment{kind}": "N.m" for mode in ("pitch", "roll", "warp") for kind in ("", "_command")},
}

#: SI unit of every channel that a rig test may have.
CHANNEL_UNITS = {
    **{f"{corner}.{name}": unit for corner in ("lf", "rf", "lr", "rr") for name, unit in _AT_CORNERS.items()},
    **_AT_CORNERS,
    **_ONCE,
}


def rig_map(record: RawRecord, channel_map: ChannelMap | None) -> ChannelMap:
    """Return the channel map of a rig record: the given map, completed by all columns with the name of a channel."""
    given = channel_map or ChannelMap()
    time = given.time or find_time(record)
    taken = {pick.source for pick in given.channels.values()} | {time.source}
    own = {n: MappedChannel(n) for n in record.names if n in CHANNEL_UNITS and n not in taken}
    return ChannelMap({**own, **given.channels}, time, given.path)
