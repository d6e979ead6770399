"""Machine code for a function of the loop: lowered by numba, optimised by LLVM for this processor.

This module is the program that `machine_code.object_file` runs: the request is pickled on standard input, the object
file goes to standard output. The blocks of the loop are types of numba; FMI functions are called at their addresses.
"""

from __future__ import annotations

import gc
import hashlib
import inspect
import pickle
import sys
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np

from cosim.engine import blocks
from cosim.engine.blocks import FAILED, INTEGERS, REALS, SHARED, WORDS, Kind, described
from cosim.engine.machine_code import Request
from eightpost.extras import needs
from eightpost.object_code.native import optimised

with needs("fit", "machine code of the loop"):
    import numba
    from llvmlite import ir
    from numba.core import cgutils, types
    from numba.core.codegen import JITCodeLibrary
    from numba.core.cpu import CPUContext
    from numba.core.typing.templates import AttributeTemplate
    from numba.extending import (
        infer_getattr,
        lower_builtin,
        lower_getattr_generic,
        models,
        overload,
        register_model,
        type_callable,
    )
    from numba.np import arrayobj
    from numba.np.numpy_support import from_dtype

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


# ---- Calls of FMI functions, and numbers at addresses ---------------------------------------------------------------

_WORD, _POINTER, _REAL, _INT = ir.IntType(64), ir.IntType(8).as_pointer(), ir.DoubleType(), ir.IntType(32)
_LLVM = {"pointer": _POINTER, "size": _WORD, "real": _REAL, "int": _INT, "byte": ir.IntType(8)}

_EXCHANGE, _STATE = ("pointer", "pointer", "size", "pointer"), ("pointer", "pointer")

#: Arguments of the C functions behind functions of `blocks`, which are called at their first argument.
_CALLS: dict[Callable[..., Any], tuple[str, ...]] = {
    blocks.exchange: _EXCHANGE,
    blocks.set_slopes: (*_EXCHANGE, "pointer"),
    blocks.do_step: ("pointer", "real", "real", "int"),
    blocks.call_state: _STATE,
    blocks.derive: ("pointer", "pointer", "size", "pointer", "size", "pointer", "pointer"),
    blocks.exchange_sized: (*_EXCHANGE, "size"),
    blocks.derive_sized: ("pointer", *("pointer", "size") * 4),
    blocks.take_step: ("pointer", "real", "real", "int", "pointer", "pointer", "pointer", "pointer"),
}

