"""Detection of cavitation during a run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from eightpost.signals.timeseries import TimeSeries

#: Absolute pressure below which a chamber cavitates [Pa]: dissolved air comes out of the oil.
CAVITATION_PRESSURE = 30e3

#: Minimum share of the time with cavitation for a cavitating run [1].
CAVITATION_SHARE = 0.01


@dataclass(frozen=True, slots=True)
class Cavitation:
    """Cavitation in a run.

    Attributes:
        share: Share of samples with a chamber below 30 kPa absolute [1].
        lowest: Minimum absolute chamber pressure [Pa].
    """

    share: float
    lowest: float

    @property
    def cavitates(self) -> bool:
        """Whether the share is more than 1 %."""
        return self.share > CAVITATION_SHARE


def cavitation(response: TimeSeries) -> Cavitation:
    """Return the cavitation in a response of `PhysicalDamper.respond`."""
    lower = np.minimum(response["compression_pressure"], response["rebound_pressure"])
    return Cavitation(float(np.mean(lower < CAVITATION_PRESSURE)), float(lower.min()))
