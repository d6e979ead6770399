"""Implementations of the functions of `calls` for numba: calls of the FMI functions at their addresses."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from cosim.engine import blocks

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
