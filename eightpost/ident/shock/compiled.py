"""Compiled loops that step a whole record through a law that has no closed form.

The law file's `advance_core` and `weight_core` are compiled, with every function that they call; the FMU contains the
same functions. The machine code is cached on disk under a digest of all files that these functions come from.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numba import njit
from numba.extending import register_jitable

from eightpost.array_types import Array
from eightpost.cache import kept
from eightpost.shock import law_module
from eightpost.shock.law import Piece, valve_force

if TYPE_CHECKING:
    from eightpost.shock import ShockLaw, Valve


#: Lags shorter than this share of the sampling interval are treated as zero.
_SHORTEST_SHARE = 1e-9


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
    number = number_of(registered(advance_core, weight_core, valve_force))

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


def lagged_columns(columns: Array, time_constant: Array, step: float) -> Array:
    """Return columns (N, n) behind a first-order lag with varying time constant; each starts at its own first value.

    Args:
        columns: Columns (N, n), contiguous in memory, as are the returned ones.
        time_constant: Time constant (N,) [s]; between two samples their mean applies.
        step: Sampling interval [s].
    """
    lagged = np.empty(columns.shape[::-1])
    tau = np.maximum(0.5 * (time_constant[:-1] + time_constant[1:]), _SHORTEST_SHARE * step)
    rise = -np.expm1(-step / tau)
    _lag_machine()(np.ascontiguousarray(columns.T), rise, 1.0 - rise * tau / step, lagged)
    return lagged.T


@cache
def _lag_machine() -> Callable[..., None]:
    def loop(series: Any, rise: Any, weight: Any, lagged: Any) -> None:
        for j in range(series.shape[0]):
            before, start = series[j, 0], series[j, 0]
            lagged[j, 0] = before
            for n in range(rise.size):
                end = series[j, n + 1]
                before += (start - before) * rise[n] + (end - start) * weight[n]
                lagged[j, n + 1] = before
                start = end

    return compiled_loop(loop)


def compiled_loop(loop: Callable[..., None]) -> Callable[..., None]:
    """Return a loop as machine code, cached on disk if there is a cache folder."""
    found: Callable[..., None] = kept(njit(nogil=True, error_model="numpy")(loop))
    return found


def registered(*functions: Any) -> set[FunctionType]:
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


def number_of(functions: set[FunctionType]) -> int:
    """Return a positive number that changes with the files that functions come from."""
    digest = hashlib.sha256()
    for path in sorted({Path(function.__code__.co_filename) for function in functions}):
        digest.update(path.read_bytes())
    return 1 + int.from_bytes(digest.digest()[:6], "big")
