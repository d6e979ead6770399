"""Difference of two runs of one system at different steps, in percent of each channel's scale."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from eightpost.signals import TimeSeries

Signal = TypeVar("Signal", bound=Hashable)

#: Smallest scale of a channel by SI unit, far below the resolution of sensors; used for a signal at rest.
FLOORS: Mapping[str, float] = {"m/s": 1e-6, "m": 1e-8, "N": 1e-3, "m/s2": 1e-3}

#: Smallest scale of a channel whose unit has no floor above.
_OTHER_FLOOR = 1e-9

#: Smallest scale of a channel as a share of the largest standard deviation of all channels of its unit [1].
_SHARE_OF_LARGEST = 1e-2


def scales(series: TimeSeries) -> dict[str, float]:
    """Return the scale of each channel, to which its percentages refer, in its SI unit.

    The scale is the standard deviation; at least 1 % of the largest standard deviation among channels of that unit, and
    at least the unit's floor. A signal that is nearly at rest therefore gets a scale from other signals of its unit.
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
    largest["1"] = 0.0  # signals without a unit may be of different kinds
    return {
        name: max(value, _SHARE_OF_LARGEST * largest[units[name]], FLOORS.get(units[name], _OTHER_FLOOR))
        for name, value in spread.items()
    }


def difference(coarse: TimeSeries, fine: TimeSeries) -> dict[str, float]:
    """Return the root mean square difference of each channel that both have, in percent of the finer run's scale.

    Args:
        coarse: Series of one run, without its settling time.
        fine: Series of the finer run. Times of both runs are compared; the result is infinite without such times.
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
    """Return the indices of times that two time axes have in common, except for rounding."""
    _, a, b = np.intersect1d(np.round(first, 12), np.round(second, 12), assume_unique=True, return_indices=True)
    return a, b
