"""A named tuple of arrays as compiled code sees it: one address of a table of addresses.

Passing the tuples themselves would mean some hundred arguments to every function, which takes half a minute to compile.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, lower_getattr_generic, models, register_model, typeof_impl, unbox
from numba.np import arrayobj
from numba.np.numpy_support import from_dtype

#: Words of the table for each field: an address or a number, and an array's shape.
_WORDS = 3


class Block:
    """A named tuple with the table that compiled code reads; it keeps the arrays alive.

    Args:
        content: A named tuple of contiguous arrays of one or two dimensions, of integers, floats, and of such tuples.
    """

    def __init__(self, content: Any) -> None:
        self.content = content
        self.parts = [Block(value) if isinstance(value, tuple) else value for value in content]
        self.table = np.array([word for value in self.parts for word in _words(value)], dtype=np.int64)
        self.address = _address(self.table)
        self.make = (type(content), tuple(map(_make, self.parts)))
        self.kind: BlockType = _kind_of(self.make)


class BlockType(types.Type):
    """The type of a block: its fields' names and types."""

    def __init__(self, name: str, fields: tuple[tuple[str, Any], ...]) -> None:
        self.fields = fields
        super().__init__(name=f"{name}({', '.join(f'{field}: {kind}' for field, kind in fields)})")


@register_model(BlockType)
class _BlockModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, ir.IntType(64))


@typeof_impl.register(Block)
def _type_of(block: Block, _context: Any) -> BlockType:
    return block.kind


@unbox(BlockType)
def _unbox(_kind: Any, block: Any, c: Any) -> Any:
    address = c.pyapi.object_getattr_string(block, "address")
    value = c.pyapi.long_as_longlong(address)
    c.pyapi.decref(address)
    return numba.extending.NativeValue(value)


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    key = BlockType

    def generic_resolve(self, kind: BlockType, name: str) -> Any:
        return dict(kind.fields).get(name)


@lower_getattr_generic(BlockType)
def _get(context: Any, builder: Any, kind: BlockType, address: Any, name: str) -> Any:
    index = [field for field, _ in kind.fields].index(name)
    field = kind.fields[index][1]
    word = ir.IntType(64)
    table = builder.inttoptr(address, word.as_pointer())

    def load(k: int) -> Any:
        """The table does not change while compiled code runs, so that a word need not be loaded again."""
        value = builder.load(builder.gep(table, [word(_WORDS * index + k)]))
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value

    if isinstance(field, types.Array):
        return _array(context, builder, field, load)
    return builder.bitcast(load(0), ir.DoubleType()) if isinstance(field, types.Float) else load(0)


def _array(context: Any, builder: Any, kind: Any, load: Any) -> Any:
    size = context.get_constant(types.intp, context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    shape = [load(1 + axis) for axis in range(kind.ndim)]
    strides = [size] if kind.ndim == 1 else [builder.mul(size, shape[1]), size]
    array = arrayobj.make_array(kind)(context, builder)
    arrayobj.populate_array(
        array,
        data=builder.inttoptr(load(0), context.get_data_type(kind.dtype).as_pointer()),
        shape=cgutils.pack_array(builder, shape),
        strides=cgutils.pack_array(builder, strides),
        itemsize=size,
        meminfo=None,
    )
    return array._getvalue()


def _make(value: Any) -> Any:
    """What a value's type follows from; numba's own types take long to compare."""
    if isinstance(value, np.ndarray):
        return value.dtype.char, value.ndim
    return value.make if isinstance(value, Block) else float if isinstance(value, float) else int


@cache
def _kind_of(make: Any) -> Any:
    if make in (float, int):
        return types.float64 if make is float else types.int64
    what, parts = make
    if isinstance(what, str):
        return types.Array(from_dtype(np.dtype(what)), parts, "C")
    return BlockType(what.__name__, tuple(zip(what._fields, map(_kind_of, parts), strict=True)))


def _address(array: Any) -> int:
    """The same as array.ctypes.data, which takes much longer."""
    address: int = array.__array_interface__["data"][0]
    return address


def _words(value: Any) -> tuple[int, ...]:
    if isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise ValueError("a block's arrays must be contiguous")
        return _address(value), *value.shape, *(0 for _ in range(_WORDS - 1 - value.ndim))
    if isinstance(value, Block):
        return value.address, 0, 0
    number = np.float64(value).view(np.int64) if isinstance(value, float) else value
    return int(number), 0, 0
