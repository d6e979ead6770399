"""Implicit coupling: a step is repeated until the assumed coupling values equal the computed ones.

The unknowns g are the signals at the end of the step that are needed before their part has stepped (for a car and its
shocks: the shock forces). A sweep from the same start gives G(g); the step is found when f(g) = g - G(g) = 0.
Broyden's method updates an inverse Jacobian of f, which is kept from step to step. It is computed again by differences
at the beginning and if the iteration fails (Kelley, Iterative Methods for Linear and Nonlinear Equations, 1995,
chapter 7; for whole steps of a co-simulation: Sicklinger et al., Interface Jacobian-based co-simulation, 2014).
"""

from __future__ import annotations

from cosim.engine import blocks
from cosim.engine.compiled import shared
from cosim.engine.plan import (
    GUESSED,
    IMPLICIT,
    ITERATIONS,
    JACOBIANS,
    LOOSE,
    RESTORE,
    SAVE,
    Drive,
    Memory,
    Mode,
    Plan,
    Reals,
    Step,
)
from cosim.engine.sweep import call, failed, on_parabola, sweep

#: Purpose of the last sweep of an implicit step, other than the first sweep.
_MOVED, _DIFFERENCED = 1, 2

#: Index of a part's two saved states that an implicit step uses.
_OWN_STATE = 1

#: Factor on the tolerance for parts whose output jumps slightly, so that no better agreement is possible.
_JUMP = 100.0

#: Change of an unknown for a difference, relative to its size.
_DIFFERENCE = 1e-5


@shared
def save_parts(plan: Plan, m: Memory, first: int, last: int, slot: int) -> int:
    """Save the states of the parts first to last - 1; return 1 if one refused."""
    for c in range(first, last):
        index = slot * plan.parts.instance.size + c
        call(m, c)
        status = blocks.save_state(plan.parts.save[c], plan.parts.instance[c], m.states, index)
        if failed(m, status, c, SAVE):
            return 1
    return 0


@shared
def restore_parts(plan: Plan, m: Memory, first: int, last: int, slot: int) -> int:
    """Restore the saved states; return 1 if a part refused."""
    for c in range(first, last):
        index = slot * plan.parts.instance.size + c
        call(m, c)
        status = blocks.restore_state(plan.parts.restore[c], plan.parts.instance[c], m.states, index)
        if failed(m, status, c, RESTORE):
            return 1
    return 0


@shared
def _disagreement(plan: Plan, m: Memory, g: int, f: Reals) -> None:
    first = plan.loops.unknowns[g]
    for i in range(f.size):
        s = plan.loops.signal[first + i]
        f[i] = m.guess[s] - m.ahead[s]


@shared
def _size(plan: Plan, m: Memory, u: int) -> float:
    """Return the size of an unknown: its largest value so far."""
    s = plan.loops.signal[u]
    size: float = max(m.size[u], abs(m.now[s]), abs(m.ahead[s]))
    m.size[u] = size
    return size


@shared
def _agrees(plan: Plan, m: Memory, g: int, f: Reals, tolerance: float) -> bool:
    for i in range(f.size):  # noqa: SIM110 -- the loop is compiled, a generator cannot be
        if not abs(f[i]) <= tolerance * _size(plan, m, plan.loops.unknowns[g] + i):
            return False
    return True


@shared
def _invert(a: Reals, n: int, inverse: Reals) -> None:
    """Invert by Gauss-Jordan elimination with row pivots; a and inverse are (n*n,), row by row; a is overwritten."""
    for k in range(n * n):
        inverse[k] = 1.0 if k // n == k % n else 0.0
    for p in range(n):
        best = p
        for i in range(p + 1, n):
            if abs(a[i * n + p]) > abs(a[best * n + p]):
                best = i
        if a[best * n + p] == 0.0:
            continue
        pivot = 1.0 / a[best * n + p]
        for j in range(n):
            x, y = a[best * n + j], inverse[best * n + j]
            a[best * n + j], inverse[best * n + j] = a[p * n + j], inverse[p * n + j]
            a[p * n + j], inverse[p * n + j] = x * pivot, y * pivot
        for i in range(n):
            factor = a[i * n + p]
            if i != p and factor != 0.0:
                for j in range(n):
                    a[i * n + j] -= factor * a[p * n + j]
                    inverse[i * n + j] -= factor * inverse[p * n + j]


@shared
def _disturb(plan: Plan, m: Memory, g: int, j: int) -> None:
    """Change unknown j of group g for a difference."""
    u = plan.loops.unknowns[g] + j
    s = plan.loops.signal[u]
    m.kept[0] = m.guess[s]
    m.kept[1] = _DIFFERENCE * _size(plan, m, u)
    m.guess[s] += m.kept[1]


@shared
def _take_difference(plan: Plan, m: Memory, g: int, j: int) -> None:
    """Compute column j of the Jacobian from a sweep with unknown j disturbed; undo the disturbance."""
    first, last, at = plan.loops.unknowns[g], plan.loops.unknowns[g + 1], plan.loops.matrix[g]
    f, moved = m.missed[first:last], m.after[first:last]
    _disagreement(plan, m, g, moved)
    m.guess[plan.loops.signal[first + j]] = m.kept[0]
    for i in range(f.size):
        m.jacobian[at + i * f.size + j] = (moved[i] - f[i]) / m.kept[1]


