"""Whether a record's drive is broadband: only then do its channels determine the laws of the car."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.ident.preparation.plausibility.spectra import Spectra

#: Share of the roads that must be broadband [1]; one of four may be disconnected.
MOST = 0.7
#: Smallest number of frequencies over which the acceleration of a road is spread [1]; a sine has 3.
FREQUENCIES = 10.0
#: Smallest share of the segments over which it is spread [1]; a bump is in a few of them.
SEGMENTS = 0.5
#: A road at rest moves less than this share of the largest [1].
RESTING = 0.1


def is_broadband(spectra: Spectra, corners: Sequence[str]) -> bool:
    """Return whether most roads move at random: a random test or a track, not a sine, a bump or a single actuator."""
    powers = []
    for corner in corners:
        names = [name for name in (channel(corner, "road"), channel(corner, "road_command")) if name in spectra]
        own = [np.abs(spectra.derivative(name, 2)) ** 2 for name in names]
        powers.append(max(own, key=_spread) if own else np.zeros((1, 1)))
    largest = max(float(power.sum()) for power in powers)
    moving = [float(power.sum()) > RESTING**2 * largest and _spread(power) >= 1.0 for power in powers]
    return float(np.mean(moving)) > MOST


def _spread(power: Array) -> float:
    """Return the spread over frequencies and segments (S, F), relative to the limits; the smaller of the two."""
    by_frequency, by_segment = _number(power.sum(axis=0)), _number(power.sum(axis=1))
    return min(by_frequency / FREQUENCIES, by_segment / (SEGMENTS * len(power)))


def _number(parts: Array) -> float:
    """Return the effective number of parts (sum p)^2 / sum p^2."""
    squares = float(np.sum(parts**2))
    return float(parts.sum()) ** 2 / squares if squares > 0.0 else 0.0
