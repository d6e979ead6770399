"""Response of hydraulic wheelloaders and pneumatic aeroloaders to their commands (6.1.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi

from eightpost.rig.post.drive import RATE
from eightpost.signals.timeseries import TimeSeries

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.rig.post.car import Car

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Actuators:
    """Actuators modelled as second-order low-passes.

    Attributes:
        wheelloader: Bandwidth of the wheelloaders [Hz]; 125 in 6.1.1.
        aeroloader: Bandwidth of the aeroloaders [Hz]; 9 in 6.1.1.
    """

    wheelloader: float = 125.0
    aeroloader: float = 9.0

    def follow(self, command: TimeSeries, car: Car) -> TimeSeries:
        """Return the roads and loads (`car.inputs`) at 1250 Hz for commands with the same names."""
        grid = command.resample(RATE)
        roads = car.named("road")
        channels = {}
        for name in car.inputs:
            bandwidth = self.wheelloader if name in roads else self.aeroloader
            channels[name] = (grid.unit(name), _filter(grid[name], bandwidth))
        return TimeSeries.from_channels(grid.time, channels)


def _filter(command: Array, bandwidth: float) -> Array:
    """Return a command (N,) after a Butterworth low-pass that starts in steady state at the first value."""
    numerator, denominator = butter(2, bandwidth, fs=RATE)
    state = lfilter_zi(numerator, denominator) * command[0]
    return np.asarray(lfilter(numerator, denominator, command, zi=state)[0], dtype=np.float64)
