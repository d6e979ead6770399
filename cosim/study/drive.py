"""A study's drivefile as the master takes it."""

from __future__ import annotations

from cosim.study.study import Drive
from eightpost.errors import InputError
from eightpost.signals import ChannelMap, Drivefile


def read_drive(drive: Drive) -> Drivefile:
    """Read a drivefile.

    Raises:
        InputError: The run leaves it.
        DataError: It cannot be read.
    """
    mapping = ChannelMap.read(drive.channel_map) if drive.channel_map else None
    found = Drivefile.read(drive.file, channel_map=mapping, units=drive.units or None)
    first, last = float(found.series.time[0]), float(found.series.time[-1])
    if drive.start < first - 1e-9 or drive.start + drive.stop > last * (1.0 + 1e-9) + 1e-9:
        raise InputError(
            f"drive {drive.name!r}: the run takes {drive.start:g} to {drive.start + drive.stop:g} s of {drive.file}, "
            f"which holds {first:g} to {last:g} s: change stop or start"
        )
    return found
