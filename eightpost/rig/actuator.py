"""Actuator of the dynamometer, whose position deviates from the command because of magnetic cogging."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.units import convert

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries


@dataclass(frozen=True, slots=True)
class Actuator:
    """A linear motor whose cogging causes a position error with the pitch of its magnets (the ripple of 3.4.4).

        x = x_cmd + r sin(2 pi x_cmd / p)

    The ripple is real motion: it acts on the damper, and the sensors measure it.

    Attributes:
        ripple: Amplitude r of the ripple [m]. The velocity ripple is 2 pi r / p of the velocity: 1 % with the defaults;
            plausible values are 0 to 3 %.
        pitch: Pitch p of the magnets [m]; 20 to 60 mm for motors of this force.
    """

    ripple: float = 5e-5
    pitch: float = convert(1.2, "in", "m")

    def follow(self, command: TimeSeries) -> TimeSeries:
        """Return the motion along a command with the channel `displacement` [m]."""
        target = command["displacement"]
        actual = target + self.ripple * np.sin(2.0 * np.pi * target / self.pitch)
        return command.with_channel("displacement", "m", actual)
