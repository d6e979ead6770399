"""Coupling error of a run, estimated from how differences between runs fall as the step halves (docs/coupling.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, log2

from cosim.difference import difference
from cosim.result import Coupled, Result

#: Smallest order that the error is assumed to have [1].
_SLOWEST = 0.38

#: Largest order that the error is assumed to have, whatever was observed [1]: a difference may fall fast by chance.
_FASTEST = 1.5

#: A difference counts at least as this share of the one before [1]: it may be small by chance.
_LUCK = 1.0 / 8.0

#: Local errors below this share of the largest say nothing about the order [1].
_NEGLIGIBLE = 1e-2


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two runs, the finer one at half the step of the coarser.

    Args:
        difference: Difference of both runs per channel, in percent of its scale.
        reliable: Whether both runs passed the check of their bonds' local errors.
        local_order: Order at which the bonds' local errors fell from one run to the other [1]; None without bonds.
    """

    difference: Mapping[str, float]
    reliable: bool
    local_order: float | None


def compare(coarse: Result, fine: Result) -> Comparison:
    """Compare two runs of one system at all times that both recorded after settling."""
    return Comparison(
        difference=difference(coarse.settled(), fine.settled()),
        reliable=coarse.is_clean and fine.is_clean,
        local_order=_local_order(coarse.coupled, fine.coupled),
    )


def stated_error(comparisons: Sequence[Comparison]) -> dict[str, float]:
    """Return per channel the coupling error of the finest run, in percent of the channel's scale.

    The last difference over 2^p - 1. The order p is the smallest that was observed in the last comparisons, of the
    channel's differences and of the bonds' local errors, within 0.38 and 1.5; it is 1 where none was observed.

    Args:
        comparisons: Of runs at steps that halve from one to the next, the coarsest first; at least one.
    """
    return {name: _stated(name, comparisons) for name in comparisons[-1].difference}


def _stated(name: str, comparisons: Sequence[Comparison]) -> float:
    differences = [c.difference.get(name, inf) for c in comparisons]
    last = differences[-1]
    if len(differences) > 1 and differences[-2] < inf:
        last = max(last, _LUCK * differences[-2])
    return last / (float(2.0 ** _order(differences, comparisons)) - 1.0)


def _order(differences: Sequence[float], comparisons: Sequence[Comparison]) -> float:
    """The order that the error is taken to have."""
    recent = list(zip(comparisons, differences, strict=True))[-3:]
    observed = [
        log2(before / after)
        for (coarser, before), (finer, after) in pairwise(recent)
        if coarser.reliable and finer.reliable and 0.0 < before < inf and after > 0.0
    ]
    if comparisons[-1].reliable and comparisons[-1].local_order is not None:
        observed.append(comparisons[-1].local_order)
    return min(max(min(observed, default=1.0), _SLOWEST), _FASTEST)


def _local_order(coarse: Mapping[str, Coupled], fine: Mapping[str, Coupled]) -> float | None:
    """The smallest order at which a bond's local error fell, among those that are not negligible."""
    pairs = [(coarse[name].percent, fine[name].percent) for name in fine if name in coarse]
    largest = max((after for _, after in pairs), default=0.0)
    orders = [log2(before / after) for before, after in pairs if after > _NEGLIGIBLE * largest and before > 0.0]
    return min(orders, default=None)
