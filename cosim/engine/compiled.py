"""Machine code for functions of the loop: compiled by numba once per machine, stored on disk, called without the GIL.

`shared` marks a function of the loop, which remains a plain Python function with equal results, only slower. numba
itself is imported only if no machine code is stored yet, because the import takes longer than most runs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from cosim.engine.blocks import Block

Function = TypeVar("Function", bound=Callable[..., Any])
Bind = Callable[..., Callable[..., int]]

#: All functions that compiled code calls.
SHARED: list[Callable[..., Any]] = []


def shared(function: Function) -> Function:
    """Mark a function that is also called by compiled code."""
    SHARED.append(function)
    return function


def bound(function: Callable[..., int]) -> Bind:
    """Return a function that takes the named tuples of `function` and returns a function of its other arguments."""
    return lambda *tuples: partial(function, *tuples)


def compiled(function: Callable[..., int], instead: dict[str, Callable[..., int]]) -> Bind:
    """Return the same as machine code; the named tuples become blocks, the other arguments are integers.

    Args:
        function: Function of the loop.
        instead: Replacements of called functions, by name.
    """

    def bind(*tuples: Any) -> Callable[..., int]:
        from cosim.engine.machine_code import machine_code  # noqa: PLC0415 -- LLVM, which the interpreted loop does not need

        blocks = tuple(map(Block, tuples))
        machine = machine_code(function, tuple(block.kind for block in blocks), instead)
        return lambda *numbers: machine(*(block.address for block in blocks), *numbers)

    return bind