#: Order of the C function's arguments, where it differs: the number of an argument, and what is added to it.
_ORDERS: dict[Callable[..., Any], tuple[tuple[int, int], ...]] = {
    blocks.derive_sized: ((0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (5, 0), (4, 0), (6, 0), (2, 0)),
    blocks.take_step: ((0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (4, 1), (4, 2), (5, 0)),
}

#: Types of the numbers that functions of `blocks` read from an array at an address.
_READS: dict[Callable[..., Any], Any] = {
    blocks.reference_at: types.uint32,
    blocks.order_at: types.int32,
    blocks.real_at: types.float64,
}


def _declare(function: Callable[..., Any], signature: Any, generate: Callable[..., Any]) -> None:
    """Let compiled code use `generate` (of a builder and arguments) for a function; arguments are cast to its types."""

    def typer(*_arguments: Any) -> Any:
        return signature

    typer.pysig = inspect.signature(function)  # type: ignore[attr-defined]  # numba takes the arguments' names from it
    type_callable(function)(lambda _context: typer)
    lower_builtin(function, *signature.args)(generate)


def _call(kinds: tuple[str, ...], order: Sequence[tuple[int, int]]) -> Callable[..., Any]:
    """Return a code generator for a call of the function at the first argument with the other arguments."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_INT, [_LLVM[k] for k in kinds])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        values = []
        for what, (place, more) in zip(kinds, order, strict=True):
            value = arguments[1 + place]
            value = builder.add(value, _WORD(more)) if more else value
            if what == "pointer":
                value = builder.inttoptr(value, _POINTER)
            values.append(builder.trunc(value, _INT) if what == "int" else value)
        return builder.sext(builder.call(function, values), _WORD)

    return generate


def _load(kind: Any) -> Callable[..., Any]:
    """Return a code generator that reads a number of this type from an array at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = builder.inttoptr(arguments[0], context.get_data_type(kind).as_pointer())
        value = builder.load(builder.gep(array, [arguments[1]]))
        return context.cast(builder, value, kind, signature.return_type)

    return generate


def _store(kind: Any) -> Callable[..., Any]:
    """Return a code generator that writes a number of this type to an array at an address, or to the address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        address, *index, value = arguments
        array = builder.inttoptr(address, context.get_data_type(kind).as_pointer())
        value = context.cast(builder, value, signature.args[-1], kind)
        builder.store(value, builder.gep(array, index or [_WORD(0)]))
        return context.get_dummy_value()

    return generate


for _function, _kinds in _CALLS.items():
    _order = _ORDERS.get(_function, tuple((k, 0) for k in range(len(_kinds))))
    _numbers = {
        place: types.float64 if kind == "real" else types.int64 for kind, (place, _) in zip(_kinds, _order, strict=True)
    }
    _declare(_function, types.int64(types.int64, *(_numbers[k] for k in sorted(_numbers))), _call(_kinds, _order))
for _function, _kind in _READS.items():
    _number = types.float64 if _kind is types.float64 else types.int64
    _declare(_function, _number(types.int64, types.int64), _load(_kind))
_declare(blocks.put_real, types.none(types.int64, types.int64, types.float64), _store(types.float64))
_declare(blocks.put_byte, types.none(types.int64, types.int64), _store(types.uint8))


# ---- The program ----------------------------------------------------------------------------------------------------


def main() -> None:
    """Process one request."""
    gc.disable()  # a twentieth of the time; the process ends soon
    CPUContext.get_executable, JITCodeLibrary._finalize_specific = _linked, lambda _library: None
    request: Request = pickle.load(sys.stdin.buffer)
    code, name = _lowered(request)
    entries = enumerate((request.entries or {}).items())
    sys.stdout.buffer.write(
        optimised(code, name, {entry: _entry(k, entry, kinds, name) for k, (entry, kinds) in entries})
    )


def _linked(_context: Any, library: Any, *_: Any) -> Any:
    """Link the code of a function with that of the functions that it calls, and do not translate it for the processor.

    Numba would translate each function as if it were called from Python, which is a sixth of the time. It requires a
    function of C, and tells the functions apart by it.
    """
    library._ensure_finalized()
    return [].append


def _lowered(request: Request) -> tuple[str, str]:
    """Return the intermediate code of a function with all functions that it calls, and its name in the code."""
    _register(SHARED, request.instead)
    signature = (*map(_block_type, request.kinds), *[numba.int64] * request.numbers, *[numba.float64] * request.reals)
    machine: Any = numba.njit(nogil=True, _nrt=False)(request.function)
    machine.compile(signature)
    return machine.inspect_llvm(signature), machine.overloads[signature].fndesc.llvm_func_name


def _entry(number: int, name: str, kinds: Sequence[str], function: str) -> str:
    """Return the code of a C function that passes its number and its arguments to a function of a block.

    The first argument is the address of the block. Integers and real numbers are passed in two groups, each filled up
    with zeros to `INTEGERS` and `REALS`. The result of numba's functions is at their first argument.
    """
    module = ir.Module()
    pointer = _WORD.as_pointer()
    inner = ir.FunctionType(_INT, [pointer, pointer, *[_WORD] * (2 + INTEGERS), *[_REAL] * REALS])
    called = ir.Function(module, inner, function)
    entry = ir.Function(module, ir.FunctionType(_INT, [_LLVM[kind] for kind in kinds]), name)
    builder = ir.IRBuilder(entry.append_basic_block())
    block, *rest = entry.args
    integers = [_as_word(builder, kind, a) for kind, a in zip(kinds[1:], rest, strict=True) if kind != "real"]
    reals = [a for kind, a in zip(kinds[1:], rest, strict=True) if kind == "real"]
    integers += [_WORD(0)] * (INTEGERS - len(integers))
    reals += [_REAL(0.0)] * (REALS - len(reals))
    result, fault = builder.alloca(_WORD), builder.alloca(_WORD)
    failed = builder.call(called, [result, fault, builder.ptrtoint(block, _WORD), _WORD(number), *integers, *reals])
    status = builder.trunc(builder.load(result), _INT)
    builder.ret(builder.select(builder.icmp_unsigned("==", failed, _INT(0)), status, _INT(FAILED)))
    return str(module)


def _as_word(builder: Any, kind: str, value: Any) -> Any:
    if kind == "pointer":
        return builder.ptrtoint(value, _WORD)
    if kind == "size":
        return value
    return builder.sext(value, _WORD) if kind == "int" else builder.zext(value, _WORD)


def _register(functions: Sequence[Callable[..., Any]], instead: dict[str, Callable[..., int]]) -> None:
    """Make the marked functions callable from compiled code."""
    options = {"_nrt": False, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    for function in functions:
        taken = instead.get(function.__name__, function)
        overload(function, jit_options=options, strict=False)(lambda *_, taken=taken: taken)


if __name__ == "__main__":
    main()
