"""Synthetic lap of a track on the virtual rig (6.1.3), because the Richmond drive file is not public."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError
from eightpost.rig.post.drive import RATE
from eightpost.rig.post.drivefiles import DOWNFORCE, check_duration, mean_load
from eightpost.rig.post.modes import aeroloader_forces
from eightpost.rig.track import Track, track_drivefile
from eightpost.signals.drivefile import Drivefile
from eightpost.signals.timeseries import TimeSeries
from eightpost.units import convert

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.rig.post.car import Car, Geometry

    Array = NDArray[np.float64]

#: Root mean square of the four roads of a lap [m]: 0.64 of the 0.11 in of the identification drive. Laps are smoother
#: than identification tests: Table 7.4 has 0.2 to 0.28 g at the front hubs and 0.32 to 0.47 g at the rear hubs, which
#: this car has at 0.03 in; at 0.07 in it has 0.5 to 0.76 g and 0.69 to 1.1 g. The smoother the lap, the larger is the
#: influence of friction (figures in docs/rig.md); at 0.07 in a linear model has the error found with our prototypes.
LAP_ROAD = convert(0.07, "in", "m")

#: Ratio of the loads of a lap to those of `Track`, which are those of the identification drive. With half the loads,
#: the total tire force is 260 to 300 lbf RMS; Table 7.4 has 149 to 204 lbf.
LAP_LOADS = 0.5

_TRACK = Track()
_LAP = replace(
    _TRACK,
    downforce=2.0 * sum(DOWNFORCE),
    heave_rms=LAP_LOADS * _TRACK.heave_rms,
    roll_rms=LAP_LOADS * _TRACK.roll_rms,
    pitch_rms=LAP_LOADS * _TRACK.pitch_rms,
)


def track_drive(car: Car, seed: int, *, duration: float = 33.0, road: float = LAP_ROAD) -> Drivefile:
    """Return a synthetic lap for a four-wheeled car; the aeroloaders apply the loads if the car has any.

    The spectra are those of `track_drivefile`. The aeroloaders have the mean forces of the identification tests.

    Args:
        car: Car whose inputs are commanded.
        seed: Seed of the noise generator.
        duration: Duration [s]; all channels grow from their means during the first second.
        road: Root mean square of the four roads together [m].

    Raises:
        ParameterError: The car does not have four wheels, or the duration is not positive.
    """
    if car.geometry is None:
        raise ParameterError("a track lap needs a car with four wheels")
    check_duration(duration)
    lap = track_drivefile(seed, duration=duration, rate=RATE, track=_LAP).series
    roads = np.stack([lap[name] for name in car.named("road")])
    roads *= road / np.sqrt(np.mean(roads**2))
    channels = {name: ("m", row) for name, row in zip(car.named("road"), roads, strict=True)}
    if car.loads == car.named("aero"):
        means = [mean_load(car, name) for name in car.loads]
        for name, mean, force in zip(car.loads, means, _aeroloaders(lap, car.geometry), strict=True):
            channels[name] = ("N", mean + force)
    else:
        channels |= {name: (lap.unit(name), lap[name]) for name in car.loads}
    return Drivefile(TimeSeries.from_channels(lap.time, channels))


def _aeroloaders(lap: TimeSeries, geometry: Geometry) -> Array:
    """Return the variation of the aeroloader forces about their means (4, N) [N, down] for the body loads of a lap."""
    heave = lap["heave_force"] + _LAP.downforce
    modes = np.stack([heave, lap["pitch_moment"], lap["roll_moment"], np.zeros(len(lap))])
    return aeroloader_forces(modes, geometry)
