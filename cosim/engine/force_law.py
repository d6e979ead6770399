"""Shocks as force laws of a foreign integrator: evaluation at trial points, from the last accepted state.

One call evaluates all corners. Corner i has row i in every table. All functions run interpreted and compiled.
"""

from __future__ import annotations

from typing import NamedTuple

from cosim.engine import blocks
from cosim.engine.blocks import shared
from cosim.engine.plan import GET, RESTORE, SAVE, SET, SLOPES, STEP, Integers, Reals

#: Operations of `operate`.
TRIAL, ACCEPT, DIFFERENTIATE, FOLLOW, HOLD = 0, 1, 2, 3, 4

#: Results of `operate`.
DONE, REFUSED, NOT_FINITE, BACKWARD = 0, 1, 2, 3

#: Without input derivatives, the inputs have their end values over this last part of a step, because the force at the
#: end of the step follows the inputs that the FMU has then.
END_PART = 1.0 / 1024.0


class Ports(NamedTuple):
    """Functions and ports of the corners, (N,) unless another shape is given.

    `ramped`: 1 if the FMU takes input derivatives. `inputs`, `orders`, `output`: addresses of value references, of
    orders of derivatives and of the force's value reference. `width`: 2 with a displacement input, 1 without. `values`,
    `slopes`, `read`: addresses of the rows of `Motion`. `scale`, `offset` (N, 3): an input is `scale * SI + offset`;
    the force is `scale * value + offset`.

    `shortest`: largest time difference that counts as none [s], and the step over which the inputs then jump.
    `difference`: change of an input for the Jacobian [m/s], [m].
    """

    set_real: Integers
    set_slopes: Integers
    do_step: Integers
    get_real: Integers
    save: Integers
    restore: Integers
    instance: Integers
    ramped: Integers
    inputs: Integers
    orders: Integers
    output: Integers
    width: Integers
    values: Integers
    slopes: Integers
    read: Integers
    scale: Reals
    offset: Reals
    shortest: float
    difference: float


class Motion(NamedTuple):
    """Accepted and trial points in SI units, work arrays, and results.

    `clock` (3,): accepted time, trial time, and the time of `reached`; NaN if the FMUs are in no known trial state [s].
    `accepted`, `trial`, `reached` (N, 2): velocity [m/s] and displacement [m]. `values`, `slopes` (N, 2) and `read`
    (N,): numbers in the FMU's own units. `force` (N,) [N]. `jacobian` (N, 2): derivatives of the force with respect to
    velocity [N.s/m] and displacement [N/m]. `around` (4,): slopes about a point. `states` (N,): saved states.
    `failure` (3,): status, corner, refused call.
    """

    clock: Reals
    accepted: Reals
    trial: Reals
    reached: Reals
    values: Reals
    slopes: Reals
    read: Reals
    force: Reals
    jacobian: Reals
    around: Reals
    states: Integers
    failure: Integers


@shared
def refuses(m: Motion, status: int, i: int, call: int) -> int:
    """Record a refused call; return 1 if the status is an error."""
    if status > 1 or status < 0:
        m.failure[0] = status
        m.failure[1] = i
        m.failure[2] = call
        return 1
    return 0


@shared
def _set_inputs(p: Ports, m: Motion, i: int, share: float) -> int:
    """Set the inputs of corner i to the point that lies this share of the way from the accepted to the trial point."""
    for k in range(2):
        value = (1.0 - share) * m.accepted[i, k] + share * m.trial[i, k]
        m.values[i, k] = p.scale[i, k] * value + p.offset[i, k]
    return refuses(m, blocks.exchange(p.set_real[i], p.instance[i], p.inputs[i], p.width[i], p.values[i]), i, SET)


@shared
def _set_ramp(p: Ports, m: Motion, i: int, h: float) -> int:
    """Set the slopes with which the inputs of corner i reach the trial point in `h` [s]."""
    for k in range(2):
        m.slopes[i, k] = p.scale[i, k] * (m.trial[i, k] - m.accepted[i, k]) / h
    status = blocks.set_slopes(p.set_slopes[i], p.instance[i], p.inputs[i], p.width[i], p.orders[i], p.slopes[i])
    return refuses(m, status, i, SLOPES)


@shared
def _held_step(p: Ports, m: Motion, i: int, share: float, time: float, h: float) -> int:
    """Step corner i from `time` by `h` [s] with held inputs."""
    if _set_inputs(p, m, i, share):
        return 1
    return refuses(m, blocks.do_step(p.do_step[i], p.instance[i], time, h, 0), i, STEP)


@shared
def advance(p: Ports, m: Motion, i: int, h: float) -> int:
    """Step corner i from the accepted to the trial point in `h` [s]; the inputs are ramped, or held if they must be."""
    time = m.clock[0]
    if h <= p.shortest:
        return _held_step(p, m, i, 1.0, time, p.shortest)
    if p.ramped[i] == 1:
        if _set_inputs(p, m, i, 0.0) or _set_ramp(p, m, i, h):
            return 1
        return refuses(m, blocks.do_step(p.do_step[i], p.instance[i], time, h, 0), i, STEP)
    first = h * (1.0 - END_PART)
    if _held_step(p, m, i, (0.5 - END_PART) / (1.0 - END_PART), time, first):
        return 1
    return _held_step(p, m, i, 1.0, time + first, h - first)


