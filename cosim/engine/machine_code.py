"""Machine code for functions of the loop: compiled once per machine, stored on disk, loaded once per process."""

from __future__ import annotations

import ctypes
import hashlib
import threading
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path

from cosim.engine.blocks import Kind, described
from cosim.engine.processor import description, loaded
from eightpost.cache import keep, recall

#: Folder of the cache, and the number of files in it.
_FOLDER, _KEPT = "loop", 40

_FUNCTIONS: dict[str, Callable[..., int]] = {}
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
    key = _key(function.__name__, *map(described, kinds), *(f"{name}: {f.__name__}" for name, f in instead.items()))
    with _ONE_AT_A_TIME:
        if key not in _FUNCTIONS:
            content = recall(_FOLDER, key)
            if content is None:
                from cosim.engine.lowering import Request, object_file  # noqa: PLC0415 -- rarely needed

                content = object_file(Request(function, kinds, count - len(kinds), instead))
                keep(_FOLDER, key, content, most=_KEPT)
            _FUNCTIONS[key] = _callable(loaded(content), count)
    return _FUNCTIONS[key]


def _callable(address: int, count: int) -> Callable[..., int]:
    """Return a function of integers in numba's calling convention, with results and errors through pointers."""
    call = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *[ctypes.c_int64] * count)(address)

    def function(*arguments: int) -> int:
        returned, raised = ctypes.c_int64(), ctypes.c_void_p()
        if call(ctypes.addressof(returned), ctypes.addressof(raised), *arguments):
            raise ArithmeticError("the compiled loop divided by zero")
        return returned.value

    return function


def _key(*what: str) -> str:
    """Return a digest of everything that machine code depends on."""
    parts = (*what, _sources(), version("numba"), version("llvmlite"), *description())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


@cache
def _sources() -> str:
    """Return a digest of all sources of the loop."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
