"""Map a function over items in threads; the filters, transforms and decompositions used here release the GIL."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

from threadpoolctl import threadpool_limits

from eightpost.progress import beat
from eightpost.workers.process import usable_processors

#: Interval at which progress is reported [s].
_INTERVAL = 0.05

Item = TypeVar("Item")
Found = TypeVar("Found")


def for_each(items: Iterable[Item], function: Callable[[Item], Found]) -> list[Found]:
    """Return the results of a function for all items, in their order.

    Linear algebra is limited to one thread per item, because several calls that each use all processors slow down.

    Args:
        items: Items to process.
        function: Function of one item; it must not change data that other items use.
    """
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(usable_processors()) as pool:
        running = [pool.submit(function, item) for item in items]
        while wait(running, timeout=_INTERVAL).not_done:
            beat()
        return [future.result() for future in running]
