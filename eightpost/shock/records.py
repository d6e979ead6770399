"""A law as a record of numbers, and over a whole time series: compiled by `compiled`, loaded and run without numba.

The machine code is stored on disk under a digest of all files of this folder, from which it is compiled.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from eightpost.array_types import Array
from eightpost.object_code.native import array_words, function_at, loaded_entries
from eightpost.object_code.stored import code_key, compiled_by, stored
from eightpost.shock.curve import INNER_ORDER, KNOTS, OUTER_ORDER, CurveNumbers
from eightpost.shock.law import Port, ShockLaw, Valve
from eightpost.shock.laws import LAWS, own_size, own_values, state_names

# ---- A law as numbers -----------------------------------------------------------------------------------------------

_CURVE = [("inner", "f8", INNER_ORDER), ("compression", "f8", OUTER_ORDER + 1), ("rebound", "f8", OUTER_ORDER + 1)]
_CURVE += [(name, "f8") for name in CurveNumbers._fields[3:-3]]  # type: ignore[misc]
_CURVE += [(name, "f8", KNOTS) for name in CurveNumbers._fields[-3:]]

#: A law as a record of numbers: its place in `LAWS`, its port, its curve and its own parameters, filled up with zeros.
LAW_NUMBERS = np.dtype(
    [
        ("kind", "i8"),
        ("port", [(f.name, "f8") for f in dataclasses.fields(Port)]),
        ("curve", _CURVE),
        ("own", "f8", (max(1, *(own_size(law) for law in LAWS.values())),)),
    ]
)


#: Number of states with which `law_step` works.
MOST_STATES = 2
assert max(len(state_names(law)) for law in LAWS.values()) <= MOST_STATES


def law_numbers(laws: Sequence[ShockLaw]) -> np.ndarray[Any, np.dtype[np.void]]:
    """Return laws as records (S,) of `LAW_NUMBERS`."""
    return _records([(type(law), law.port, tuple(law.curve.numbers()), own_values(law)) for law in laws])


def _records(
    laws: Sequence[tuple[type[ShockLaw], Port, tuple[Any, ...], tuple[float, ...]]],
) -> np.ndarray[Any, np.dtype[np.void]]:
    kinds, count = list(LAWS.values()), LAW_NUMBERS["own"].shape[0]
    numbers = np.zeros(len(laws), LAW_NUMBERS)
    for k, (law, port, curve, own) in enumerate(laws):
        numbers[k] = (kinds.index(law), dataclasses.astuple(port), curve, (*own, *[0.0] * (count - len(own))))
    return numbers


# ---- A law over a whole record --------------------------------------------------------------------------------------


def stepped_force(law: type[ShockLaw], valve: Valve, own: tuple[float, ...], velocity: Array, step: Array) -> Array:
    """Return the valve force (N,) [N] of a law for a record that starts in steady motion.

    Args:
        law: Class of the law.
        valve: Curve and scales of the static force.
        own: The law's own parameters, in the order of its fields.
        velocity: Damper velocity (N,) [m/s].
        step: Time (N - 1,) from sample to sample [s].
    """
    port, force = (
        Port(compression_scale=valve.compression_scale, rebound_scale=valve.rebound_scale),
        np.empty(len(velocity)),
    )
    _run(_records([(law, port, tuple(valve.curve), own)]), velocity, step, force)  # type: ignore[arg-type]
    return force


def stepped_states(law: type[ShockLaw], valve: Valve, own: tuple[float, ...], velocity: Array, step: Array) -> Array:
    """Return the states (N, 2) of a law whose states depend on the velocity alone; see `stepped_force`."""
    numbers = _records([(law, Port(), tuple(valve.curve), own)])  # type: ignore[arg-type]
    return _run(numbers, velocity, step, np.empty(0))


def _run(numbers: np.ndarray[Any, np.dtype[np.void]], velocity: Array, step: Array, force: Array) -> Array:
    """Fill the force, unless it has no elements, and return the states."""
    states = np.empty((velocity.size, MOST_STATES))
    record_loop()(numbers, np.ascontiguousarray(velocity), np.ascontiguousarray(step), states, force)
    return states


@cache
def record_loop() -> Callable[..., None]:
    """Return the compiled loop: it fills states (N, 2) and force (N,) or (0,) from a law, velocity (N,), step (N-1,).

    Raises:
        RuntimeError: numba could not compile it.
    """
    here = "eightpost.shock.compiled"
    content = stored(code_key(Path(__file__).parent, here), lambda: compiled_by(here, b""))
    count = sum(len(array_words(np.empty(shape))) for shape in (0, 0, 0, (0, 0), 0))
    loop = function_at(loaded_entries(content)[0], count)

    def call(*arrays: Array) -> None:
        loop(*(word for array in arrays for word in array_words(array)))

    return call
