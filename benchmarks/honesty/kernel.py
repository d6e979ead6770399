"""Compiled core of the reference: a vehicle with its shocks as one set of equations, solved by the Dormand-Prince pair.

    q'' = A_q q + G F + b(t),   F = r (F_v(r S q', z) + seal + gas(r S q)) + friction(S q, S q', y)

with two states for each port: z, the lagged force of its shock (LPF1, LPNL2), and the deflection y of its bristle.

Nothing of the FMUs' or the library's code is used: the formulas are those of docs/reference/ports.md and the READMEs of
fmus/.
"""

from __future__ import annotations

import numpy as np
from numba import njit

POLYLINEAR, LPF1, LPNL2 = range(3)

#: Columns of a shock's parameters.
(LAW, RATIO, UP, DOWN, GAS_RATE, GAS, SEAL, SEAL_SPEED, OWN, FULL, NONE, SPEED, WIDTH, FAST_UP, FAST_DOWN, SLOPE_UP,
 SLOPE_DOWN, DRAG, DRAG_SPEED, BRISTLE, REACH, STATIC, STRIBECK, SPRING, INNER) = range(25)  # fmt: skip
_INNER_COUNT, _OUTER_COUNT = 15, 4
OUTER_UP = INNER + _INNER_COUNT
OUTER_DOWN = OUTER_UP + _OUTER_COUNT
COLUMNS = OUTER_DOWN + _OUTER_COUNT

#: Stages of the pair: nodes, weights, and the difference of its two solutions.
_C = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_A = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_E = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])


@njit(cache=True)
def fitted(p, v):
    """Return the force of the blended polynomials at a damper velocity."""
    share = min(max((abs(v) - p[SPEED]) / p[WIDTH] + 0.5, 0.0), 1.0)
    inner = outer = 0.0
    if share < 1.0:
        s = v / p[SPEED]
        for k in range(_INNER_COUNT - 1, -1, -1):
            inner = inner * s + p[INNER + k]
        inner *= s
    if share > 0.0:
        first = OUTER_UP if v > 0.0 else OUTER_DOWN
        s = (abs(v) - p[SPEED]) / p[SPEED]
        for k in range(_OUTER_COUNT - 1, -1, -1):
            outer = outer * s + p[first + k]
    return (1.0 - share) * inner + share * outer


@njit(cache=True)
def static(p, v):
    """Return F_s [N] at a damper velocity, scales included."""
    if v > p[FAST_UP]:
        force = fitted(p, p[FAST_UP]) + p[SLOPE_UP] * (v - p[FAST_UP])
    elif v < -p[FAST_DOWN]:
        force = fitted(p, -p[FAST_DOWN]) + p[SLOPE_DOWN] * (v + p[FAST_DOWN])
    else:
        force = fitted(p, v)
    return (p[UP] if v > 0.0 else p[DOWN]) * force


@njit(cache=True)
def shock(p, v, x, z):
    """Return the shock's force at the port, and z'."""
    vd = p[RATIO] * v
    fs = static(p, vd)
    law, follows, valves = int(p[LAW]), 0.0, fs
    if law == LPF1:
        valves, follows = z, (fs - z) / p[OWN]
    elif law == LPNL2:
        share = min(max((p[NONE] - abs(fs)) / (p[NONE] - p[FULL]), 0.0), 1.0)
        valves, follows = share * z + (1.0 - share) * fs, (fs - z) / p[OWN]
    drag = p[SEAL] * np.tanh(vd / p[SEAL_SPEED]) if p[SEAL] else 0.0
    force = p[RATIO] * (valves + drag + p[GAS] + p[GAS_RATE] * p[RATIO] * x)
    return force, follows


@njit(cache=True)
def friction(p, v, x, y):
    """Return the force of friction and spring at the port, and y' of a bristle with the deflection y."""
    force, follows = p[SPRING] * x * x, 0.0
    if p[DRAG]:
        force += p[DRAG] * np.tanh(v / p[DRAG_SPEED])
    if p[BRISTLE]:
        share = y / p[REACH]
        force += p[BRISTLE] * share
        follows = v - abs(v) * share / (1.0 + (p[STATIC] - 1.0) * np.exp(-((v / p[STRIBECK]) ** 2)))
    return force, follows


