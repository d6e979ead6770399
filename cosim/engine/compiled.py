"""The same functions as machine code: lowered by numba once on a machine, kept on disk, called without the GIL.

`shared` marks a function of the loop, which also stays what it is: plain Python, the same bits, slower. numba itself is
loaded only where there is no machine code yet, because that takes longer than most runs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any, TypeVar

from cosim.engine.blocks import Block

Function = TypeVar("Function", bound=Callable[..., Any])
Bind = Callable[..., Callable[..., int]]

#: All functions that compiled code calls.
SHARED: list[Callable[..., Any]] = []


def shared(function: Function) -> Function:
    """Mark a function that compiled code calls too."""
    SHARED.append(function)
    return function


def can_compile() -> bool:
    """Return whether numba is installed."""
    try:
        return find_spec("numba") is not None
    except ValueError:  # what stands in its place is no module
        return False


def bound(function: Callable[..., int]) -> Bind:
    """Return what takes a function's named tuples and returns the function of the other arguments."""
    return lambda *tuples: partial(function, *tuples)


def compiled(function: Callable[..., int], instead: dict[str, Callable[..., int]] | None = None) -> Bind:
    """The same as machine code; the named tuples become blocks, the other arguments are integers.

    Args:
        function: A function of the loop.
        instead: By name of a function that is called, the one that takes its place.
    """

    def bind(*tuples: Any) -> Callable[..., int]:
        from cosim.engine.machine_code import machine_code  # noqa: PLC0415 -- where numba is not installed

        blocks = tuple(map(Block, tuples))
        machine = machine_code(function, tuple(block.kind for block in blocks), instead or {})
        return lambda *numbers: machine(*(block.address for block in blocks), *numbers)

    return bind
