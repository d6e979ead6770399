"""Drive files of a study for the co-simulation master."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cosim.study.study import Drive
from eightpost.errors import InputError
from eightpost.signals import ChannelMap, Drivefile, MappedChannel

#: Number of cached samples; a run requests the drive at its start and at all of its steps.
_CACHED = 4


@dataclass(frozen=True, slots=True, eq=False)
class RememberedDrive(Drivefile):
    """Drive file with cached samples: every setup requests the same times."""

    _samples: dict[bytes, NDArray[np.float64]] = field(init=False, repr=False, default_factory=dict)

    def sample(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the values (C, K) at `times` (K,) [s]."""
        key = times.tobytes()
        if key not in self._samples:
            found = Drivefile.sample(self, times)
            found.setflags(write=False)
            if len(self._samples) == _CACHED:
                self._samples.clear()
            self._samples[key] = found
        return self._samples[key]


def driving_channels(drive: Drive) -> Drivefile:
    """Read the channels that drive; the other channels of a record are not read.

    Raises:
        DataError: The file cannot be read.
    """
    mapping = ChannelMap.read(drive.channel_map) if drive.channel_map else None
    if not drive.targets:
        return Drivefile.read(drive.file, channel_map=mapping, units=drive.units)
    named = mapping or ChannelMap()
    channels = {name: named.channels.get(name, MappedChannel(name)) for name in drive.targets}
    read = {"time", *channels, *(pick.source for pick in channels.values())}
    given = {name: unit for name, unit in drive.units.items() if name in read}
    return Drivefile.read(drive.file, channel_map=replace(named, channels=channels), units=given)


def read_drive(drive: Drive) -> RememberedDrive:
    """Read a drive file.

    Raises:
        InputError: The run exceeds the time range of the file.
        DataError: The file cannot be read.
    """
    found = driving_channels(drive)
    first, last = float(found.series.time[0]), float(found.series.time[-1])
    if drive.start < first - 1e-9 or drive.start + drive.stop > last * (1.0 + 1e-9) + 1e-9:
        raise InputError(
            f"drive {drive.name!r}: the run needs {drive.start:g} to {drive.start + drive.stop:g} s of {drive.file}, "
            f"which contains {first:g} to {last:g} s; change stop or start"
        )
    return RememberedDrive(found.series)
