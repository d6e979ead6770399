"""FMI 2.0 calls that the loop makes, for an instance of FMI 3.0: whole arrays, single precision, ramps by callback.

The functions run interpreted and compiled, as those of the loop. The value references of the calls are numbers of
*elements*: element e is the number at `place[e]` of variable `owner[e]`, which is an array or a scalar. FMI 3.0 sets
and gets whole arrays only, so the last known values of every array are kept in `doubles` or `singles`.

FMI 3.0 has no input derivatives. The FMU requests new values of its inputs at times within the step, and the callback
`update` then sets those that have a slope. After the step they have their end values.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.engine import blocks
from cosim.engine.blocks import shared
from cosim.engine.plan import Integers, Reals, References
from eightpost.fmi import DISCARD, ERROR, OK

#: Types of real variables; other types are set and read outside the loop.
DOUBLE, SINGLE, OTHER = 0, 1, 2

#: Calls, by number.
SET_REAL, SET_SLOPES, DO_STEP, GET_REAL, SAVE, RESTORE, DERIVE, UPDATE = 0, 1, 2, 3, 4, 5, 6, 7

#: Elements of `clock`: start and size of the step, time reached.
BEGIN, SIZE, REACHED = 0, 1, 2

#: Elements of `counts`: number of ramps, number of restored states (old values of arrays are then unknown), whether the
#: FMU ended the simulation, and the status of the calls in `update`.
RAMPS, RESTORED, ENDED, UPDATED = 0, 1, 2, 3

#: Elements of `flags`, which fmi3DoStep sets.
TERMINATE, EARLY = 1, 2

#: Smallest remainder of a step that is not a rounding error, as a share of the step.
REMAINDER = 1e-3


class Adapter(NamedTuple):
    """One instance: addresses of its functions, its variables (V,), their elements (E,), and work arrays.

    `slack`: internal step of the FMU, by which it may stay behind the end of a step [s]; 0 if it declares none.
    `instance` (1,): pointer that the FMU returned. `reference`, `kind`, `size`, `begin` (V,): value reference, type,
    number of elements, and index of the first one in `doubles` or `singles`. `known` (V,): value of `counts[RESTORED]`
    at which those values were last set or read. `last`, `last_known` (E,): value to which an element was last set, and
    the same number for it. `batch_*`: scalars of one call. `ramp_*`: elements that have a slope. `is_ramped` (E,): 1
    for those. `clock` (3,), `counts` (4,) and `flags` (3,): see the constants.
    """

    set_double: int
    get_double: int
    set_single: int
    get_single: int
    do_step: int
    save: int
    restore: int
    derive: int
    slack: float
    instance: Integers
    owner: Integers
    place: Integers
    reference: References
    kind: Integers
    size: Integers
    begin: Integers
    known: Integers
    doubles: Reals
    singles: NDArray[np.float32]
    last: Reals
    last_known: Integers
    batch_reference: References
    batch_place: Integers
    batch_value: Reals
    ramp_element: References
    ramp_start: Reals
    ramp_slope: Reals
    ramp_value: Reals
    is_ramped: Integers
    clock: Reals
    counts: Integers
    flags: NDArray[np.uint8]


@shared
def _is_refused(status: int) -> bool:
    """Return whether a status is an error."""
    return status > 1 or status < 0


@shared
def _are_elements(a: Adapter, references: int, count: int) -> bool:
    """Return whether all references are numbers of elements."""
    are_known = True
    for k in range(count):
        are_known = are_known and blocks.reference_at(references, k) < a.owner.size
    return are_known


@shared
def is_plain(a: Adapter, v: int) -> bool:
    """Return whether a variable is one double."""
    plain: bool = a.kind[v] == DOUBLE and a.size[v] == 1
    return plain


@shared
def _call_variable(a: Adapter, double: int, single: int, v: int) -> int:
    """Set or get all elements of a variable with one of two functions."""
    reference = a.reference.ctypes.data + 4 * v
    if a.kind[v] == DOUBLE:
        values = a.doubles.ctypes.data + 8 * a.begin[v]
        return blocks.exchange_sized(double, a.instance[0], reference, 1, values, a.size[v])
    if a.kind[v] == SINGLE:
        values = a.singles.ctypes.data + 4 * a.begin[v]
        return blocks.exchange_sized(single, a.instance[0], reference, 1, values, a.size[v])
    return ERROR


@shared
def _read_variable(a: Adapter, v: int) -> int:
    """Read all elements of a variable."""
    status = _call_variable(a, a.get_double, a.get_single, v)
    if not _is_refused(status):
        a.known[v] = a.counts[RESTORED]
    return status


@shared
def _change_element(a: Adapter, e: int, value: float) -> int:
    """Change the kept value of an element; the other elements of its array are read first if they are not known."""
    v = a.owner[e]
    if a.kind[v] == OTHER:
        return ERROR
    if a.size[v] > 1 and a.known[v] != a.counts[RESTORED]:
        status = _read_variable(a, v)
        if _is_refused(status):
            return status
    if a.kind[v] == SINGLE:
        a.singles[a.begin[v] + a.place[e]] = value
    else:
        a.doubles[a.begin[v] + a.place[e]] = value
    return OK


@shared
def _set_part(a: Adapter, references: int, count: int, k: int, value: float) -> int:
    """Set the element of reference k; an array is passed to the FMU with the last one of its elements in a row."""
    e = blocks.reference_at(references, k)
    v = a.owner[e]
    status = _change_element(a, e, value)
    if _is_refused(status) or (k + 1 < count and a.owner[blocks.reference_at(references, k + 1)] == v):
        return status
    return _call_variable(a, a.set_double, a.set_single, v)


@shared
def set_real(a: Adapter, references: int, count: int, values: int) -> int:
    """Set elements: doubles in one call, every other variable in its own; return the most severe status."""
    if not _are_elements(a, references, count):
        return ERROR
    plain, worst = 0, OK
    for k in range(count):
        e, value = blocks.reference_at(references, k), blocks.real_at(values, k)
        a.last[e], a.last_known[e] = value, a.counts[RESTORED]
        if is_plain(a, a.owner[e]):
            a.batch_reference[plain] = a.reference[a.owner[e]]
            a.batch_value[plain] = value
            plain += 1
            continue
        status = _set_part(a, references, count, k, value)
        if _is_refused(status):
            return status
        worst = max(worst, status)
    if plain == 0:
        return worst
    at, numbers = a.batch_reference.ctypes.data, a.batch_value.ctypes.data
    status = blocks.exchange_sized(a.set_double, a.instance[0], at, plain, numbers, plain)
    return status if _is_refused(status) else max(worst, status)


@shared
def _get_parts(a: Adapter, references: int, count: int, values: int) -> int:
    """Get the elements that are not plain doubles, each variable with one call."""
    before, worst = -1, OK
    for k in range(count):
        e = blocks.reference_at(references, k)
        v = a.owner[e]
        if is_plain(a, v):
            continue
        if v != before:
            status = _read_variable(a, v)
            if _is_refused(status):
                return status
            worst, before = max(worst, status), v
        place = a.begin[v] + a.place[e]
        blocks.put_real(values, k, a.singles[place] if a.kind[v] == SINGLE else a.doubles[place])
    return worst


@shared
def get_real(a: Adapter, references: int, count: int, values: int) -> int:
    """Get elements: doubles in one call, every other variable in its own; return the most severe status."""
    if not _are_elements(a, references, count):
        return ERROR
    plain = 0
    for k in range(count):
        v = a.owner[blocks.reference_at(references, k)]
        if is_plain(a, v):
            a.batch_reference[plain], a.batch_place[plain] = a.reference[v], k
            plain += 1
    worst = OK if plain == count else _get_parts(a, references, count, values)
    if _is_refused(worst) or plain == 0:
        return worst
    at, numbers = a.batch_reference.ctypes.data, a.batch_value.ctypes.data
    status = blocks.exchange_sized(a.get_double, a.instance[0], at, plain, numbers, plain)
    for k in range(plain):
        blocks.put_real(values, a.batch_place[k], a.batch_value[k])
    return status if _is_refused(status) else max(worst, status)


@shared
def set_slopes(a: Adapter, references: int, count: int, orders: int, values: int) -> int:
    """Store the first derivatives of elements for the next step."""
    if not _are_elements(a, references, count):
        return ERROR
    for k in range(count):
        if blocks.order_at(orders, k) != 1:
            return ERROR
        e = blocks.reference_at(references, k)
        if a.is_ramped[e] == 0:
            a.is_ramped[e] = 1
            a.ramp_element[a.counts[RAMPS]] = e
            a.counts[RAMPS] += 1
        a.ramp_slope[e] = blocks.real_at(values, k)
    return OK


@shared
def _set_ramps(a: Adapter, passed: float) -> int:
    """Set the elements that have a slope to their values `passed` [s] after the start of the step."""
    count = a.counts[RAMPS]
    if count == 0:
        return OK
    for k in range(count):
        e = a.ramp_element[k]
        a.ramp_value[k] = a.ramp_start[e] + a.ramp_slope[e] * passed
    return set_real(a, a.ramp_element.ctypes.data, count, a.ramp_value.ctypes.data)


@shared
def _start_ramps(a: Adapter) -> int:
    """Store the values from which ramps start; those that were not set since a state was restored are read."""
    for k in range(a.counts[RAMPS]):
        e = a.ramp_element[k]
        if a.last_known[e] == a.counts[RESTORED]:
            a.ramp_start[e] = a.last[e]
            continue
        status = get_real(a, a.ramp_element.ctypes.data + 4 * k, 1, a.ramp_value.ctypes.data)
        if _is_refused(status):
            return status
        a.ramp_start[e] = a.ramp_value[0]
    return OK


@shared
def clear_ramps(a: Adapter) -> None:
    """Forget all slopes."""
    for k in range(a.counts[RAMPS]):
        a.is_ramped[a.ramp_element[k]] = 0
    a.counts[RAMPS] = 0


@shared
def update(a: Adapter, time: float, requested: int, early: int) -> int:
    """Set the inputs that have a slope at `time` [s] if the FMU requests it; never return from the step early."""
    if early != 0:
        blocks.put_byte(early, 0)
    if requested == 0:
        return OK
    # The end of the step is not rounded, so that the inputs have the same values there as with input derivatives.
    at_end = time == a.clock[BEGIN] + a.clock[SIZE]
    status = _set_ramps(a, a.clock[SIZE] if at_end else time - a.clock[BEGIN])
    a.counts[UPDATED] = max(a.counts[UPDATED], status)
    return OK


@shared
def stopped(a: Adapter) -> bool:
    """Return whether the FMU did not complete the step or ended the simulation."""
    rest = a.clock[BEGIN] + a.clock[SIZE] - a.clock[REACHED]
    behind = rest > REMAINDER * a.clock[SIZE] and rest > a.slack * (1.0 + REMAINDER)
    is_stopped: bool = a.counts[ENDED] == 1 or a.flags[EARLY] != 0 or behind
    return is_stopped


@shared
def do_step(a: Adapter, time: float, step: float, final: int) -> int:
    """Step from `time` by `step` [s]; a step that the FMU does not complete without an error is a discarded one."""
    a.clock[BEGIN], a.clock[SIZE], a.clock[REACHED] = time, step, time + step
    a.flags[TERMINATE], a.flags[EARLY] = 0, 0
    a.counts[UPDATED] = OK
    status = _start_ramps(a)
    if _is_refused(status):
        return status
    flags, reached = a.flags.ctypes.data, a.clock.ctypes.data + 8 * REACHED
    status = blocks.take_step(a.do_step, a.instance[0], time, step, final, flags, reached)
    a.counts[ENDED] = 1 if a.flags[TERMINATE] != 0 else 0
    status = status if _is_refused(status) else max(status, a.counts[UPDATED])
    if not _is_refused(status) and stopped(a):
        status = DISCARD
    if not _is_refused(status):
        status = max(status, _set_ramps(a, step))
    clear_ramps(a)
    return status


@shared
def save(a: Adapter, state: int) -> int:
    """Save the state into the pointer at the address `state`."""
    return blocks.call_state(a.save, a.instance[0], state)


@shared
def restore(a: Adapter, state: int) -> int:
    """Restore a state; the values of arrays are then unknown, and slopes of the undone step are dropped."""
    a.counts[RESTORED] += 1
    clear_ramps(a)
    return blocks.call_state(a.restore, a.instance[0], state)


@shared
def refer(a: Adapter, references: int, count: int, first: int) -> int:
    """Put the value references of elements into a batch, from `first` on; those of plain doubles only."""
    if not _are_elements(a, references, count) or first + count > a.batch_reference.size:
        return ERROR
    status = OK
    for k in range(count):
        v = a.owner[blocks.reference_at(references, k)]
        a.batch_reference[first + k] = a.reference[v]
        status = status if is_plain(a, v) else ERROR
    return status


@shared
def derive(a: Adapter, unknowns: int, sought: int, knowns: int, given: int, changes: int, result: int) -> int:
    """Write how plain doubles change, without delay, with others."""
    if refer(a, unknowns, sought, 0) != OK or refer(a, knowns, given, sought) != OK:
        return ERROR
    at = a.batch_reference.ctypes.data
    return blocks.derive_sized(a.derive, a.instance[0], at, sought, at + 4 * sought, given, changes, result)


@shared
def call(  # noqa: PLR0911
    a: Adapter, what: int, p: int, q: int, r: int, s: int, t: int, u: int, x: float, y: float
) -> int:
    """Make one call with its integers and addresses (p to u) and its real numbers (x, y), each in the call's order."""
    if what == SET_REAL:
        return set_real(a, p, q, r)
    if what == GET_REAL:
        return get_real(a, p, q, r)
    if what == SET_SLOPES:
        return set_slopes(a, p, q, r, s)
    if what == DO_STEP:
        return do_step(a, x, y, p)
    if what == SAVE:
        return save(a, p)
    if what == RESTORE:
        return restore(a, p)
    if what == DERIVE:
        return derive(a, p, q, r, s, t, u)
    return update(a, x, p, t)


#: Arguments of the C functions, in the order of their numbers.
ENTRIES = {
    "fmi2SetReal": ("pointer", "pointer", "size", "pointer"),
    "fmi2SetRealInputDerivatives": ("pointer", "pointer", "size", "pointer", "pointer"),
    "fmi2DoStep": ("pointer", "real", "real", "int"),
    "fmi2GetReal": ("pointer", "pointer", "size", "pointer"),
    "fmi2GetFMUstate": ("pointer", "pointer"),
    "fmi2SetFMUstate": ("pointer", "pointer"),
    "fmi2GetDirectionalDerivative": ("pointer", "pointer", "size", "pointer", "size", "pointer", "pointer"),
    "intermediateUpdate": ("pointer", "real", "byte", "byte", "byte", "byte", "pointer", "pointer"),
}
