"""The exact first-order lag of whole records: `eightpost.shock.lag` for arrays, and its derivative by tau."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import lfilter

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def lag(static: Array, time_constant: float, step: float) -> Array:
    """Return F_lag of tau dF_lag/dt = F_s - F_lag (Eq 3.24), exact for F_s linear between the samples.

        F_lag[n+1] = (1 - r) F_lag[n] + (r - w) F_s[n] + w F_s[n+1],   r = 1 - exp(-h / tau),  w = 1 - r tau / h

    It starts in equilibrium, F_lag[0] = F_s[0], and is linear in F_s, so each column of a design may be lagged alone.

    Args:
        static: Static force F_s (N,) [N], or columns (N, n).
        time_constant: tau [s], positive.
        step: h [s], positive.

    Returns:
        Lagged values with the shape of `static`.
    """
    rise, weight = _weights(time_constant, step)
    # Filtering along the last axis is several times as fast for contiguous columns.
    series = static.T
    start = (1.0 - weight) * series[..., :1]
    lagged, _ = lfilter([weight, rise - weight], [1.0, rise - 1.0], series, axis=-1, zi=start)
    return np.asarray(lagged.T, dtype=np.float64)


def lag_response(frequency: Array, time_constant: float, step: float) -> NDArray[np.complex128]:
    """Return the gain (K,) of `lag` at frequencies (K,) [Hz], that is, of the recursion and not the continuous lag."""
    rise, weight = _weights(time_constant, step)
    delay = np.exp(-2j * np.pi * frequency * step)
    return np.asarray((weight + (rise - weight) * delay) / (1.0 + (rise - 1.0) * delay))


def lag_sensitivity(static: Array, lagged: Array, time_constant: float, step: float) -> Array:
    """Return dF_lag/dtau (N,) [N/s], by differentiating the recursion of `lag`.

    Args:
        static: Static force F_s (N,) [N].
        lagged: Lagged force F_lag (N,) [N], from `lag`.
        time_constant: tau [s].
        step: h [s].
    """
    ratio = step / time_constant
    rise, _ = _weights(time_constant, step)
    ratio_slope = -ratio / time_constant
    rise_slope = np.exp(-ratio) * ratio_slope
    weight_slope = (rise / ratio - np.exp(-ratio)) / ratio * ratio_slope
    drive = np.zeros_like(static)
    drive[1:] = weight_slope * np.diff(static) + rise_slope * (static[:-1] - lagged[:-1])
    return np.asarray(lfilter([1.0], [1.0, rise - 1.0], drive), dtype=np.float64)


def _weights(time_constant: float, step: float) -> tuple[float, float]:
    ratio = step / time_constant
    rise = float(-np.expm1(-ratio))
    return rise, 1.0 - rise / ratio
