"""Memory for the values of an FMU's variables: FMI gets and sets those of each type by a function of its own."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

#: The functions' names for a type, and the C type of its values.
_KINDS: Mapping[str, tuple[str, Any]] = {
    "Real": ("Real", ctypes.c_double),
    "Integer": ("Integer", ctypes.c_int),
    "Enumeration": ("Integer", ctypes.c_int),
    "Boolean": ("Boolean", ctypes.c_int),
}


@dataclass(frozen=True, slots=True)
class TypedBuffer:
    """Values of one type.

    Args:
        kind: Real, Integer or Boolean, as in fmi2GetReal.
        places: Positions of the values among all that are asked for.
        references: Value references, a C array.
        buffer: Values, a C array.
    """

    kind: str
    places: tuple[int, ...]
    references: Any
    buffer: Any

    def number(self, value: float) -> float | int:
        """Return a value as the buffer takes it."""
        if self.kind == "Real":
            return value
        return int(value != 0.0) if self.kind == "Boolean" else round(value)


def typed_buffers(
    names: Sequence[str], types: Mapping[str, str], references: Mapping[str, int]
) -> tuple[TypedBuffer, ...]:
    """Return one buffer for each kind of function that the names need.

    Args:
        names: Variables.
        types: Their types, of which String is none.
        references: Their value references.
    """
    places: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        places.setdefault(_KINDS[types[name]][0], []).append(place)
    found = []
    for kind, own in places.items():
        array = (ctypes.c_uint * len(own))(*[references[names[place]] for place in own])
        found.append(TypedBuffer(kind, tuple(own), array, (_KINDS[kind][1] * len(own))()))
    return tuple(found)