@njit(cache=True)
def slopes(y, push, stiffness, ports, mobility, shocks, into):
    """Write y' for y = (q, q', z, deflections) under accelerations `push` (Q,)."""
    count, rows = push.size, shocks.shape[0]
    for i in range(count):
        into[i] = y[count + i]
        total = push[i]
        for j in range(count):
            total += stiffness[i, j] * y[j]
        into[count + i] = total
    for s in range(rows):
        v = x = 0.0
        for j in range(count):
            x += ports[s, j] * y[j]
            v += ports[s, j] * y[count + j]
        force, follows = shock(shocks[s], v, x, y[2 * count + s])
        drag, bends = friction(shocks[s], v, x, y[2 * count + rows + s])
        force += drag
        into[2 * count + s], into[2 * count + rows + s] = follows, bends
        for i in range(count):
            into[count + i] += mobility[i, s] * force


@njit(cache=True)
def integrate(knots, pushes, stiffness, ports, mobility, shocks, start, sizes, tolerance, most):
    """Return the states (N, n) at the knots (N,) and the number of steps; no step crosses a knot.

    Args:
        knots: Times [s].
        pushes: Accelerations by the drive at these times (N, Q), linear between them.
        stiffness: q'' per q (Q, Q).
        ports: Rows S of the shocks' compression (P, Q).
        mobility: q'' per port force (Q, P).
        shocks: Parameters of the shocks (P, COLUMNS).
        start: State at the first knot (n,).
        sizes: Typical size of each state (n,): a step may have an error of `tolerance` times this.
        tolerance: Relative tolerance [1].
        most: Maximum number of steps; -1 is returned as their number if more are needed.
    """
    n, count = start.size, pushes.shape[1]
    states, y, trial = np.empty((knots.size, n)), start.copy(), np.empty(n)
    k, push = np.empty((7, n)), np.empty(count)
    states[0], step, made = y, 1e-5, 0
    slopes(y, pushes[0], stiffness, ports, mobility, shocks, k[0])
    for m in range(knots.size - 1):
        length, done = knots[m + 1] - knots[m], 0.0
        while done < length:
            last = step >= (length - done) * (1.0 - 1e-9)
            h = length - done if last else step
            for stage in range(1, 7):
                for i in range(n):
                    total = 0.0
                    for j in range(stage):
                        total += _A[stage, j] * k[j, i]
                    trial[i] = y[i] + h * total
                share = min((done + _C[stage] * h) / length, 1.0)
                for i in range(count):
                    push[i] = pushes[m, i] + share * (pushes[m + 1, i] - pushes[m, i])
                slopes(trial, push, stiffness, ports, mobility, shocks, k[stage])
            worst = 0.0
            for i in range(n):
                off = 0.0
                for j in range(7):
                    off += _E[j] * k[j, i]
                worst = max(worst, abs(h * off) / (tolerance * (sizes[i] + abs(y[i]))))
            made += 1
            factor = 5.0 if worst < 1e-4 else 0.9 * worst**-0.2
            if worst <= 1.0:
                y[:], k[0] = trial, k[6]
                done = length if last else done + h
                grown = h * min(5.0, max(0.3, factor))
                step = max(step, grown) if last else grown
            else:
                step = h * min(0.9, max(0.1, factor))
            if made > most or not step > 1e-15:
                return states, -1
        states[m + 1] = y
    return states, made


@njit(cache=True)
def port_forces(states, ports, shocks):
    """Return the forces of the shocks (P, N), and those of friction and springs beside them (P, N)."""
    count, rows = ports.shape[1], shocks.shape[0]
    forces, frictions = np.empty((rows, states.shape[0])), np.zeros((rows, states.shape[0]))
    for s in range(rows):
        for m in range(states.shape[0]):
            v = x = 0.0
            for j in range(count):
                x += ports[s, j] * states[m, j]
                v += ports[s, j] * states[m, count + j]
            forces[s, m], _ = shock(shocks[s], v, x, states[m, 2 * count + s])
            frictions[s, m], _ = friction(shocks[s], v, x, states[m, 2 * count + rows + s])
    return forces, frictions
