"""One coupling step of a group of parts: one sweep, in which each part steps once, or several for an implicit step."""

from __future__ import annotations

from cosim.engine import blocks
from cosim.engine.blocks import shared
from cosim.engine.plan import (
    DERIVE,
    EXTRAPOLATED,
    GET,
    GUESSED,
    HELD,
    IMPLICIT,
    INTERPOLATED,
    ITERATIONS,
    JACOBIANS,
    LOOSE,
    PARABOLIC,
    RESTORE,
    SAVE,
    SET,
    SLOPES,
    STEP,
    Drive,
    Memory,
    Mode,
    Plan,
    Reals,
    Step,
)

# ==== One sweep: every part of a group is fed and stepped once, in order =============================================


@shared
def pace_of(m: Memory, h: float) -> float:
    """Return 1 / h [1/s], which is stored if the last step had the same size."""
    pace: float = m.pace[0] if h == m.last[0] else 1.0 / h
    return pace


@shared
def step_from(m: Memory, time: float, h: float, first: int, last: int) -> Step:
    """Return a coupling step of `h` from `time` [s], with the factors of straight lines and parabolas over it."""
    again = h == m.last[0]  # true for most steps, which then need no division
    bend = h if again and h == m.last[1] else h * (h + m.last[0]) / (m.last[0] + m.last[1])
    return Step(
        time=time,
        size=h,
        first=first,
        last=last,
        per_second=pace_of(m, h),
        line=h * m.pace[0],
        newer=(h + bend) * m.pace[0],
        older=bend * m.pace[1],
        sag=1.0 / 6.0 if again else h / (3.0 * (h + m.last[0])),
    )


@shared
def _on_parabola(m: Memory, s: int, step: Step) -> float:
    """Return a signal at the end of the step, extrapolated with the last two steps' slopes and their change."""
    end: float = m.now[s] + (m.now[s] - m.past[s]) * step.newer - (m.past[s] - m.older[s]) * step.older
    return end


@shared
def _start(m: Memory, s: int, end: float, step: Step) -> float:
    """Return the start of a straight line to `end` with a parabola's mean: it is wrong in the third order only."""
    now = m.now[s]
    start: float = now - (end - now - (now - m.past[s]) * step.line) * step.sag
    return start


@shared
def _known(m: Memory, s: int, step: Step, mode: int) -> tuple[float, float]:
    """Return a signal at both ends of the step, for a part that has made the step."""
    end = m.ahead[s]
    return (_start(m, s, end, step) if mode > EXTRAPOLATED else m.now[s]), end


@shared
def _supposed(m: Memory, s: int, step: Step, mode: int) -> tuple[float, float]:
    """Return a signal at both ends of the step, for a part that has not made the step."""
    if mode > EXTRAPOLATED:
        end = _on_parabola(m, s, step) if mode == PARABOLIC else m.guess[s]
        return _start(m, s, end, step), end
    now = m.now[s]
    if mode == INTERPOLATED:
        return m.past[s], now
    return now, now + (now - m.past[s]) * step.line


@shared
def _assume(plan: Plan, m: Memory, first: int, last: int, step: Step) -> None:
    """Store the parabolic prediction as the assumption of guessed terms: it measures an implicit step's error."""
    terms = plan.terms
    for k in range(plan.parts.terms[first], plan.parts.terms[last]):
        if terms.early[k] == 0:
            m.assumed[k] = terms.weight[k] * _on_parabola(m, terms.source[k], step) + terms.offset[k]


@shared
def _take_values(plan: Plan, m: Memory, first: int, last: int, sequential: int) -> None:
    """Compute the inputs from other parts if they are held: no slopes, half the work of _take_lines."""
    parts, terms = plan.parts, plan.terms
    for k in range(parts.terms[first], parts.terms[last]):
        s = terms.source[k]
        x = m.ahead[s] if sequential == 1 and terms.early[k] == 1 else m.now[s]
        a = terms.weight[k] * x + terms.offset[k]
        m.start[terms.target[k]] += a
        m.fed[k] = a
        m.assumed[k] = a


