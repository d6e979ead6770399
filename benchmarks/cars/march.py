"""Compiled march of a true car through a drive.

    q+ = q + h v + h^2/2 a,  a+ = acceleration(q+, v + h a),  v+ = v + h/2 (a + a+)

Shocks with their top mounts are solved implicitly (trapezoidal rule). Friction elements are springs in series with a
dry contact, which are exact in the displacement.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Half range [m/s] of the tables of static shock forces, and their spacing [m/s].
FASTEST, SPACING = 4.0, 0.001


class Numbers(NamedTuple):
    """Arrays of a car with D coordinates and four corners."""

    inverse: Array  #: Inverse mass matrix (D, D).
    stiffness: Array  #: Stiffness of the linear elements (D, D).
    damping: Array  #: Damping of the linear elements (D, D).
    travel: Array  #: Bump travel of the wheels per q (4, D).
    wheel: Array  #: Heights of the wheels per q (4, D).
    load: Array  #: Heights of the aeroloaders' points per q (4, D).
    #: Spring rate, motion ratio and its slope, bump gap and rate, preload (4, 6).
    spring: Array
    #: Link friction and its stiffness; friction in series with rubber, its stiffness and damping (4, 5).
    friction: Array
    mount: Array  #: Stiffness and damping of the top mounts (4, 2); stiffness 0 is a rigid mount.
    tire: Array  #: Stiffness at static load, its growth with load [1/m], damping, static load (4, 4).
    bar: Array  #: Rate, friction, and its stiffness of the front and rear anti-roll bars (2, 3).
    weight: Array  #: Constant force on the coordinates beyond the static loads (D,).


class Shocks(NamedTuple):
    """Arrays of the shocks at the four corners."""

    table: Array  #: Static force at velocities from -FASTEST to FASTEST (4, K).
    #: Shares of the static force before and of its rise that the lagged force follows in a step; forces from which the
    #: lag fades and without lag, dry friction inside and its stiffness (4, 6).
    law: Array


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def static_force(table: Any, v: float) -> float:
    """Return the force of a table at a velocity; it continues with the slopes at its ends."""
    place = (v + FASTEST) / SPACING
    k = min(max(int(place), 0), table.size - 2)
    return float(table[k] + (place - k) * (table[k + 1] - table[k]))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def contact(force: float, limit: float, change: float) -> float:
    """Return the force of a spring in series with a dry contact after a change of the spring's force."""
    return float(min(max(force + change, -limit), limit))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def rubber(bend: float, limit: float, k: float, c: float, moved: float, rate: float, h: float) -> Any:
    """Return the bend of rubber in series with a dry contact after a step, and its force."""
    force = k * (bend + moved) + c * rate
    if abs(force) <= limit:
        return bend + moved, force
    force = math.copysign(limit, force)
    return (force + c * bend / h) / (k + c / h), force


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def shock_force(table: Any, law: Any, state: Any, v: float, h: float) -> Any:
    """Return the force of a shock at the velocity v at the end of a step, and its state there.

    The state is: velocity, travel, lagged force, static force, dry friction.
    """
    static = static_force(table, v)
    lagged = state[2] + (state[3] - state[2]) * law[0] + (static - state[3]) * law[1]
    share = min(max((law[3] - abs(static)) / (law[3] - law[2]), 0.0), 1.0)
    moved = 0.5 * h * (state[0] + v)
    dry = contact(state[4], law[4], law[5] * moved)
    return share * lagged + (1.0 - share) * static + dry, (v, state[1] + moved, lagged, static, dry)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def behind_mount(table: Any, law: Any, state: Any, mount: Any, s: float, sv: float, h: float) -> Any:
    """Return force and state of a shock in series with its mount; s and sv are the travel of both and its rate."""
    if mount[0] == 0.0:
        return shock_force(table, law, state, sv, h)
    v = state[0]
    for _ in range(30):
        force, after = shock_force(table, law, state, v, h)
        error = force - mount[0] * (s - after[1]) - mount[1] * (sv - v)
        beside, _ = shock_force(table, law, state, v + 1e-5, h)
        change = error / ((beside - force) / 1e-5 + 0.5 * h * mount[0] + mount[1])
        v -= change
        if abs(change) < 1e-9:
            break
    return shock_force(table, law, state, v, h)


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def march(car: Any, shocks: Any, drive: Any, scale: Any, h: float, every: int) -> Any:  # noqa: PLR0912, PLR0915 (one loop)
    """Return the channels at every `every`th step (44, N), from rest at the static position.

    Args:
        car: `Numbers`.
        shocks: `Shocks`.
        drive: Roads (4) and aeroloads down (4) at every step (8, steps).
        scale: Factor on all friction of the car at every step (steps,).
        h: Step [s].
        every: Steps per sample.

    Channels, four of each: change of the tire force from rest, shock force, travel and velocity of the shock, travel
    and velocity of shock and mount together, and hub acceleration; then the accelerations of all D coordinates, and the
    coordinates.
    """
    inverse, stiffness, damping, travel, wheel, load, spring, friction, mount, tire, bar, weight = car
    D, steps = inverse.shape[0], drive.shape[1]
    q, p, a, push = np.zeros(D), np.zeros(D), np.zeros(D), np.zeros(D)
    states, dry = np.zeros((4, 5)), np.zeros((4, 2))
    twist, w, wv = np.zeros(2), np.zeros(4), np.zeros(4)
    before, moved, now = np.zeros(4), np.zeros(4), np.zeros(28)
    out = np.zeros((28 + 2 * D, (steps + every - 1) // every))
    for i in range(steps):
        if i:
            for k in range(D):
                q[k] += h * p[k] + 0.5 * h * h * a[k]
                p[k] += h * a[k]  # predicted
        for k in range(D):
            push[k] = weight[k]
            for j in range(D):
                push[k] -= stiffness[k, j] * q[j] + damping[k, j] * p[j]
        for c in range(4):
            w[c], wv[c], height, rate = 0.0, 0.0, 0.0, 0.0
            for k in range(D):
                w[c] += travel[c, k] * q[k]
                wv[c] += travel[c, k] * p[k]
                height += wheel[c, k] * q[k]
                rate += wheel[c, k] * p[k]
            moved[c] = w[c] - before[c]
            before[c] = w[c]
            k0, growth, ct, rest = tire[c]
            road = drive[c, i]
            last, following = drive[c, max(i - 1, 0)], drive[c, min(i + 1, steps - 1)]
            squeeze = road - height
            force = rest + k0 * (math.expm1(growth * squeeze) / growth if growth else squeeze)
            if force > 0.0:
                force = max(force + ct * ((following - last) / (2.0 * h) - rate), 0.0)
            now[c] = max(force, 0.0) - rest
            for k in range(D):
                push[k] += wheel[c, k] * now[c] - load[c, k] * drive[4 + c, i]
        for c in range(4):
            rate, n0, slope, gap, bump, preload = spring[c]
            n = n0 + slope * w[c]
            s = n0 * w[c] + 0.5 * slope * w[c] * w[c]
            table, law = shocks[0][c], shocks[1][c]
            damper, after = behind_mount(table, law, states[c], mount[c], s, n * wv[c], h)
            for k in range(5):
                states[c, k] = after[k]
            stop = bump * (s - gap) ** 2 if s > gap else 0.0
            force = n * (damper + preload + rate * s + stop) - n0 * preload
            dry[c, 0] = contact(dry[c, 0], friction[c, 0] * scale[i], friction[c, 1] * moved[c])
            sliding = friction[c, 2] * scale[i]
            dry[c, 1], behind = rubber(dry[c, 1], sliding, friction[c, 3], friction[c, 4], moved[c], wv[c], h)
            force += dry[c, 0] + behind
            axle = c // 2
            other = c + 1 - 2 * (c % 2)
            force += bar[axle, 0] * (w[c] - w[other])
            if c % 2 == 0:
                twist[axle] = contact(twist[axle], bar[axle, 1] * scale[i], bar[axle, 2] * (moved[c] - moved[other]))
            force += twist[axle] * (1 - 2 * (c % 2))
            now[4 + c] = damper
            now[8 + c], now[12 + c] = after[1], after[0]
            now[16 + c], now[20 + c] = s, n * wv[c]
            for k in range(D):
                push[k] -= travel[c, k] * force
        for k in range(D):
            last = a[k]
            a[k] = 0.0
            for j in range(D):
                a[k] += inverse[k, j] * push[j]
            if i:
                p[k] += 0.5 * h * (a[k] - last)
        if i % every == 0:
            for c in range(4):
                now[24 + c] = 0.0
                for k in range(D):
                    now[24 + c] += wheel[c, k] * a[k]
            for k in range(28):
                out[k, i // every] = now[k]
            for k in range(D):
                out[28 + k, i // every] = a[k]
                out[28 + D + k, i // every] = q[k]
    return out
