"""Coupling error of a run, estimated from how differences between runs fall as the step halves.

docs/explanation/coupling.md derives it.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, log2
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cosim.results.result import Result
from cosim.results.run_data import Coupled
from eightpost.signals import TimeSeries

# ---- Difference of two runs of one system at different steps, in percent of each channel's scale --------------------

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


# ---- Coupling error of a run, estimated from how differences between runs fall as the step halves -------------------

#: Smallest order that the error is assumed to have [1].
_SLOWEST = 0.38

#: Largest order that the error is assumed to have [1]: if the channel's differences showed at least that, and if only
#: the bonds' local errors did, because a difference may fall fast by chance.
_FASTEST, _FASTEST_UNSEEN = 2.0, 1.5

#: Largest order of everything coupled with a component that holds its inputs [1]: if the channel's differences showed
#: at least that, and if not.
_OF_HELD, _OF_HELD_UNSEEN = 1.0, 0.5

#: Smallest value of a difference as a share of the one before [1], because it may be small by chance.
_LUCK = 1.0 / 8.0

#: Local errors below this share of the largest one are not used for the order [1].
_NEGLIGIBLE = 1e-2


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two runs, the finer one at half the step of the coarser."""

    difference: Mapping[str, float]  #: Difference of both runs per channel, in percent of its scale.
    reliable: bool  #: Whether both runs passed the check of their bonds' local errors.
    #: Order at which the bonds' local errors fell from one run to the other [1]; None without bonds.
    local_order: float | None


def compare(coarse: Result, fine: Result) -> Comparison:
    """Compare two runs of one system at all times that both recorded after settling."""
    return Comparison(
        difference=difference(coarse.settled(), fine.settled()),
        reliable=coarse.is_clean and fine.is_clean,
        local_order=_local_order(coarse.coupled, fine.coupled),
    )


def stated_error(comparisons: Sequence[Comparison], held: Collection[str] = ()) -> dict[str, float]:
    """Return per channel the coupling error of the finest run, in percent of the channel's scale.

    The error is the last difference divided by 2^p - 1. The order p is the smallest that the last comparisons showed,
    from the channel's differences and from the bonds' local errors. It is at least 0.38, at most 2 if the channel's
    differences were compared, else at most 1.5; 1 if nothing was observed. For a channel of `held` it is at most 1 if
    the channel's differences were compared, else at most 0.5.

    Args:
        comparisons: Comparisons of runs at steps that halve, the coarsest first; at least one.
        held: Components that hold their inputs, and all components coupled with them.
    """
    return {name: _stated(name, comparisons, held) for name in comparisons[-1].difference}


def _stated(name: str, comparisons: Sequence[Comparison], held: Collection[str]) -> float:
    differences = [c.difference.get(name, inf) for c in comparisons]
    last = differences[-1]
    if len(differences) > 1 and comparisons[-2].reliable and differences[-2] < inf:
        last = max(last, _LUCK * differences[-2])
    seen = _orders_seen(differences, comparisons)
    if name.partition(".")[0] in held:
        fastest = _OF_HELD if seen else _OF_HELD_UNSEEN
    else:
        fastest = _FASTEST if seen else _FASTEST_UNSEEN
    local = comparisons[-1].local_order if comparisons[-1].reliable else None
    order = min([*seen, *([] if local is None else [local])], default=1.0)
    return last / (float(2.0 ** min(max(order, _SLOWEST), fastest)) - 1.0)


def _orders_seen(differences: Sequence[float], comparisons: Sequence[Comparison]) -> list[float]:
    """Return the orders at which a channel's last differences fell, between comparisons that are reliable."""
    recent = list(zip(comparisons, differences, strict=True))[-3:]
    return [
        log2(before / after)
        for (coarser, before), (finer, after) in pairwise(recent)
        if coarser.reliable and finer.reliable and 0.0 < before < inf and after > 0.0
    ]


def _local_order(coarse: Mapping[str, Coupled], fine: Mapping[str, Coupled]) -> float | None:
    """Return the smallest order at which a bond's local error fell, among the errors that are not negligible."""
    pairs = [(coarse[name].percent, fine[name].percent) for name in fine if name in coarse]
    largest = max((after for _, after in pairs), default=0.0)
    orders = [log2(before / after) for before, after in pairs if after > _NEGLIGIBLE * largest and before > 0.0]
    return min(orders, default=None)