@shared
def _broyden(plan: Plan, m: Memory, g: int) -> None:
    """Update the inverse H for a move s that changed f by y: H += (s - H y) s'H / s'Hy (Sherman and Morrison)."""
    first, last, at = plan.loops.unknowns[g], plan.loops.unknowns[g + 1], plan.loops.matrix[g]
    move, change, left, right = m.move[first:last], m.change[first:last], m.left[first:last], m.right[first:last]
    n, denominator = move.size, 0.0
    for i in range(n):
        left[i] = right[i] = 0.0
        for j in range(n):
            left[i] += m.inverse[at + i * n + j] * change[j]
            right[i] += move[j] * m.inverse[at + j * n + i]
        denominator += move[i] * left[i]
    if denominator != 0.0:
        for i in range(n):
            missing = (move[i] - left[i]) / denominator
            for j in range(n):
                m.inverse[at + i * n + j] += missing * right[j]


@shared
def _move(plan: Plan, m: Memory, g: int) -> None:
    """Make a quasi-Newton move of the guess."""
    first, last, at = plan.loops.unknowns[g], plan.loops.unknowns[g + 1], plan.loops.matrix[g]
    f, move = m.missed[first:last], m.move[first:last]
    for i in range(f.size):
        move[i] = 0.0
        for j in range(f.size):
            move[i] -= m.inverse[at + i * f.size + j] * f[j]
        m.guess[plan.loops.signal[first + i]] += move[i]


@shared
def _learn(plan: Plan, m: Memory, g: int) -> None:
    """Compute the disagreement after a move, and update the inverse Jacobian."""
    first, last = plan.loops.unknowns[g], plan.loops.unknowns[g + 1]
    f, after, change = m.missed[first:last], m.after[first:last], m.change[first:last]
    _disagreement(plan, m, g, after)
    for i in range(f.size):
        change[i] = after[i] - f[i]
        f[i] = after[i]
    _broyden(plan, m, g)


@shared
def _begin(plan: Plan, m: Memory, g: int, step: Step) -> int:
    """Predict the unknowns from the last steps, and save the states; return 1 if a part refused."""
    for u in range(plan.loops.unknowns[g], plan.loops.unknowns[g + 1]):
        s = plan.loops.signal[u]
        m.guess[s] = on_parabola(m, s, step)
    return save_parts(plan, m, plan.loops.parts[g], plan.loops.parts[g + 1], _OWN_STATE)


@shared
def _next_guess(plan: Plan, m: Memory, g: int, tolerance: float, most: int) -> int:
    """Evaluate a sweep; return 1 with the guess for the next one, 0 if the step has converged or is given up.

    `m.turn`: the kind of the sweep (FIRST, DIFFERENCE, MOVED), its column, the number of moves since the Jacobian was
    computed, and whether it was computed again in this step.
    """
    first, last, at, turn = plan.loops.unknowns[g], plan.loops.unknowns[g + 1], plan.loops.matrix[g], m.turn
    f = m.missed[first:last]
    if turn[0] == _DIFFERENCED:
        _take_difference(plan, m, g, turn[1])
        turn[1] += 1
        if turn[1] < f.size:
            _disturb(plan, m, g, turn[1])
            return 1
        _invert(m.jacobian[at : at + f.size * f.size], f.size, m.inverse[at : at + f.size * f.size])
        m.known[g] = turn[3] = 1
        turn[2] = 0
    elif turn[0] == _MOVED:
        _learn(plan, m, g)
    else:
        _disagreement(plan, m, g, f)
    if turn[0] != _DIFFERENCED and _agrees(plan, m, g, f, tolerance):
        return 0
    if m.known[g] == 0 or (turn[2] == most and turn[3] == 0):
        m.counts[JACOBIANS] += 1
        turn[0], turn[1] = _DIFFERENCED, 0
        _disturb(plan, m, g, 0)
        return 1
    if turn[2] == most:
        m.counts[LOOSE] += 0 if _agrees(plan, m, g, f, _JUMP * tolerance) else 1
        m.known[g] = 0
        return 0
    _move(plan, m, g)
    turn[0] = _MOVED
    turn[2] += 1
    return 1


@shared
def step_group(plan: Plan, m: Memory, g: int, drive: Drive, step: Step, mode: Mode) -> int:
    """Step group g: once or, if the scheme is implicit, until its unknowns agree; return 1 if a part refused.

    A step that did not converge is counted, and its last iterate is kept.
    """
    first, last = plan.loops.parts[g], plan.loops.parts[g + 1]
    repeats = mode.kind == IMPLICIT and plan.loops.unknowns[g + 1] > plan.loops.unknowns[g]
    sequential, values = min(mode.kind, 1), GUESSED if mode.kind == IMPLICIT else mode.values
    if repeats and _begin(plan, m, g, step):
        return 1
    m.turn[0] = m.turn[2] = m.turn[3] = 0
    while True:
        if sweep(plan, m, g, drive, step, sequential, values, mode.final):
            return 1
        if not repeats:
            return 0
        m.counts[ITERATIONS] += 1
        if _next_guess(plan, m, g, mode.tolerance, mode.most) == 0:
            return 0
        if restore_parts(plan, m, first, last, _OWN_STATE):
            return 1


@shared
def step_once(plan: Plan, m: Memory, g: int, drive: Drive, step: Step, mode: Mode) -> int:
    """Do the same as step_group for explicit schemes, so that the rest of this file need not be compiled."""
    return sweep(plan, m, g, drive, step, min(mode.kind, 1), mode.values, mode.final)
