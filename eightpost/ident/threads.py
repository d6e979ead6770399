"""The same for many, in threads: filters, transforms and decompositions, which take the time here, let others run."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from threadpoolctl import threadpool_limits

from eightpost.processors import usable_processors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

Item = TypeVar("Item")
Found = TypeVar("Found")


def for_each(items: Iterable[Item], function: Callable[[Item], Found]) -> list[Found]:
    """Return what a function makes of each item, in their order.

    Linear algebra stays in the thread that asks for it: several that use all processors each would wait for each other.

    Args:
        items: What there is.
        function: What is made of it; it changes nothing that others look at.
    """
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(usable_processors()) as pool:
        return list(pool.map(function, items))
