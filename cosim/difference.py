"""How far two runs of the same system at different steps are from each other, and what that says of the finer one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cosim.result import Result
from eightpost.signals import TimeSeries


def difference(coarse: Result, fine: Result) -> dict[str, float]:
    """Return per channel that both have the root mean square of their difference after settling, in percent.

    Of the finer one's standard deviation; 0 where both stand still, infinite where only the finer one does.
    """
    a, b = coarse.settled(), fine.settled()
    return {name: _percent(a, b, name) for name in b.names if name in a.names}


def _percent(coarse: TimeSeries, fine: TimeSeries, name: str) -> float:
    shared, first, second = np.intersect1d(
        np.round(coarse.time, 12), np.round(fine.time, 12), assume_unique=True, return_indices=True
    )
    if shared.size == 0:
        return float("inf")
    apart = float(np.sqrt(np.mean((coarse[name][first] - fine[name][second]) ** 2)))
    spread = float(np.std(fine[name]))
    return 100.0 * apart / spread if spread > 0.0 else (0.0 if apart == 0.0 else float("inf"))


def error_of_finer(apart: Mapping[str, float], ratio: float, order: int) -> dict[str, float]:
    """Return per channel the error of the finer of two runs whose steps are as `ratio` to 1 (Richardson) [%]."""
    return {name: value / (ratio**order - 1.0) for name, value in apart.items()}