@shared
def _read_force(p: Ports, m: Motion, i: int) -> int:
    """Read the force of corner i."""
    if refuses(m, blocks.exchange(p.get_real[i], p.instance[i], p.output[i], 1, p.read[i]), i, GET):
        return 1
    m.force[i] = p.scale[i, 2] * m.read[i] + p.offset[i, 2]
    return 0


@shared
def _try_point(p: Ports, m: Motion, i: int) -> int:
    """Evaluate corner i at its trial point from the accepted state."""
    if refuses(m, blocks.call_state(p.restore[i], p.instance[i], m.states[i]), i, RESTORE):
        return 1
    return 1 if advance(p, m, i, m.clock[1] - m.clock[0]) else _read_force(p, m, i)


@shared
def _check_point(p: Ports, m: Motion) -> int:
    """Return why the trial point cannot be used: NOT_FINITE or BACKWARD; DONE if it can."""
    h = m.clock[1] - m.clock[0]
    if h - h != 0.0:  # infinite or NaN
        return NOT_FINITE
    for i in range(p.instance.size):
        for k in range(2):
            if m.trial[i, k] - m.trial[i, k] != 0.0:
                return NOT_FINITE
    return BACKWARD if h < -p.shortest else DONE


@shared
def _is_reached(p: Ports, m: Motion) -> int:
    """Return 1 if the FMUs are at the trial point already."""
    if m.clock[2] != m.clock[1]:
        return 0
    for i in range(p.instance.size):
        if m.reached[i, 0] != m.trial[i, 0] or m.reached[i, 1] != m.trial[i, 1]:
            return 0
    return 1


@shared
def _try_points(p: Ports, m: Motion) -> int:
    """Evaluate all corners at their trial points."""
    m.clock[2] = float("nan")
    for i in range(p.instance.size):
        if _try_point(p, m, i):
            return REFUSED
        for k in range(2):
            m.reached[i, k] = m.trial[i, k]
    m.clock[2] = m.clock[1]
    return DONE


@shared
def _keep_point(p: Ports, m: Motion) -> None:
    """Make the trial point the accepted one."""
    m.clock[2] = float("nan")
    if m.clock[1] - m.clock[0] > p.shortest:
        m.clock[0] = m.clock[1]
    for i in range(p.instance.size):
        for k in range(2):
            m.accepted[i, k] = m.trial[i, k]


@shared
def _accept_points(p: Ports, m: Motion) -> int:
    """Make the trial points the accepted ones, and save the states there."""
    if not _is_reached(p, m) and _try_points(p, m):
        return REFUSED
    if m.clock[1] - m.clock[0] > p.shortest:
        for i in range(p.instance.size):
            if refuses(m, blocks.call_state(p.save[i], p.instance[i], m.states.ctypes.data + 8 * i), i, SAVE):
                return REFUSED
    _keep_point(p, m)
    return DONE


@shared
def _slope_about(p: Ports, m: Motion, i: int, k: int) -> int:
    """Compute the derivative of corner i's force with respect to its input k, from four adjacent slopes.

    The forces of shocks have kinks, and tiny jumps where a law divides its step into one more piece. The mean of the
    two inner slopes and that of the two outer ones are central differences; the pair that differs less has no jump.
    """
    place, before, last = m.trial[i, k], 0.0, 0.0
    for j in range(5):
        m.trial[i, k] = place + (j - 2) * p.difference
        if _try_point(p, m, i):
            m.trial[i, k] = place
            return 1
        if j > 0:
            m.around[j - 1] = (m.force[i] - last) / (m.trial[i, k] - before)
        last, before = m.force[i], m.trial[i, k]
    m.trial[i, k] = place
    inner = abs(m.around[1] - m.around[2]) <= abs(m.around[0] - m.around[3])
    m.jacobian[i, k] = 0.5 * (m.around[1] + m.around[2]) if inner else 0.5 * (m.around[0] + m.around[3])
    return 0


@shared
def _differentiate(p: Ports, m: Motion) -> int:
    """Compute the derivatives of all forces at the trial points."""
    m.clock[2] = float("nan")
    for i in range(p.instance.size):
        for k in range(p.width[i]):
            if _slope_about(p, m, i, k):
                return REFUSED
    return DONE


@shared
def _follow_points(p: Ports, m: Motion) -> int:
    """Step all corners to their trial points, without return."""
    h = m.clock[1] - m.clock[0]
    for i in range(p.instance.size):
        if advance(p, m, i, h) or _read_force(p, m, i):
            return REFUSED
    _keep_point(p, m)
    return DONE


@shared
def _hold_points(p: Ports, m: Motion) -> int:
    """Step all corners to the trial time with their inputs held at the trial values, without return."""
    h = m.clock[1] - m.clock[0]
    for i in range(p.instance.size):
        if _held_step(p, m, i, 1.0, m.clock[0], h) or _read_force(p, m, i):
            return REFUSED
    _keep_point(p, m)
    return DONE


@shared
def operate(p: Ports, m: Motion, operation: int) -> int:
    """Run one operation on all corners; return DONE or the reason why it failed."""
    reason = _check_point(p, m)
    if reason != DONE:
        return reason
    if operation == TRIAL:
        return _try_points(p, m)
    if operation == ACCEPT:
        return _accept_points(p, m)
    if operation == DIFFERENTIATE:
        return _differentiate(p, m)
    return _follow_points(p, m) if operation == FOLLOW else _hold_points(p, m)
