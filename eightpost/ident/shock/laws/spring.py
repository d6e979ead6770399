"""A spring in series with valves over a whole record: Maxwell's equation, its state w, on a table of the curve.

The law's own function is given a force and looks for the w under it at every step; a fit that goes through a record
dozens of times keeps w instead, and looks the curve up. The parts that a step is gone through in are the law's.
"""

from __future__ import annotations

from functools import cache
from math import copysign
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from eightpost.ident.shock.laws.compiled import compiled_loop, number_of, registered
from eightpost.shock.law import STRAIGHT
from eightpost.shock.maxwell import followed, reach

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: The shortest chord of a curve [m/s].
_SHORTEST = 1e-9
#: Most parts of a step: on a flat stretch w is across it at once, and no part would be short enough.
_MOST_PARTS = 200


class Table(NamedTuple):
    """A rising curve: `force` (M,) [N] at velocities from `first` on, `spacing` apart [m/s]."""

    first: float
    spacing: float
    force: Any


def spring_force(table: Table, stiffness: float, velocity: Array, step: float) -> Array:
    """Return F (N,) [N] of dF/dt = k (v - w), F = f(w), in equilibrium at the start.

    Args:
        table: Of f, over all velocities of the record.
        stiffness: k [N/m].
        velocity: v (N,) of the damper [m/s], linear between the samples.
        step: From sample to sample [s].
    """
    force = np.empty(velocity.size)
    _march()(table, stiffness, np.ascontiguousarray(velocity), step, force)
    return force


def force_at(table: Table, velocity: float) -> float:
    """Return f [N] at a velocity [m/s]."""
    place = (velocity - table.first) / table.spacing
    cell = min(max(int(place), 0), table.force.size - 2)
    low = table.force[cell]
    return float(low + (table.force[cell + 1] - low) * (place - cell))


def lag_over(table: Table, stiffness: float, w: float, change: float) -> float:
    """Return tau [s]: the slope of the chord from w [m/s] over a change of w, over k."""
    there = w + (change if abs(change) > _SHORTEST else copysign(_SHORTEST, change))
    return (force_at(table, there) - force_at(table, w)) / (there - w) / stiffness


def velocity_after(table: Table, stiffness: float, w: float, tau: float, v: float, end: float, step: float) -> float:
    """Return w [m/s] after a step [s] to a velocity `end` [m/s],."""
    for _ in range(2):  # tau is that of the chord to where the last one led
        tau = lag_over(table, stiffness, w, followed(w, v, end, tau, step) - w)
    return followed(w, v, end, tau, step)


def velocity_through(table: Table, stiffness: float, w: float, v: float, end: float, step: float) -> float:
    """Return w [m/s] after a step [s] from v to `end` [m/s], in parts in which w moves by `STRAIGHT` at most."""
    left = step
    while left > 0.0:
        far = reach(w, v, end)
        towards = v - w if abs(v - w) >= abs(end - w) else end - w
        tau = lag_over(table, stiffness, w, copysign(min(far, STRAIGHT), towards))
        part = left
        if far > STRAIGHT:  # |dw/dt| is at most far / tau
            part = min(left, max(tau * STRAIGHT / far, step / _MOST_PARTS))
        after = end if part == left else v + (end - v) * (part / left)
        w = velocity_after(table, stiffness, w, tau, v, after, part)
        v, left = after, left - part
    return w


@cache
def _march() -> Callable[..., None]:
    number = number_of(registered(velocity_through, force_at))

    def loop(table: Any, stiffness: Any, velocity: Any, step: Any, force: Any) -> None:
        if number == 0:
            return
        w = velocity[0]
        force[0] = force_at(table, w)
        for n in range(1, velocity.size):
            w = velocity_through(table, stiffness, w, velocity[n - 1], velocity[n], step)
            force[n] = force_at(table, w)

    return compiled_loop(loop)
