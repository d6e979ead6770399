"""The first-order lag tau dF_lag/dt = F_s - F_lag (Eq 3.24), exact over any step.

Standard library only: the FMU contains a copy of this file.
"""

from __future__ import annotations

from math import expm1


def advance(lagged: float, static_start: float, static_end: float, time_constant: float, step: float) -> float:
    """Return F_lag [N] after a step in which F_s changes linearly from `static_start` to `static_end` [N].

        F_lag(h) = F_lag + (F_s0 - F_lag)(1 - e) + (F_s1 - F_s0)(1 - (1 - e) tau / h),   e = exp(-h / tau)

    Args:
        lagged: F_lag at the start of the step [N].
        static_start: F_s at the start [N].
        static_end: F_s at the end [N].
        time_constant: tau [s], positive.
        step: h [s], positive.

    >>> advance(0.0, 100.0, 100.0, 0.0013, 0.0013)  # one time constant: 1 - 1/e of the way
    63.212055882855765
    """
    ratio = step / time_constant
    rise = -expm1(-ratio)
    return lagged + (static_start - lagged) * rise + (static_end - static_start) * (1.0 - rise / ratio)
