"""Difference of two runs of one system at different steps, in percent of each channel's scale."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from eightpost.signals import TimeSeries

Signal = TypeVar("Signal", bound=Hashable)

#: Smallest scale of a channel by SI unit: far below what a sensor resolves. A signal at rest is judged by it.
FLOORS: Mapping[str, float] = {"m/s": 1e-6, "m": 1e-8, "N": 1e-3, "m/s2": 1e-3}

#: Smallest scale of a channel whose unit has no floor above.
_OTHER_FLOOR = 1e-9

#: Smallest scale of a channel as a share of the largest standard deviation of all channels of its unit [1].
_SHARE_OF_LARGEST = 1e-2


def scales(series: TimeSeries) -> dict[str, float]:
    """Return per channel what percentages of it refer to, in its SI unit.

    The standard deviation; at least 1 % of the largest standard deviation among channels of that unit, and at least the
    unit's floor. A signal that hardly moves beside others of its kind is judged by theirs.
    """
    spread = {name: float(np.std(series[name])) for name in series.names}
    return judged_by(spread, {name: series.unit(name) for name in series.names})


def judged_by(spread: Mapping[Signal, float], units: Mapping[Signal, str]) -> dict[Signal, float]:
    """Return the scale of each signal.

    Args:
        spread: Standard deviation of each signal, in its SI unit.
        units: SI unit of each signal.
    """
    largest: dict[str, float] = {}
    for name, value in spread.items():
        largest[units[name]] = max(value, largest.get(units[name], 0.0))
    largest["1"] = 0.0  # signals without a unit need not be of one kind
    return {
        name: max(value, _SHARE_OF_LARGEST * largest[units[name]], FLOORS.get(units[name], _OTHER_FLOOR))
        for name, value in spread.items()
    }


def difference(coarse: TimeSeries, fine: TimeSeries) -> dict[str, float]:
    """Return per channel of both the root mean square of their difference, in percent of the finer one's scale.

    Args:
        coarse: Series of one run, without its settling time.
        fine: Series of the finer run; compared at the times that both have, infinite where they have none.
    """
    names = [name for name in fine.names if name in coarse.names]
    first, second = _common(coarse.time, fine.time)
    if first.size == 0:
        return dict.fromkeys(names, float("inf"))
    scale = scales(fine)
    return {
        name: 100.0 * float(np.sqrt(np.mean((coarse[name][first] - fine[name][second]) ** 2))) / scale[name]
        for name in names
    }


def _common(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Return where two time axes have the same time, but for rounding."""
    _, a, b = np.intersect1d(np.round(first, 12), np.round(second, 12), assume_unique=True, return_indices=True)
    return a, b
