"""Computation of items."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from importlib import import_module

from dissertation.effort import FULL, Effort
from dissertation.findings import Findings, Outcome
from dissertation.item import Item
from eightpost.errors import EightpostError

#: Function that computes an item.
Computation = Callable[[Effort], Findings]

#: Modules with the computations of each chapter, each with a table `COMPUTATIONS` by the name of the item.
_MODULES = {
    3: ("chapter_3_theory", "chapter_3_tests", "chapter_3_fits"),
    4: ("chapter_4_model", "chapter_4_identification", "chapter_4_rig"),
    5: ("chapter_5_model", "chapter_5_identification"),
    6: ("chapter_6_setup", "chapter_6_linearity", "chapter_6_identification", "chapter_6_validation"),
    7: ("chapter_7", "chapter_7_bank"),
}


@cache
def computations(chapter: int) -> Mapping[str, Computation]:
    """Return the computations of a chapter by the name of the item; it loads the numerical libraries."""
    found: dict[str, Computation] = {}
    for module in _MODULES[chapter]:
        found |= import_module(f"{__package__}.{module}").COMPUTATIONS
    return found


def reproduce(items: Iterable[Item], effort: Effort = FULL) -> Iterator[Outcome]:
    """Compute items one by one.

    Items share records and fits, which are computed when the first item needs them.

    Args:
        items: Items to reproduce.
        effort: Lengths of the records and numbers of setups.

    Yields:
        Outcome of each item; an error of a computation is its outcome.
    """
    for item in items:
        yield _outcome(item, effort)


def _outcome(item: Item, effort: Effort) -> Outcome:
    if not item.is_computed:
        return Outcome(item)
    started = time.perf_counter()
    try:
        found = computations(item.chapter)[item.name](effort)
    except EightpostError as error:
        return Outcome(item, seconds=time.perf_counter() - started, error=str(error))
    return Outcome(item, found, time.perf_counter() - started)
