"""What an error of a channel is in percent of: the one place where the campaign says so."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Least reference of a channel, by its unit: a signal at rest has no size of its own.
FLOORS: Mapping[str, float] = {"m/s": 1e-6, "m": 1e-8, "rad": 1e-8, "N": 1e-3, "m/s2": 1e-3}

#: Least reference of a channel, as a share of the largest standard deviation among the channels of its unit.
SHARE_OF_LARGEST = 0.01


def reference_scales(values: Array, units: Sequence[str]) -> Array:
    """Return the reference (C,) that errors of channels are divided by, in each channel's own unit.

    Args:
        values: Channels after settling (C, K).
        units: SI units (C,).
    """
    spread = np.std(values, axis=1)
    largest = {unit: float(max(s for s, u in zip(spread, units, strict=True) if u == unit)) for unit in set(units)}
    least = [max(SHARE_OF_LARGEST * largest[unit], FLOORS.get(unit, 1e-9)) for unit in units]
    return np.asarray(np.maximum(spread, least))


def percent(apart: Array, scales: Array) -> Array:
    """Return the root mean squares of differences (C, K) in percent of the references (C,)."""
    return np.asarray(100.0 * np.sqrt(np.mean(apart**2, axis=1)) / scales)
