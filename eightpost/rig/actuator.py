"""The dynamometer's actuator does not follow its command exactly: magnets pull it along."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


@dataclass(frozen=True, slots=True)
class Actuator:
    """A linear motor whose cogging leaves a position error with the pitch of its magnets (3.4.4 sees the ripple).

        x = x_cmd + r sin(2 pi x_cmd / p)

    The ripple is real motion: the damper feels it and the sensors see it.

    Attributes:
        ripple: r [m]. The velocity's ripple is 2 pi r / p of the velocity: 1 % with the defaults; 0 to 3 %.
        pitch: p [m]; 20 to 60 mm for motors of this force.
    """

    ripple: float = 5e-5
    pitch: float = convert(1.2, "in", "m")

    def follow(self, command: TimeSeries) -> TimeSeries:
        """Return the motion along a command with the channel `displacement` [m]."""
        asked = command["displacement"]
        made = asked + self.ripple * np.sin(2.0 * np.pi * asked / self.pitch)
        return command.with_channel("displacement", "m", made)
