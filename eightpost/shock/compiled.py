"""The laws as machine code: whole records, and single steps inside other compiled loops.

Everything is compiled from the functions of the laws' own files, with every function that they call; the FMU contains
the same functions. The machine code is cached on disk under a digest of all these files.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from functools import cache
from math import tanh
from pathlib import Path
from types import FunctionType
from typing import Any, cast

import numpy as np
from numba import njit
from numba.extending import register_jitable
from numba.np.unsafe.ndarray import to_fixed_tuple

from eightpost.array_types import Array
from eightpost.cache import kept
from eightpost.shock.curve import INNER_ORDER, KNOTS, OUTER_ORDER, CurveNumbers
from eightpost.shock.law import Piece, ShockLaw, Valve, valve_force
from eightpost.shock.laws import LAWS, law_module, own_parameters, own_values
from eightpost.shock.port import Port

# ---- Compilation of functions from other files ----------------------------------------------------------------------


def compiled_loop(loop: Callable[..., None]) -> Callable[..., None]:
    """Return a loop as machine code, cached on disk if there is a cache folder."""
    found: Callable[..., None] = kept(njit(nogil=True, error_model="numpy")(loop))
    return found


def _registered(*functions: Any) -> set[FunctionType]:
    """Register functions, and all that they call by name, with the compiler; return them all."""
    found: set[FunctionType] = set()
    waiting = [cast("FunctionType", function) for function in functions]
    while waiting:
        function = waiting.pop()
        if function in found:
            continue
        found.add(function)
        called = (function.__globals__.get(name) for name in function.__code__.co_names)
        waiting += [other for other in called if isinstance(other, FunctionType)]
    for function in found:
        _register(function)
    return found


@cache
def _register(function: FunctionType) -> None:
    register_jitable(function)


def _number_of(functions: set[Any]) -> int:
    """Return a positive number that changes with the files that functions come from."""
    digest = hashlib.sha256()
    for path in sorted({Path(function.__code__.co_filename) for function in functions}):
        digest.update(path.read_bytes())
    return 1 + int.from_bytes(digest.digest()[:6], "big")


def _choice_of(functions: Sequence[Callable[..., Any]], number: int = 0) -> Callable[..., Any]:
    """Return a function of an index and further arguments that calls the function of that index, in compiled code too.

    The index of the first function is `number`.
    """
    first = register_jitable(functions[0])
    rest = _choice_of(functions[1:], number + 1) if functions[1:] else None

    def call(index: int, *arguments: Any) -> Any:
        if rest is None or index == number:
            return first(*arguments)
        return rest(index, *arguments)

    found: Callable[..., Any] = register_jitable(call)
    return found


# ---- A law over a whole record --------------------------------------------------------------------------------------


def stepped_force(law: type[ShockLaw], valve: Valve, own: tuple[float, ...], velocity: Array, step: Array) -> Array:
    """Return the valve force (N,) [N] of a law for a record; it starts in equilibrium, F_lag = F_s.

    Args:
        law: Class of the law; its file has `advance_core` and `weight_core`.
        valve: Curve and scales of the static force.
        own: The law's own parameters, in the order of its fields.
        velocity: Damper velocity (N,) [m/s].
        step: Time (N - 1,) from sample to sample [s].
    """
    force = np.empty(velocity.size)
    machine(law)(valve, own, np.ascontiguousarray(velocity), step, force)
    return force


@cache
def machine(law: type[ShockLaw]) -> Callable[..., None]:
    """Return the compiled loop of a law."""
    module = law_module(law)
    advance_core, weight_core = module.advance_core, module.weight_core
    # numba checks only this file for changes, so this number makes the cached code depend on the other files too.
    number = _number_of(_registered(advance_core, weight_core, valve_force))

    def loop(valve: Any, own: Any, velocity: Any, step: Any, force: Any) -> None:
        if number == 0:
            return
        before = valve_force(valve, velocity[0])
        lagged = before
        force[0] = before
        for n in range(1, velocity.size):
            after = valve_force(valve, velocity[n])
            piece = Piece(velocity[n - 1], velocity[n], before, after, step[n - 1])
            lagged = advance_core(lagged, piece, own, valve)
            weight = weight_core(after, own)
            force[n] = weight * lagged + (1.0 - weight) * after
            before = after

    return compiled_loop(loop)


# ---- One step of any law inside a compiled loop ---------------------------------------------------------------------

_CURVE = [("inner", "f8", INNER_ORDER), ("compression", "f8", OUTER_ORDER + 1), ("rebound", "f8", OUTER_ORDER + 1)]
_CURVE += [(name, "f8") for name in CurveNumbers._fields[3:-3]]  # type: ignore[misc]
_CURVE += [(name, "f8", KNOTS) for name in CurveNumbers._fields[-3:]]

#: A law as a record of numbers: its place in `LAWS`, its port, its curve and its own parameters, filled up with zeros.
LAW_NUMBERS = np.dtype(
    [
        ("kind", "i8"),
        ("port", [(f.name, "f8") for f in dataclasses.fields(Port)]),
        ("curve", _CURVE),
        ("own", "f8", (max(1, *(len(own_parameters(law)) for law in LAWS.values())),)),
    ]
)


def law_numbers(laws: Sequence[ShockLaw]) -> np.ndarray[Any, np.dtype[np.void]]:
    """Return laws as records (S,) of `LAW_NUMBERS`."""
    kinds, count = list(LAWS.values()), LAW_NUMBERS["own"].shape[0]
    numbers = np.zeros(len(laws), LAW_NUMBERS)
    for k, law in enumerate(laws):
        own = own_values(law)
        port, curve = dataclasses.astuple(law.port), tuple(law.curve.numbers())
        numbers[k] = (kinds.index(type(law)), port, curve, (*own, *[0.0] * (count - len(own))))
    return numbers


def law_step(
    numbers: Any, lagged: float, before: float, after: float, displacement: float, step: float
) -> tuple[float, float]:
    """Return F_lag [N] and the port force [N] after a step; the same as `ShockLaw.advance` and `ShockLaw.response`.

    Args:
        numbers: Record of the law; see `LAW_NUMBERS`.
        lagged: F_lag at the start of the step [N].
        before: Port velocity at the start [m/s].
        after: Port velocity at the end [m/s]; F_s is linear in between.
        displacement: Port displacement at the end [m].
        step: Duration [s]; if it is 0, F_lag does not change.
    """
    port = numbers.port
    valve = Valve(numbers.curve, port.compression_scale, port.rebound_scale)
    velocity = port.motion_ratio * after
    static = valve_force(valve, velocity)
    if step > 0.0:
        start = port.motion_ratio * before
        piece = Piece(start, velocity, valve_force(valve, start), static, step)
        lagged = _advance(numbers.kind, lagged, piece, numbers, valve)
    weight = _weight(numbers.kind, static, numbers)
    force = weight * lagged + (1.0 - weight) * static
    if port.seal_friction != 0.0:
        force += port.seal_friction * tanh(velocity / port.friction_velocity)
    gas = port.gas_preload + port.gas_stiffness * port.motion_ratio * displacement
    return lagged, port.motion_ratio * (force + gas)


def _advance_of(law: type[ShockLaw]) -> Callable[..., float]:
    core, count = law_module(law).advance_core, len(own_parameters(law))

    def advance(lagged: float, piece: Piece, numbers: Any, valve: Valve) -> Any:
        return core(lagged, piece, to_fixed_tuple(numbers.own, count), valve)

    return advance


def _weight_of(law: type[ShockLaw]) -> Callable[..., float]:
    core, count = law_module(law).weight_core, len(own_parameters(law))

    def weight(static: float, numbers: Any) -> Any:
        return core(static, to_fixed_tuple(numbers.own, count))

    return weight


_advance, _weight = (_choice_of([of(law) for law in LAWS.values()]) for of in (_advance_of, _weight_of))

register_jitable(law_step)

#: A number that changes with any file that the code of `law_step` comes from.
LAW_FILES = _number_of(
    {law_step}.union(*(_registered(m.advance_core, m.weight_core, valve_force) for m in map(law_module, LAWS.values())))
)
