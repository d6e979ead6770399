"""Compiled steps of the grey-box car for many sets of parameters.

    q+ = q + h v + h^2/2 a,  a+ = acceleration(q+, v + h (3/2 a - 1/2 a-)),  v+ = v + h/2 (a + a+)

with the acceleration a- one step before. The step is of second order and needs one evaluation of the forces. The
velocity that it predicts is of third order: a predictor v + h a would act like additional damping. The bristle of the
friction is exact for the mean velocity of a step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np
from numba import njit

from eightpost.array_types import Array
from eightpost.cache import kept
from eightpost.vehicle.compiled import BRISTLE_FILE, deflection_after


class Numbers(NamedTuple):
    """Arrays of K cars with 8 coordinates, 4 ports, A loads and Y outputs."""

    shock: Array  #: Port displacements per q (K, 4, 8).
    spring: Array  #: Spring displacements per q (K, 4, 8).
    push: Array  #: Accelerations per force of ports, springs, tires and loads (K, 8, 12 + A).
    stiffness: Array  #: Accelerations per q of the other elements (K, 8, 8).
    damping: Array  #: Accelerations per q' of the other elements (K, 8, 8).
    springs: Array  #: Rate, progression of the springs (K, 4, 2).
    tires: Array  #: Stiffness, damping, stiffening, static load of the tires (K, 4, 4).
    friction: Array  #: Sliding force, reach, static ratio and Stribeck velocity of the bristles (K, 4, 4).
    baseline: Array  #: Damping about which the ports are driven (4,).
    position: Array  #: Outputs per q (K, Y, 8).
    velocity: Array  #: Outputs per q' (K, Y, 8).
    acceleration: Array  #: Outputs per q'' (K, Y, 8).
    road: Array  #: Outputs per road (K, Y, 4).
    tire: Array  #: Outputs per tire force (Y, 4).


def _compile(function: Callable[..., Any]) -> Any:
    options = {"nogil": True, "error_model": "numpy", "fastmath": {"contract", "reassoc"}}
    return kept(cast("Any", njit(**options)(function)), BRISTLE_FILE)


@_compile
def march(numbers: Any, inputs: Array, step: float, every: int, states: Array, outputs: Array) -> None:
    """Fill outputs (K, N, Y) and move states (K, 36) of q, q', q'', bristles, q'' one step before to the end.

    Args:
        numbers: Arrays of the cars, see `Numbers`.
        inputs: Roads, road velocities, loads, port forces minus baseline damping (N every + 1, 12 + A).
        step: Step [s].
        every: Steps per sample.
        states: States at the start (K, 36).
        outputs: Outputs to fill.
    """
    dofs = 8
    loads = inputs.shape[1] - 12
    forces = np.zeros(12 + loads)
    guess, ports = np.zeros(dofs), np.zeros(4)
    for run in range(states.shape[0]):
        q, v, a, z = states[run, :8], states[run, 8:16], states[run, 16:24], states[run, 24:28]
        earlier = states[run, 28:]
        shock, spring, push = numbers.shock[run], numbers.spring[run], numbers.push[run]
        stiffness, damping = numbers.stiffness[run], numbers.damping[run]
        for c in range(4):
            ports[c] = _dot(shock[c], v)
        for k in range(outputs.shape[1] * every):
            if k % every == 0:
                _observe(numbers, run, inputs[k], states[run], outputs[run, k // every])
            drive = inputs[k + 1]
            for i in range(dofs):
                q[i] += step * (v[i] + 0.5 * step * a[i])
                guess[i] = v[i] + step * (1.5 * a[i] - 0.5 * earlier[i])
            for c in range(4):
                speed, way = _dot(shock[c], guess), _dot(spring[c], q)
                law = numbers.friction[run, c]
                z[c] = deflection_after(z[c], 0.5 * (ports[c] + speed), step, law[1], law[2], law[3])
                rate = numbers.springs[run, c]
                forces[c] = drive[8 + loads + c] + numbers.baseline[c] * speed + law[0] / law[1] * z[c]
                forces[4 + c] = rate[0] * way * (1.0 + rate[1] * way)
                forces[8 + c] = _tire(numbers.tires[run, c], drive[c] - q[4 + c], drive[4 + c] - guess[4 + c])
            for j in range(loads):
                forces[12 + j] = drive[8 + j]
            for i in range(dofs):
                new = _dot(push[i], forces) + _dot(stiffness[i], q) + _dot(damping[i], guess)
                v[i] += 0.5 * step * (a[i] + new)
                earlier[i], a[i] = a[i], new
            for c in range(4):
                ports[c] = _dot(shock[c], v)
            if k % 500 == 0 and not abs(q[0]) < 1e3:
                outputs[run] = np.nan
                break


@_compile
def _observe(numbers: Any, run: int, drive: Array, state: Array, outputs: Array) -> None:
    """Fill the outputs (Y,) of a state (36,)."""
    q, v, a, tires = state[:8], state[8:16], state[16:24], np.empty(4)
    for c in range(4):
        tires[c] = _tire(numbers.tires[run, c], drive[c] - q[4 + c], drive[4 + c] - v[4 + c])
    for y in range(outputs.size):
        total = _dot(numbers.position[run, y], q) + _dot(numbers.velocity[run, y], v)
        total += _dot(numbers.acceleration[run, y], a)
        for c in range(4):
            total += numbers.road[run, y, c] * drive[c] + numbers.tire[y, c] * tires[c]
        outputs[y] = total


@_compile
def _dot(row: Array, x: Array) -> float:
    total = 0.0
    for i in range(x.size):
        total += row[i] * x[i]
    return total


@_compile
def _tire(tire: Array, deflection: float, rate: float) -> float:
    force = tire[0] * deflection * (1.0 + tire[2] * deflection) + tire[1] * rate
    return float(max(force, -tire[3]))
