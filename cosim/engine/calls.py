"""Calls of FMI functions by their addresses, from Python through ctypes and from compiled code directly.

Every function returns the FMI status: 0 OK, 1 warning, 2 discard, 3 error, 4 fatal. Addresses are integers; they point
to references as uint32, orders as int32, values as float64.
"""

from __future__ import annotations

import ctypes
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

Integers = NDArray[np.int64]

_POINTER, _SIZE, _REAL, _INT = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_double, ctypes.c_int

#: fmi2SetReal, fmi2GetReal; fmi2SetRealInputDerivatives; fmi2DoStep; fmi2GetFMUstate; fmi2SetFMUstate.
EXCHANGE = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER, _SIZE, _POINTER)
SLOPES = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER, _SIZE, _POINTER, _POINTER)
STEP = ctypes.CFUNCTYPE(_INT, _POINTER, _REAL, _REAL, _INT)
SAVE = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER)
RESTORE = ctypes.CFUNCTYPE(_INT, _POINTER, _POINTER)


@lru_cache(maxsize=4096)
def _function(kind: Any, address: int) -> Any:
    return kind(address)


def exchange(address: int, instance: int, references: int, count: int, values: int) -> int:
    """Set or get `count` Real variables; references and values are addresses."""
    status: int = _function(EXCHANGE, int(address))(int(instance), int(references), int(count), int(values))
    return status


def set_slopes(address: int, instance: int, references: int, count: int, orders: int, values: int) -> int:
    """Set first derivatives of inputs; references, orders and values are addresses."""
    status: int = _function(SLOPES, int(address))(int(instance), int(references), int(count), int(orders), int(values))
    return status


def do_step(address: int, instance: int, time: float, step: float, final: int) -> int:
    """Step from `time` by `step` [s]; `final` is 1 if no earlier state will be restored."""
    status: int = _function(STEP, int(address))(int(instance), time, step, final)
    return status


def save_state(address: int, instance: int, states: Integers, index: int) -> int:
    """Save the state into states[index], a pointer that the FMU provides (0 at first)."""
    status: int = _function(SAVE, int(address))(int(instance), states.ctypes.data + 8 * int(index))
    return status


def restore_state(address: int, instance: int, states: Integers, index: int) -> int:
    """Restore the state that states[index] points to."""
    status: int = _function(RESTORE, int(address))(int(instance), int(states[index]))
    return status
