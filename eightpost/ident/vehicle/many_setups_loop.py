"""Compiled loop of `many_setups`, which simulates one setup over all samples of a drive."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numba
import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

#: Highest port velocity of the force tables [m/s], and their spacing [m/s].
FASTEST, SPACING = 6.0, 2.5e-4
_MIDDLE = round(FASTEST / SPACING)
_MAX_ITERATIONS = 60
#: Change of the forces [N] at which the iteration has converged.
_CLOSE = 1e-3


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    found: Callable[..., Any] = numba.njit(nogil=True, error_model="numpy")(function)
    return found


@_compiled
def _static(table: Any, v: float) -> Any:
    """Return a static force [N] by linear interpolation in its table."""
    at = min(max(v / SPACING, -float(_MIDDLE)), _MIDDLE - 1.0)
    left = math.floor(at)
    place = int(left) + _MIDDLE
    return (1.0 - (at - left)) * table[place] + (at - left) * table[place + 1]


@_compiled
def _add_outputs(C: Any, rows: Any, x: Any, y: Any) -> None:
    """Add `Re C_i x` to y_i for the given rows i."""
    for i in range(rows.size):
        for m in range(x.size):
            y[i] += (C[rows[i], m] * x[m]).real


@_compiled
def _add_inputs(x: Any, weight: Any, change: Any) -> None:
    """Add `weight change` to the modes."""
    for m in range(x.size):
        for j in range(change.size):
            x[m] += weight[m, j] * change[j]


@_compiled
def _lag(laws: Any, i: int, lagged: Any, old: Any, static: float) -> Any:
    """Return the lagged force [N] of a port after a step with a linear static force."""
    late = laws[2][i] * (static - old[i])
    return static - late + (lagged[i] - old[i] + late) * laws[1][i]


@_compiled
def _force(laws: Any, friction: Any, i: int, motion: Any, lag: float, static: float) -> Any:
    """Return the whole force [N] of a port; `motion` is its velocity and displacement."""
    low, high, gas = laws[3][i], laws[4][i], laws[5][i]
    weight = min(max((high - abs(static)) / (high - low), 0.0), 1.0)
    rub = friction[i, 0] * math.tanh(motion[0] / friction[i, 1]) if friction[i, 0] else 0.0
    return weight * lag + (1.0 - weight) * static + rub + gas * motion[1]


@_compiled
def _solve_forces(model: Any, laws: Any, friction: Any, ports: Any, moves: bool) -> bool:
    """Find the force differences at the end of a step by iteration; return whether they converged.

    `ports` has the velocities without the forces of the step, the displacements, the force differences (on entry: the
    initial guess), and the lagged and static forces before the step (on return: after it).
    """
    gain, damping = model
    free, place, change, lagged, old = ports
    count = free.size
    v, force, static, lag = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    for iteration in range(_MAX_ITERATIONS):
        error = 0.0
        for i in range(count):
            v[i] = free[i]
            if moves:
                for j in range(count):
                    v[i] += gain[i, j] * change[j]
            static[i] = _static(laws[0][i], v[i])
            lag[i] = _lag(laws, i, lagged, old, static[i]) if moves else lagged[i]
            force[i] = _force(laws, friction, i, (v[i], place[i]), lag[i], static[i]) - damping[i] * v[i]
        for i in range(count):
            error = max(error, abs(force[i] - change[i]))
            change[i] = force[i] if iteration < _MAX_ITERATIONS // 2 else 0.5 * (force[i] + change[i])
        if error <= _CLOSE:
            lagged[:], old[:] = lag, static
            return True
    return False


@_compiled
def compiled_march(modes: Any, rows: Any, driven: Any, laws: Any, friction: Any, every: int, out: Any) -> Any:
    """Simulate one setup.

    Args:
        modes: Decay (n,), weights of the force at the start and the end of a step (n, P), C (p, n), D (p, P), baseline
            damping (P,).
        rows: Indices of the velocities (P,) and displacements (P or 0,) among the outputs.
        driven: Outputs due to the drive alone (p, N).
        laws: Parameters by port: force table, exp(-h / tau), tau / h, static forces at which the lag starts to fade and
            has faded, gas stiffness.
        friction: Friction force F_c and velocity v_f of each port (P, 2).
        every: Interval of the output samples, in samples of the drive.
        out: Array for the outputs (p, kept).

    Returns:
        -1, or the index of the sample at which the forces did not converge.
    """
    decay, held, ramp, C, D, damping = modes
    velocities, displacements = rows
    count, everything = damping.size, np.arange(C.shape[0])
    x, gain = np.zeros(decay.size, dtype=np.complex128), np.zeros((count, count))
    free, place = np.zeros(count), np.zeros(count)
    change, before, lagged, old = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    for j in range(count):
        _add_outputs(C, velocities, ramp[:, j].copy(), gain[:, j])
    for k in range(driven.shape[1]):
        if k:
            x *= decay
            _add_inputs(x, held, change)
        for i in range(count):
            free[i] = driven[velocities[i], k]
            place[i] = driven[displacements[i], k] if displacements.size else 0.0
            before[i], change[i] = change[i], 2.0 * change[i] - before[i]
        _add_outputs(C, velocities, x, free)
        _add_outputs(C, displacements, x, place)
        if not _solve_forces((gain, damping), laws, friction, (free, place, change, lagged, old), k > 0):
            return k
        if k:
            _add_inputs(x, ramp, change)
        if k % every == 0:
            y = driven[:, k] + D @ change
            _add_outputs(C, everything, x, y)
            out[:, k // every] = y
    return -1
