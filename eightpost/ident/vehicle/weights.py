"""Weights of fits over frequency (4.4.1, 5.3.3, Eq 6.9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import ParameterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BandWeights:
    """One weight per frequency band, zero elsewhere.

    Attributes:
        bands: Tuples (low, high, weight) [Hz, Hz, 1]; a band includes its lower limit but not its upper.
    """

    bands: tuple[tuple[float, float, float], ...]

    def __post_init__(self) -> None:
        """Check the bands."""
        for low, high, weight in self.bands:
            if not (0.0 <= low < high and weight >= 0.0):
                raise ParameterError(f"the band ({low:g}, {high:g}, {weight:g}) needs 0 <= low < high and weight >= 0")

    def at(self, frequency: Array) -> Array:
        """Return the weights (K,) at frequencies (K,) [Hz]."""
        weights = np.zeros_like(frequency)
        for low, high, weight in self.bands:
            weights[(frequency >= low) & (frequency < high)] = weight
        return weights


#: 4.4.1, quarter car: 1 below 20 Hz.
QUARTER_CAR = BandWeights(((0.0, 20.0, 1.0),))
#: 5.3.3, seven-DOF car.
SEVEN_DOF = BandWeights(((0.5, 10.0, 1.0), (10.0, 20.0, 0.5)))
#: Eq 6.9, aeroloaders.
AEROLOADERS = BandWeights(((0.1, 5.0, 1.0), (5.0, 7.0, 0.5), (7.0, 12.0, 0.1)))
#: Eq 6.9, wheelloaders and shock forces.
WHEELLOADERS = BandWeights(((0.5, 10.0, 1.0), (10.0, 15.0, 0.5), (15.0, 20.0, 0.1)))
