"""Machine code for a function of the loop: lowered by numba, optimised by LLVM for this processor.

This module is the program that `machine_code.object_file` runs: the request is pickled on standard input, the object
file goes to standard output. It has its own process because numba's optimisation must be switched off for the whole
process: numba would optimise every function with all functions that it calls, and again in each of its callers, which
triples the time. The blocks of the loop are types of numba, and FMI functions are called at their addresses.
"""

from __future__ import annotations

import hashlib
import pickle
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_getattr_generic, models, overload, register_model
from numba.np import arrayobj
from numba.np.numpy_support import from_dtype

from cosim.engine import blocks
from cosim.engine.blocks import WORDS, Kind, described
from cosim.engine.compiled import SHARED
from cosim.engine.machine_code import Request, optimised

# ---- Blocks as types of numba ---------------------------------------------------------------------------------------


class _BlockType(types.Type):
    """Type of a block: names and types of its fields."""

    def __init__(self, name: str, fields: dict[str, Any]) -> None:
        self.fields = fields
        super().__init__(name=name)


@register_model(_BlockType)
class _BlockModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, ir.IntType(64))


@cache
def _block_type(kind: Kind) -> Any:
    """Return numba's type for a block or for a field of one."""
    if kind in (float, int):
        return types.float64 if kind is float else types.int64
    what, parts = kind
    if isinstance(what, str):
        return types.Array(from_dtype(np.dtype(what)), parts, "C")
    # A short name, because numba writes it into every symbol and compares types by it.
    name = f"{what.__name__}_{hashlib.sha256(described(kind).encode()).hexdigest()[:8]}"
    return _BlockType(name, dict(zip(what._fields, map(_block_type, parts), strict=True)))


@infer_getattr
class _Attributes(AttributeTemplate):  # type: ignore[misc]
    key = _BlockType

    def generic_resolve(self, kind: _BlockType, name: str) -> Any:
        return kind.fields.get(name)


@lower_getattr_generic(_BlockType)
def _get(context: Any, builder: Any, kind: _BlockType, address: Any, name: str) -> Any:
    index, field = list(kind.fields).index(name), kind.fields[name]
    word = ir.IntType(64)
    table = builder.inttoptr(address, word.as_pointer())

    def load(k: int) -> Any:
        """Load a word as invariant: the table does not change while compiled code runs."""
        value = builder.load(builder.gep(table, [word(WORDS * index + k)]))
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


# ---- Calls of FMI functions -----------------------------------------------------------------------------------------

_WORD, _POINTER, _REAL, _INT = ir.IntType(64), ir.IntType(8).as_pointer(), ir.DoubleType(), ir.IntType(32)
_LLVM = {"pointer": _POINTER, "size": _WORD, "real": _REAL, "int": _INT}


def _call(kinds: tuple[str, ...]) -> Any:
    """Return a code generator for a call of the function at the first argument with the other arguments."""

    def codegen(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_INT, [_LLVM[k] for k in kinds])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        values = []
        for what, argument in zip(kinds, arguments[1:], strict=True):
            if what == "pointer":
                values.append(builder.inttoptr(argument, _POINTER))
            else:
                values.append(builder.trunc(argument, _INT) if what == "int" else argument)
        return builder.sext(builder.call(function, values), _WORD)

    return codegen


def _signature(kinds: tuple[str, ...]) -> Any:
    return types.int64(types.int64, *(types.float64 if k == "real" else types.int64 for k in kinds))


_EXCHANGE, _SLOPES = ("pointer", "pointer", "size", "pointer"), ("pointer", "pointer", "size", "pointer", "pointer")
_STEP, _STATE = ("pointer", "real", "real", "int"), ("pointer", "pointer")


@intrinsic
def _call_exchange(_context, address, instance, references, count, values):  # type: ignore[no-untyped-def]
    return _signature(_EXCHANGE), _call(_EXCHANGE)


@intrinsic
def _call_slopes(_context, address, instance, references, count, orders, values):  # type: ignore[no-untyped-def]
    return _signature(_SLOPES), _call(_SLOPES)


@intrinsic
def _call_step(_context, address, instance, time, step, final):  # type: ignore[no-untyped-def]
    return _signature(_STEP), _call(_STEP)


@intrinsic
def _call_state(_context, address, instance, pointer):  # type: ignore[no-untyped-def]
    return _signature(_STATE), _call(_STATE)


@overload(blocks.exchange)
def _exchange(address, instance, references, count, values):  # type: ignore[no-untyped-def]
    def implementation(address, instance, references, count, values):  # type: ignore[no-untyped-def]
        return _call_exchange(address, instance, references, count, values)

    return implementation


@overload(blocks.set_slopes)
def _set_slopes(address, instance, references, count, orders, values):  # type: ignore[no-untyped-def]
    def implementation(address, instance, references, count, orders, values):  # type: ignore[no-untyped-def]
        return _call_slopes(address, instance, references, count, orders, values)

    return implementation


@overload(blocks.do_step)
def _do_step(address, instance, time, step, final):  # type: ignore[no-untyped-def]
    def implementation(address, instance, time, step, final):  # type: ignore[no-untyped-def]
        return _call_step(address, instance, time, step, final)

    return implementation


@overload(blocks.save_state)
def _save_state(address, instance, states, index):  # type: ignore[no-untyped-def]
    def implementation(address, instance, states, index):  # type: ignore[no-untyped-def]
        return _call_state(address, instance, states.ctypes.data + 8 * index)

    return implementation


@overload(blocks.restore_state)
def _restore_state(address, instance, states, index):  # type: ignore[no-untyped-def]
    def implementation(address, instance, states, index):  # type: ignore[no-untyped-def]
        return _call_state(address, instance, states[index])

    return implementation


# ---- The program ----------------------------------------------------------------------------------------------------


def main() -> None:
    """Process one request."""
    request: Request = pickle.load(sys.stdin.buffer)
    sys.stdout.buffer.write(optimised(*_lowered(request)))


def _lowered(request: Request) -> tuple[str, str]:
    """Return the intermediate code of a function with all functions that it calls, and its name in the code."""
    _register(SHARED, request.instead)
    signature = (*map(_block_type, request.kinds), *[numba.int64] * request.numbers)
    machine: Any = numba.njit(nogil=True, _nrt=False)(request.function)
    machine.compile(signature)
    return machine.inspect_llvm(signature), machine.overloads[signature].fndesc.llvm_func_name


def _register(functions: Sequence[Callable[..., Any]], instead: dict[str, Callable[..., int]]) -> None:
    """Make the marked functions callable from compiled code."""
    options = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    for function in functions:
        taken = instead.get(function.__name__, function)
        overload(function, jit_options=options, strict=False)(lambda *_, taken=taken: taken)


if __name__ == "__main__":
    main()
