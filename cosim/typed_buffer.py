"""Buffers for the values of an FMU's variables: FMI has separate functions for each type."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

#: Name of the FMI functions for a type, and the C type of its values.
_KINDS: Mapping[str, tuple[str, Any]] = {
    "Real": ("Real", ctypes.c_double),
    "Integer": ("Integer", ctypes.c_int),
    "Enumeration": ("Integer", ctypes.c_int),
    "Boolean": ("Boolean", ctypes.c_int),
}


@dataclass(frozen=True, slots=True)
class TypedBuffer:
    """Values of one type, with the references of their variables.

    Args:
        kind: Real, Integer or Boolean, as in fmi2GetReal.
        places: Positions of the values among all requested values.
        references: Value references (C array).
        buffer: Values (C array).
    """

    kind: str
    places: tuple[int, ...]
    references: Any
    buffer: Any

    def number(self, value: float) -> float | int:
        """Return a value converted to the type of the buffer."""
        if self.kind == "Real":
            return value
        return int(value != 0.0) if self.kind == "Boolean" else round(value)


def typed_buffers(
    names: Sequence[str], types: Mapping[str, str], references: Mapping[str, int]
) -> tuple[TypedBuffer, ...]:
    """Return one buffer for each type of function that the names need.

    Args:
        names: Names of the variables.
        types: Types of the variables; String is not supported.
        references: Value references of the variables.
    """
    places: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        places.setdefault(_KINDS[types[name]][0], []).append(place)
    buffers = []
    for kind, own in places.items():
        array = (ctypes.c_uint * len(own))(*[references[names[place]] for place in own])
        buffers.append(TypedBuffer(kind, tuple(own), array, (_KINDS[kind][1] * len(own))()))
    return tuple(buffers)
