"""Scale to which a channel's errors refer: the product's own scale, at the true size of the channel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cosim.results.error_estimate import judged_by

Array = NDArray[np.float64]


def reference_scales(values: Array, units: Sequence[str]) -> Array:
    """Return the reference (C,) that errors of channels are divided by, in each channel's own unit.

    Args:
        values: Channels after settling (C, K).
        units: SI units (C,).
    """
    spread = dict(enumerate(np.std(values, axis=1).tolist()))
    return np.array(list(judged_by(spread, dict(enumerate(units))).values()))


def percent(apart: Array, scales: Array) -> Array:
    """Return the root mean squares of differences (C, K) in percent of the references (C,)."""
    return np.asarray(100.0 * np.sqrt(np.mean(apart**2, axis=1)) / scales)