@shared
def _take_lines(plan: Plan, m: Memory, first: int, last: int, step: Step, sequential: int, mode: int) -> None:
    """Compute the inputs from other parts if they change over the step."""
    parts, terms = plan.parts, plan.terms
    for k in range(parts.terms[first], parts.terms[last]):
        s, i, is_known = terms.source[k], terms.target[k], sequential == 1 and terms.early[k] == 1
        x, y = _known(m, s, step, mode) if is_known else _supposed(m, s, step, mode)
        a = terms.weight[k] * x + terms.offset[k]
        b = terms.weight[k] * y + terms.offset[k]
        m.start[i] += a
        m.rate[i] += (b - a) * step.per_second
        m.fed[k] = terms.start[k] * a + terms.end[k] * b
        m.assumed[k] = b


@shared
def feed(plan: Plan, m: Memory, first: int, last: int, drive: Drive, step: Step, sequential: int, mode: int) -> None:
    """Compute the inputs of the parts `first` to `last` - 1 at the start of the step, slopes, and means of terms.

    `sequential`: outputs of parts that have stepped are known at the end. `mode`: values of the other parts.
    """
    parts, inputs, driven = plan.parts, plan.inputs, plan.driven
    for i in range(parts.inputs[first], parts.inputs[last]):
        m.start[i], m.rate[i] = inputs.constant[i], 0.0
    if mode == HELD:
        _take_values(plan, m, first, last, sequential)
    else:
        _take_lines(plan, m, first, last, step, sequential, mode)
    for j in range(parts.driven[first], parts.driven[last]):
        i, d = driven.target[j], driven.channel[j]
        x, y = drive.starts[step.first, d], drive.samples[step.last, d]
        m.start[i] += driven.factor[j] * x + driven.offset[j]
        m.rate[i] += driven.factor[j] * (y - x) * step.per_second
    if mode == GUESSED:
        _assume(plan, m, first, last, step)


@shared
def _share_at(drive: Drive, step: Step, j: int) -> float:
    """Return the share of the step that has elapsed at the drive's point j."""
    share: float = (drive.times[j] - drive.times[step.first]) / (drive.times[step.last] - drive.times[step.first])
    return share


@shared
def _value_between(plan: Plan, m: Memory, c: int, drive: Drive, step: Step, j: int, to: Reals) -> None:
    """Compute the inputs of part c at the drive's point j: on their straight lines, with the drive's value there."""
    driven, first, last, share = plan.driven, step.first, step.last, _share_at(drive, step, j)
    for i in range(plan.parts.inputs[c], plan.parts.inputs[c + 1]):
        to[i] = m.start[i] + m.rate[i] * (step.size * share)
    for k in range(plan.parts.driven[c], plan.parts.driven[c + 1]):
        d = driven.channel[k]
        line = drive.samples[first, d] + (drive.samples[last, d] - drive.samples[first, d]) * share
        to[driven.target[k]] += driven.factor[k] * (drive.samples[j, d] - line)


@shared
def failed(m: Memory, status: int, c: int, function: int) -> int:
    """Record a refused call; return 1 if the status is an error."""
    if status > 1 or status < 0:
        m.failure[0] = status
        m.failure[1] = c
        m.failure[2] = function
        return 1
    return 0


@shared
def call(m: Memory, c: int) -> None:
    """Record that part c is called next, because it may not return."""
    m.calls[0] += 1
    m.calls[1] = c


@shared
def _set(plan: Plan, m: Memory, c: int, values: int) -> int:
    """Set the inputs of part c, which are at the address `values`."""
    parts, at = plan.parts, m.at
    call(m, c)
    status = blocks.exchange(parts.set_real[c], parts.instance[c], at.input_references[c], parts.input_count[c], values)
    return failed(m, status, c, SET)


@shared
def _ramp(plan: Plan, m: Memory, c: int, values: int, slopes: int) -> int:
    """Set the inputs of part c, and their slopes over the step, which are at the address `slopes`."""
    if _set(plan, m, c, values):
        return 1
    parts, at = plan.parts, m.at
    status = blocks.set_slopes(
        parts.set_slopes[c], parts.instance[c], at.input_references[c], parts.input_count[c], at.orders[c], slopes
    )
    return failed(m, status, c, SLOPES)


