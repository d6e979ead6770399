"""Blocks of the loop: a component's signals and C functions as arrays and addresses; marks for compiled functions."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache, lru_cache
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

# ---- Calls of FMI functions by their addresses, from Python through ctypes and from compiled code -------------------

Integers = NDArray[np.int64]

_POINTER, _SIZE, _REAL, _INT = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_double, ctypes.c_int
_BOOL = ctypes.c_bool

#: fmi2SetReal, fmi2GetReal; fmi2SetRealInputDerivatives; fmi2DoStep; fmi2GetFMUstate; fmi2SetFMUstate;
#: fmi2GetDirectionalDerivative.
EXCHANGE = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER, _SIZE, _POINTER)
SLOPES = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER, _SIZE, _POINTER, _POINTER)
STEP = ctypes.CFUNCTYPE(_INT, _POINTER, _REAL, _REAL, _INT)
STATE = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER)
DERIVE = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER, _SIZE, _POINTER, _SIZE, _POINTER, _POINTER)
#: fmi3SetFloat64, fmi3GetFloat64; fmi3DoStep; fmi3GetDirectionalDerivative.
EXCHANGE_SIZED = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER, _SIZE, _POINTER, _SIZE)
TAKE_STEP = ctypes.CFUNCTYPE(_INT, _POINTER, _REAL, _REAL, _BOOL, *[_POINTER] * 4)
DERIVE_SIZED = ctypes.CFUNCTYPE(_INT, _POINTER, *[_POINTER, _SIZE] * 4)


@lru_cache(maxsize=4096)
def _function(kind: Any, address: int) -> Any:
    return kind(address)


def _call(kind: Any, address: int, *arguments: float) -> int:
    """Call the function at an address; numbers of numpy become those of Python, which ctypes needs."""
    status: int = _function(kind, int(address))(*(x if isinstance(x, float) else int(x) for x in arguments))
    return status


def exchange(address: int, instance: int, references: int, count: int, values: int) -> int:
    """Set or get `count` Real variables; references and values are addresses."""
    return _call(EXCHANGE, address, instance, references, count, values)


def set_slopes(address: int, instance: int, references: int, count: int, orders: int, values: int) -> int:
    """Set first derivatives of inputs; references, orders and values are addresses."""
    return _call(SLOPES, address, instance, references, count, orders, values)


def do_step(address: int, instance: int, time: float, step: float, final: int) -> int:
    """Step from `time` by `step` [s]; `final` is 1 if no earlier state will be restored."""
    return _call(STEP, address, instance, time, step, final)


def call_state(address: int, instance: int, pointer: int) -> int:
    """Restore the state at the address `pointer`, or save it at the address that is there (0 at first), or free it."""
    return _call(STATE, address, instance, pointer)


def derive(
    address: int, instance: int, unknowns: int, sought: int, knowns: int, given: int, changes: int, result: int
) -> int:
    """Write how `sought` outputs change, without delay, with `given` inputs; all but the counts are addresses."""
    return _call(DERIVE, address, instance, unknowns, sought, knowns, given, changes, result)


def exchange_sized(address: int, instance: int, references: int, count: int, values: int, size: int) -> int:
    """Set or get `count` variables of FMI 3.0 with `size` values in total; references and values are addresses."""
    return _call(EXCHANGE_SIZED, address, instance, references, count, values, size)


def take_step(address: int, instance: int, time: float, step: float, final: int, flags: int, reached: int) -> int:
    """Step an instance of FMI 3.0; `flags` and `reached` are addresses of three bytes and of the time reached."""
    return _call(TAKE_STEP, address, instance, time, step, final, flags, flags + 1, flags + 2, reached)


def derive_sized(
    address: int, instance: int, unknowns: int, sought: int, knowns: int, given: int, changes: int, result: int
) -> int:
    """Do the same as `derive` for an instance of FMI 3.0, whose variables have one value each."""
    return _call(DERIVE_SIZED, address, instance, unknowns, sought, knowns, given, changes, given, result, sought)


def reference_at(address: int, index: int) -> int:
    """Return the value reference of this index in the array at the address."""
    return ctypes.c_uint32.from_address(address + 4 * index).value


def order_at(address: int, index: int) -> int:
    """Return the order of a derivative of this index in the array at the address."""
    return ctypes.c_int32.from_address(address + 4 * index).value


def real_at(address: int, index: int) -> float:
    """Return the real number of this index in the array at the address."""
    return ctypes.c_double.from_address(address + 8 * index).value


def put_real(address: int, index: int, value: float) -> None:
    """Write a real number to this index in the array at the address."""
    ctypes.c_double.from_address(int(address + 8 * index)).value = value


def put_byte(address: int, value: int) -> None:
    """Write a byte to the address."""
    ctypes.c_uint8.from_address(address).value = value


# ---- Blocks ---------------------------------------------------------------------------------------------------------

#: Numbers of integers and of real numbers that C functions of a block pass on, and the status of a failed call.
INTEGERS, REALS, FAILED = 6, 2, 3

#: Number of words in the table for each field: an address or a number, and the shape of an array.
WORDS = 3


class Block:
    """Named tuple with the table that compiled code reads; it keeps the arrays alive.

    Args:
        content: Named tuple of contiguous arrays of one or two dimensions, of integers, floats, and of such tuples.
    """

    def __init__(self, content: Any) -> None:
        self.content = content
        self.parts = [Block(value) if isinstance(value, tuple) else value for value in content]
        self.table = np.array([word for value in self.parts for word in _words(value)], dtype=np.int64)
        self.address = _address(self.table)
        self.kind: Kind = (type(content), tuple(map(_kind, self.parts)))


#: Properties of a value that machine code depends on: for a named tuple its type and the kinds of its fields, for an
#: array its type code and number of dimensions, or int or float.
Kind = Any


@cache
def described(kind: Kind) -> str:
    """Return the text of a kind, with the names of its fields; it is part of the key of stored machine code."""
    if kind in (float, int):
        return str(kind.__name__)
    what, parts = kind
    if isinstance(what, str):
        return f"{what}{parts}"
    return f"{what.__name__}({', '.join(f'{f}: {described(k)}' for f, k in zip(what._fields, parts, strict=True))})"


def _kind(value: Any) -> Kind:
    if isinstance(value, np.ndarray):
        return value.dtype.char, value.ndim
    return value.kind if isinstance(value, Block) else float if isinstance(value, float) else int


def _address(array: Any) -> int:
    """Return the address of an array; faster than array.ctypes.data."""
    address: int = array.__array_interface__["data"][0]
    return address


def _words(value: Any) -> tuple[int, ...]:
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise ValueError("a block's arrays must be contiguous")
        return _address(value), *value.shape, *(0 for _ in range(WORDS - 1 - value.ndim))
    if isinstance(value, Block):
        return value.address, 0, 0
    number = np.float64(value).view(np.int64) if isinstance(value, float) else value
    return int(number), 0, 0


# ==== Machine code for functions of the loop: compiled by numba once per machine, stored on disk, called withou ======

Function = TypeVar("Function", bound=Callable[..., Any])

#: All functions that compiled code calls.
SHARED: list[Callable[..., Any]] = []


def shared(function: Function) -> Function:
    """Mark a function that is also called by compiled code."""
    SHARED.append(function)
    return function
