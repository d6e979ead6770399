"""Machine code for functions of the loop: made once per machine for its processor, loaded once per process."""

from __future__ import annotations

import pickle
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

from cosim.engine.blocks import INTEGERS, REALS, Kind, described
from eightpost.object_code.native import function_at, loaded_entries
from eightpost.object_code.stored import code_key, compiled_by, stored

# ---- Compilation in a process of its own ----------------------------------------------------------------------------


class Request(NamedTuple):
    """Request for machine code."""

    function: Callable[..., int]  #: Function of the loop.
    kinds: tuple[Kind, ...]  #: Kinds of its first arguments, which are blocks.
    numbers: int  #: Number of integer arguments that follow.
    instead: dict[str, Callable[..., int]]  #: Replacements of called functions, by name.
    reals: int = 0  #: Number of real arguments after these.
    #: Kinds of the arguments of C functions that call the function with their number, by name; None adds no functions.
    entries: Mapping[str, tuple[str, ...]] | None = None


def object_file(request: Request) -> bytes:
    """Return an object file with the function, compiled in a separate process.

    Raises:
        RuntimeError: numba or LLVM failed.
    """
    try:
        return compiled_by("cosim.engine.lowering", pickle.dumps(request), bare="cosim")
    except RuntimeError as error:
        name = request.function.__name__
        raise RuntimeError(f"{name} could not be compiled; engine='python' needs no compiler: {error}") from error


# ---- Functions, compiled once per machine ---------------------------------------------------------------------------

_FUNCTIONS: dict[str, Callable[..., int]] = {}
_ADDRESSES: dict[str, dict[str, int]] = {}
_ONE_AT_A_TIME = threading.Lock()


def machine_code(
    function: Callable[..., int], kinds: tuple[Kind, ...], instead: dict[str, Callable[..., int]]
) -> Callable[..., int]:
    """Return a function that takes the addresses of the blocks, and integers.

    Args:
        function: Function of the loop.
        kinds: Kinds of its first arguments, which are blocks; the others are integers.
        instead: Replacements of called functions, by name.

    Raises:
        RuntimeError: The function could not be compiled.
    """
    count = function.__code__.co_argcount
    replaced = (f"{name}: {other.__name__}" for name, other in instead.items())
    key = code_key(Path(__file__).parent, function.__name__, *map(described, kinds), *replaced)
    with _ONE_AT_A_TIME:
        if key not in _FUNCTIONS:
            content = stored(key, lambda: object_file(Request(function, kinds, count - len(kinds), instead)))
            _FUNCTIONS[key] = function_at(loaded_entries(content)[0], count)
    return _FUNCTIONS[key]


def c_functions(function: Callable[..., int], kind: Kind, entries: Mapping[str, tuple[str, ...]]) -> dict[str, int]:
    """Return the addresses of C functions that call a function of a block, by name.

    Args:
        function: Function of a block, the number of the C function, `INTEGERS` integers and `REALS` real numbers.
        kind: Kind of the block.
        entries: Kinds of the arguments of each C function, by name: "pointer", "size", "int", "byte", "real". The first
            one is the address of the block.

    Raises:
        RuntimeError: The functions could not be compiled.
    """
    key = code_key(Path(__file__).parent, function.__name__, described(kind), str(entries))
    with _ONE_AT_A_TIME:
        if key not in _ADDRESSES:
            content = stored(key, lambda: object_file(Request(function, (kind,), 1 + INTEGERS, {}, REALS, entries)))
            _ADDRESSES[key] = dict(zip(entries, loaded_entries(content, tuple(entries)), strict=True))
    return _ADDRESSES[key]
