"""Bounds of a law's own parameters in a fit, from the record."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.units import convert

_POUND = convert(1.0, "lbf", "N")

#: tau [s], transition forces [N] and their minimum distance [N] of 3.3.3: 0.1 to 10 ms, 10 to 1000 lbf, 1 lbf.
TIME_CONSTANT, FORCE, GAP = (1e-4, 1e-2), (10.0 * _POUND, 1000.0 * _POUND), _POUND

#: A record below this rate [Hz] may show longer lags, so the bound is raised to this [s]. Measured ones reach 30 ms.
_SLOW_RATE, _LONG_LAG = 1000.0, 5e-2

#: Lower bound of tau as a share of the sampling interval.
_SHORTEST_SHARE = 0.1

#: Upper bound of the transition forces over the record's peak force, so that alpha = 1 can be reached everywhere.
_HEADROOM = 2.0


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of the dynamic parameters."""

    time_constant: tuple[float, float]  #: Lowest and highest tau [s].
    force: tuple[float, float]  #: Lowest and highest transition force [N].
    gap: float  #: Minimum distance of the two transition forces [N].
    lag_changes: tuple[str, ...] = ()  #: A sentence for each bound of tau that is not the dissertation's.
    #: A sentence for each bound of the transition forces that is not the dissertation's.
    force_changes: tuple[str, ...] = ()


def limits_for(force: Array, rate: float, *, ceiling: float = float("inf")) -> Limits:
    """Return the bounds that suit a record.

    Args:
        force: Measured force (N,) [N].
        rate: Sampling rate [Hz].
        ceiling: Upper bound of the transition forces for any record [N].
    """
    peak = float(np.abs(force - force.mean()).max())
    time_constant, lag_changes = _time_constant(rate)
    forces, gap = (min(FORCE[0], 0.1 * peak), min(_HEADROOM * peak, ceiling)), min(GAP, 0.05 * peak)
    return Limits(time_constant, forces, gap, lag_changes, _force_changes(forces, gap, peak))


def _time_constant(rate: float) -> tuple[tuple[float, float], tuple[str, ...]]:
    lowest, highest = max(TIME_CONSTANT[0], _SHORTEST_SHARE / rate), TIME_CONSTANT[1]
    changes = []
    if lowest > TIME_CONSTANT[0] * (1.0 + 1e-9):
        why = "a tenth of the record's sampling interval"
        changes.append(f"shortest tau {1e3 * lowest:.3g} ms instead of 0.1 ms: {why}")
    if rate < _SLOW_RATE:
        highest = _LONG_LAG
        changes.append(f"longest tau {1e3 * highest:.3g} ms instead of 10 ms: the record is sampled at {rate:.4g} Hz")
    if lowest >= highest:
        raise ParameterError(
            f"the record is sampled at {rate:.4g} Hz; a lag of at most {1e3 * highest:.3g} ms cannot be found below "
            f"{_SHORTEST_SHARE / highest:.3g} Hz. If time is in ms but labelled s, set its unit in a channel map; "
            "otherwise record at a higher rate"
        )
    return (lowest, highest), tuple(changes)


def _force_changes(forces: tuple[float, float], gap: float, peak: float) -> tuple[str, ...]:
    changes, why = [], f"the record's force peaks at {_force(peak)} about its mean"
    if forces[0] < FORCE[0]:
        changes.append(f"lowest transition force {_force(forces[0])} instead of 10 lbf: {why}")
    if forces[1] != FORCE[1]:
        changes.append(f"highest transition force {_force(forces[1])} instead of 1000 lbf: {why}")
    if gap < GAP:
        changes.append(f"transition forces at least {_force(gap)} apart instead of 1 lbf: {why}")
    return tuple(changes)


def _force(force: float) -> str:
    return f"{convert(force, 'N', 'lbf'):.4g} lbf ({force:.4g} N)"