@shared
def _ramp_between(plan: Plan, m: Memory, c: int, drive: Drive, step: Step, j: int) -> int:
    """Set the inputs of part c at the drive's point j, and their slopes to the next point."""
    per_second = 1.0 / (drive.times[j + 1] - drive.times[j])
    _value_between(plan, m, c, drive, step, j, m.value)
    _value_between(plan, m, c, drive, step, j + 1, m.slope)
    for i in range(plan.parts.inputs[c], plan.parts.inputs[c + 1]):
        m.slope[i] = (m.slope[i] - m.value[i]) * per_second
    return _ramp(plan, m, c, m.at.values[c], m.at.slopes[c])


@shared
def _mean_of_drive(drive: Drive, first: int, last: int, d: int) -> float:
    """Return the exact mean from one of the drive's points to another."""
    total = 0.0
    for k in range(first, last):
        total += drive.means[k, d] * (drive.times[k + 1] - drive.times[k])
    mean: float = total / (drive.times[last] - drive.times[first])
    return mean


@shared
def _hold(plan: Plan, m: Memory, c: int, drive: Drive, first: int, last: int) -> int:
    """Set the held inputs of part c, which cannot ramp, between two of the drive's points: the drive's exact mean."""
    parts, driven = plan.parts, plan.driven
    for i in range(parts.inputs[c], parts.inputs[c + 1]):
        m.value[i] = plan.inputs.constant[i]
    for k in range(parts.terms[c], parts.terms[c + 1]):
        m.value[plan.terms.target[k]] += m.fed[k]
    for j in range(parts.driven[c], parts.driven[c + 1]):
        d = driven.channel[j]
        mean = drive.means[first, d] if last == first + 1 else _mean_of_drive(drive, first, last, d)
        m.value[driven.target[j]] += driven.factor[j] * mean + driven.offset[j]
    return _set(plan, m, c, m.at.values[c])


@shared
def _do(plan: Plan, m: Memory, c: int, time: float, h: float, final: int) -> int:
    parts = plan.parts
    call(m, c)
    return failed(m, blocks.do_step(parts.do_step[c], parts.instance[c], time, h, final), c, STEP)


@shared
def _stands_still(plan: Plan, c: int, mode: int) -> bool:
    """Return whether no input of part c changes over any step of the run, so that no slope needs to be set."""
    stands: bool = mode == HELD and plan.parts.driven[c] == plan.parts.driven[c + 1]
    return stands


@shared
def _go(plan: Plan, m: Memory, c: int, drive: Drive, step: Step, mode: int, final: int) -> int:
    """Step part c in one step."""
    if plan.parts.input_count[c] > 0:
        if _stands_still(plan, c, mode):
            if _set(plan, m, c, m.at.starts[c]):
                return 1
        elif plan.parts.ramps[c] == 1:
            if _ramp(plan, m, c, m.at.starts[c], m.at.rates[c]):
                return 1
        elif _hold(plan, m, c, drive, step.first, step.last):
            return 1
    return _do(plan, m, c, step.time, step.size, final)


@shared
def _follow(plan: Plan, m: Memory, c: int, drive: Drive, step: Step, final: int) -> int:
    """Step part c, which ramps its inputs, from each of the drive's points to the next."""
    for j in range(step.first, step.last):
        if _ramp_between(plan, m, c, drive, step, j):
            return 1
        if _do(plan, m, c, drive.times[j], drive.times[j + 1] - drive.times[j], final):
            return 1
    return 0


@shared
def _reached(plan: Plan, m: Memory, c: int, drive: Drive, last: int) -> None:
    """Compute, in `slope`, the inputs of part c from the signals now, and from the drive at its point `last`."""
    parts, terms, driven = plan.parts, plan.terms, plan.driven
    for i in range(parts.inputs[c], parts.inputs[c + 1]):
        m.slope[i] = plan.inputs.constant[i]
    for k in range(parts.terms[c], parts.terms[c + 1]):
        m.slope[terms.target[k]] += terms.weight[k] * m.now[terms.source[k]] + terms.offset[k]
    for j in range(parts.driven[c], parts.driven[c + 1]):
        m.slope[driven.target[j]] += driven.factor[j] * drive.samples[last, driven.channel[j]] + driven.offset[j]


