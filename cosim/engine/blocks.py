"""Blocks: named tuples of arrays in the form that compiled code uses, one address of a table of addresses.

Passing the tuples themselves would give every function about a hundred arguments, which takes half a minute to compile.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

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
