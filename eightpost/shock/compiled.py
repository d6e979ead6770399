"""The laws as machine code: whole records, and single steps inside other compiled loops.

Everything is compiled from the functions of the laws' own files, with every function that they call; the FMU contains
the same functions. The machine code is cached on disk under a digest of all these files.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Sequence
from functools import cache
from math import tanh
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, cast

from eightpost.extras import needs
from eightpost.object_code.native import optimised
from eightpost.shock.law import Piece, ShockLaw, Valve, valve_force
from eightpost.shock.laws import LAWS, law_module, own_size, state_names
from eightpost.shock.records import LAW_NUMBERS

with needs("fit", "machine code of laws"):
    from numba import njit, types
    from numba.extending import register_jitable
    from numba.np.numpy_support import from_dtype
    from numba.np.unsafe.ndarray import to_fixed_tuple

# ---- Compilation of functions from other files ----------------------------------------------------------------------


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


# ---- One step of any law inside a compiled loop ---------------------------------------------------------------------


def law_step(
    numbers: Any, states: tuple[float, float], before: float, after: float, displacement: float, step: float
) -> tuple[tuple[float, float], float]:
    """Return states and port force [N] after a step; the same as `ShockLaw.advance` and `ShockLaw.response`.

    Args:
        numbers: Record of the law; see `LAW_NUMBERS`.
        states: `MOST_STATES` states at the start of the step: F_lag [N] and a number without use, or those of a law
            with several states.
        before: Port velocity at the start [m/s].
        after: Port velocity at the end [m/s]; F_s is linear in between.
        displacement: Port displacement at the end [m].
        step: Duration [s]; if it is 0, the states do not change.
    """
    port = numbers.port
    valve = Valve(numbers.curve, port.compression_scale, port.rebound_scale)
    velocity = port.motion_ratio * after
    static = valve_force(valve, velocity)
    if step > 0.0:
        start = port.motion_ratio * before
        piece = Piece(start, velocity, valve_force(valve, start), static, step)
        states = _advance(numbers.kind, states, piece, numbers, valve)
    force = _force(numbers.kind, states, velocity, static, numbers, valve)
    if port.seal_friction != 0.0:
        force += port.seal_friction * tanh(velocity / port.friction_velocity)
    gas = port.gas_preload + port.gas_stiffness * port.motion_ratio * displacement
    return states, port.motion_ratio * (force + gas)


def _start_of(law: type[ShockLaw]) -> Callable[..., Any]:
    core: Any = getattr(law_module(law), "start_core", None)

    def start(velocity: float, static: float, numbers: Any, valve: Valve) -> Any:
        return core(velocity, static, numbers.own, valve)

    def start_one(velocity: float, static: float, numbers: Any, valve: Valve) -> Any:
        return static, 0.0

    return start_one if len(state_names(law)) == 1 else start


def _advance_of(law: type[ShockLaw]) -> Callable[..., Any]:
    core, count = law_module(law).advance_core, own_size(law)

    def advance(states: tuple[float, float], piece: Piece, numbers: Any, valve: Valve) -> Any:
        return core(states, piece, numbers.own, valve)

    def advance_one(states: tuple[float, float], piece: Piece, numbers: Any, valve: Valve) -> Any:
        return core(states[0], piece, to_fixed_tuple(numbers.own, count), valve), states[1]

    return advance_one if len(state_names(law)) == 1 else advance


def _force_of(law: type[ShockLaw]) -> Callable[..., Any]:
    module, count = law_module(law), own_size(law)
    weight_core = module.weight_core

    def force_of_one(states: Any, velocity: float, static: float, numbers: Any, valve: Valve) -> Any:
        weight = weight_core(static, to_fixed_tuple(numbers.own, count))
        return weight * states[0] + (1.0 - weight) * static

    if len(state_names(law)) == 1:
        return force_of_one
    core = module.force_core

    def force(states: Any, velocity: float, static: float, numbers: Any, valve: Valve) -> Any:
        return core(states, velocity, static, numbers.own, valve)

    return force


_start, _advance, _force = (
    _choice_of([of(law) for law in LAWS.values()]) for of in (_start_of, _advance_of, _force_of)
)

register_jitable(law_step)


def _cores(module: ModuleType) -> list[Any]:
    """Return the functions that a law's file defines for compilation."""
    names = ("start_core", "advance_core", "weight_core", "force_core")
    return [getattr(module, name) for name in names if hasattr(module, name)]


#: A number that changes with any file that the code of `law_step` comes from.
LAW_FILES = _number_of({law_step}.union(*(_registered(*_cores(law_module(law)), valve_force) for law in LAWS.values())))


# ---- A law over a whole record: the program that `records.record_loop` runs ------------------------------------------


def _loop(numbers: Any, velocity: Any, step: Any, states: Any, force: Any) -> int:
    """Fill states (N, 2) and, if it has elements, the force (N,) of a law; see `eightpost.shock.records`."""
    law, has_force = numbers[0], force.size > 0
    valve = Valve(law.curve, law.port.compression_scale, law.port.rebound_scale)
    before, state = 0.0, (0.0, 0.0)
    for n in range(velocity.size):
        after = valve_force(valve, velocity[n]) if has_force else 0.0
        if n == 0:
            state = _start(law.kind, velocity[n], after, law, valve)
        else:
            piece = Piece(velocity[n - 1], velocity[n], before, after, step[n - 1])
            state = _advance(law.kind, state, piece, law, valve)
        states[n, 0], states[n, 1] = state
        if has_force:
            force[n] = _force(law.kind, state, velocity[n], after, law, valve)
        before = after
    return 0


def main() -> None:
    """Write the object file of the loop to standard output."""
    row = types.Array(types.float64, 1, "C")
    laws, states = types.Array(from_dtype(LAW_NUMBERS), 1, "C"), types.Array(types.float64, 2, "C")
    signature = (laws, row, row, states, row)
    machine: Any = njit(nogil=True, error_model="numpy", _nrt=False)(_loop)
    machine.compile(signature)
    name = machine.overloads[signature].fndesc.llvm_func_name
    sys.stdout.buffer.write(optimised(machine.inspect_llvm(signature), name))


if __name__ == "__main__":
    main()