@shared
def missed_effects(plan: Plan, m: Memory, p: int, drive: Drive, last: int, mode: int) -> int:
    """Compute, in `effect`, how the outputs of row p of Direct change with the end values that their inputs missed.

    The step was accepted, and ended at the drive's point `last`. FMI forbids to read outputs with these values set.
    """
    direct, at = plan.direct, m.at
    c = direct.part[p]
    is_line = plan.parts.ramps[c] == 1 or _stands_still(plan, c, mode)
    _reached(plan, m, c, drive, last)
    for k in range(direct.inputs[p], direct.inputs[p + 1]):
        i = direct.input[k]
        m.gap[k] = m.slope[i] - (m.start[i] + m.rate[i] * m.last[0] if is_line else m.value[i])
    call(m, c)
    status = blocks.derive(
        direct.derive[p],
        plan.parts.instance[c],
        at.unknowns[p],
        direct.outputs[p + 1] - direct.outputs[p],
        at.knowns[p],
        direct.inputs[p + 1] - direct.inputs[p],
        at.gaps[p],
        at.effects[p],
    )
    return failed(m, status, c, DERIVE)


@shared
def _read(plan: Plan, m: Memory, c: int) -> int:
    """Read the signals of part c."""
    parts, at = plan.parts, m.at
    if parts.signal_count[c] == 0:
        return 0
    call(m, c)
    status = blocks.exchange(
        parts.get_real[c], parts.instance[c], at.signal_references[c], parts.signal_count[c], at.signals[c]
    )
    return failed(m, status, c, GET)


@shared
def _step(plan: Plan, m: Memory, c: int, drive: Drive, step: Step, mode: int, final: int) -> int:
    """Step part c and read its signals; return 1 if it refused."""
    if step.last > step.first + 1 and plan.parts.follows[c] == 1:
        return 1 if _follow(plan, m, c, drive, step, final) else _read(plan, m, c)
    if _go(plan, m, c, drive, step, mode, final) or _read(plan, m, c):
        _keep_inputs(plan, m, c, mode)
        return 1
    return 0


@shared
def _keep_inputs(plan: Plan, m: Memory, c: int, mode: int) -> None:
    """Copy the inputs that part c had from the step's start to `value`, for errors; held inputs are there already."""
    if plan.parts.ramps[c] == 1 or _stands_still(plan, c, mode):
        for i in range(plan.parts.inputs[c], plan.parts.inputs[c + 1]):
            m.value[i] = m.start[i]


@shared
def sweep(plan: Plan, m: Memory, g: int, drive: Drive, step: Step, sequential: int, mode: int, final: int) -> int:
    """Step the parts of group g, level by level; return 1 if one refused."""
    levels = plan.levels
    for level in range(levels.groups[g], levels.groups[g + 1]):
        first, last = levels.parts[level], levels.parts[level + 1]
        feed(plan, m, first, last, drive, step, sequential, mode)
        for c in range(first, last):
            if _step(plan, m, c, drive, step, mode, final):
                return 1
    return 0


# ==== Implicit coupling: a step is repeated until the assumed coupling values equal the computed ones ================

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
        status = blocks.call_state(plan.parts.save[c], plan.parts.instance[c], m.states.ctypes.data + 8 * index)
        if failed(m, status, c, SAVE):
            return 1
    return 0


@shared
def restore_parts(plan: Plan, m: Memory, first: int, last: int, slot: int) -> int:
    """Restore the saved states; return 1 if a part refused."""
    for c in range(first, last):
        index = slot * plan.parts.instance.size + c
        call(m, c)
        status = blocks.call_state(plan.parts.restore[c], plan.parts.instance[c], m.states[index])
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
        m.guess[s] = _on_parabola(m, s, step)
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
