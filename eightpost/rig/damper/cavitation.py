"""Whether a chamber was pulled apart during a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries

#: Absolute pressure under which a chamber counts as cavitating [Pa]: there dissolved air comes out of oils.
CAVITATION_PRESSURE = 30e3

#: Share of the time that makes a run a cavitating one [1].
CAVITATION_SHARE = 0.01


@dataclass(frozen=True, slots=True)
class Cavitation:
    """How near a run came to the vapour pressure.

    Attributes:
        share: Of the samples with a chamber under 30 kPa absolute [1].
        lowest: Chamber pressure, absolute [Pa].
    """

    share: float
    lowest: float

    @property
    def cavitates(self) -> bool:
        """Whether it was so for more than 1 % of the time."""
        return self.share > CAVITATION_SHARE


def cavitation(response: TimeSeries) -> Cavitation:
    """Return the diagnosis of a run that `PhysicalDamper.respond` returned."""
    lower = np.minimum(response["compression_pressure"], response["rebound_pressure"])
    return Cavitation(float(np.mean(lower < CAVITATION_PRESSURE)), float(lower.min()))
