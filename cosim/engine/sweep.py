"""One sweep: every part of a group is fed and stepped once, in order."""

from __future__ import annotations

from cosim.engine import calls
from cosim.engine.compiled import hot, shared
from cosim.engine.plan import (
    EXTRAPOLATED,
    GET,
    GUESSED,
    HELD,
    INTERPOLATED,
    PARABOLIC,
    SET,
    SLOPES,
    STEP,
    Drive,
    Memory,
    Plan,
)


@hot
def _sag(m: Memory, s: int, end: float, h: float) -> float:
    """How far the start of a straight line must be moved for the mean of a parabola through the last step's start, too.

    What a signal does over a step is then wrong in the third order only, without an exchange in between.
    """
    bend = (end - m.now[s] - m.slope[s] * h) * (h / (h + m.last[0]))
    sag: float = bend / 3.0
    return sag


@hot
def on_parabola(m: Memory, s: int, h: float) -> float:
    """A signal at the end of the step, on with the last two steps' slopes and their change."""
    bend = (m.slope[s] - m.steep[s]) * (h * (h + m.last[0]) / (m.last[0] + m.last[1]))
    end: float = m.now[s] + m.slope[s] * h + bend
    return end


@hot
def feed(plan: Plan, m: Memory, c: int, drive: Drive, h: float, sequential: int, mode: int) -> None:
    """Find what the inputs of part c are at the start and at the end of the step, and what to hold instead.

    `samples` (J+1, D) is the drive at the ends of the sub-steps. `sequential`: values of parts that have stepped are
    known at the end. `mode`: what others do; GUESSED takes them from `guess`.
    """
    inputs, terms, ramps, samples = plan.inputs, plan.terms, plan.parts.ramps[c] == 1, drive.samples
    last = samples.shape[0] - 1
    per_second = 1.0 / h
    for i in range(plan.parts.inputs[c], plan.parts.inputs[c + 1]):
        start = end = held = inputs.constant[i]
        for k in range(inputs.terms[i], inputs.terms[i + 1]):
            s = terms.source[k]
            x = y = m.now[s]
            if sequential == 1 and terms.early[k] == 1:
                y = m.ahead[s]
                x = y if mode == HELD else x - _sag(m, s, y, h) if mode > EXTRAPOLATED else x
            elif mode == INTERPOLATED:
                x = m.past[s]
            elif mode == EXTRAPOLATED:
                y = x + m.slope[s] * h
            elif mode > EXTRAPOLATED:
                y = on_parabola(m, s, h) if mode == PARABOLIC else m.guess[s]
                x -= _sag(m, s, y, h)
            a = terms.weight[k] * x + terms.offset[k]
            b = terms.weight[k] * y + terms.offset[k]
            kept = b if inputs.direct[i] == 1 else 0.5 * (a + b)
            start += a
            end += b
            held += kept
            if mode == GUESSED and terms.early[k] == 0:
                m.assumed[k] = terms.weight[k] * on_parabola(m, s, h) + terms.offset[k]
            else:
                m.assumed[k] = b
            m.fed[k] = 0.5 * (a + b) if ramps else kept
        d = inputs.column[i]
        if d >= 0:
            start += inputs.factor[i] * samples[0, d] + inputs.offset[i]
            end += inputs.factor[i] * samples[last, d] + inputs.offset[i]
        m.start[i] = start
        m.end[i] = end
        m.held[i] = held
        m.rate[i] = (end - start) * per_second


@shared
def _value_at(plan: Plan, m: Memory, i: int, drive: Drive, j: int) -> float:
    """An input at the drive's point j: on the straight line over the step, with the drive as it is there."""
    last = drive.times.size - 1
    share = (drive.times[j] - drive.times[0]) / (drive.times[last] - drive.times[0])
    value: float = m.start[i] + (m.end[i] - m.start[i]) * share
    d = plan.inputs.column[i]
    if d >= 0:
        line = drive.samples[0, d] + (drive.samples[last, d] - drive.samples[0, d]) * share
        value += plan.inputs.factor[i] * (drive.samples[j, d] - line)
    return value


@hot
def failed(m: Memory, status: int, c: int, function: int) -> int:
    """Keep who refused what; 1 where a status is an error."""
    if status > 1 or status < 0:
        m.failure[0] = status
        m.failure[1] = c
        m.failure[2] = function
        return 1
    return 0


@hot
def _set(plan: Plan, m: Memory, c: int, values: int) -> int:
    """Give part c its inputs, which are at the address `values`."""
    parts, at = plan.parts, m.at
    status = calls.exchange(parts.set_real[c], parts.instance[c], at.input_references[c], parts.input_count[c], values)
    return failed(m, status, c, SET)


@hot
def _set_slopes(plan: Plan, m: Memory, c: int) -> int:
    parts, at = plan.parts, m.at
    status = calls.set_slopes(
        parts.set_slopes[c], parts.instance[c], at.input_references[c], parts.input_count[c], at.orders[c], at.rates[c]
    )
    return failed(m, status, c, SLOPES)


@shared
def _ramp_between(plan: Plan, m: Memory, c: int, drive: Drive, j: int) -> int:
    """Give part c its inputs at the drive's point j, and their slopes to the next."""
    h = drive.times[j + 1] - drive.times[j]
    for i in range(plan.parts.inputs[c], plan.parts.inputs[c + 1]):
        m.value[i] = _value_at(plan, m, i, drive, j)
        m.rate[i] = (_value_at(plan, m, i, drive, j + 1) - m.value[i]) / h
    if _set(plan, m, c, m.at.values[c]):
        return 1
    return _set_slopes(plan, m, c)


@shared
def _mean_of_drive(drive: Drive, d: int) -> float:
    """The exact mean over the step."""
    total, last = 0.0, drive.times.size - 1
    for k in range(last):
        total += drive.means[k, d] * (drive.times[k + 1] - drive.times[k])
    mean: float = total / (drive.times[last] - drive.times[0])
    return mean


@shared
def _hold(plan: Plan, m: Memory, c: int, drive: Drive, j: int, count: int) -> int:
    """Give part c, which cannot ramp, what it holds over sub-step j of `count`: the exact mean of the drive."""
    inputs = plan.inputs
    for i in range(plan.parts.inputs[c], plan.parts.inputs[c + 1]):
        held = m.held[i]
        d = inputs.column[i]
        if d >= 0:
            mean = drive.means[j, d] if count == drive.means.shape[0] else _mean_of_drive(drive, d)
            held += inputs.factor[i] * mean + inputs.offset[i]
        m.value[i] = held
    return _set(plan, m, c, m.at.values[c])


@hot
def _give(plan: Plan, m: Memory, c: int, drive: Drive, j: int, count: int) -> int:
    """Set the inputs of part c for sub-step j of `count`."""
    if plan.parts.ramps[c] == 0:
        return _hold(plan, m, c, drive, j, count)
    if count > 1:
        return _ramp_between(plan, m, c, drive, j)
    if _set(plan, m, c, m.at.starts[c]):
        return 1
    return _set_slopes(plan, m, c)


@hot
def step_part(plan: Plan, m: Memory, c: int, drive: Drive, time: float, h: float, final: int) -> int:
    """Step part c and read its signals; 1 where it refused."""
    parts = plan.parts
    count = drive.times.size - 1 if parts.follows[c] == 1 else 1
    for j in range(count):
        if parts.input_count[c] > 0 and _give(plan, m, c, drive, j, count):
            return 1
        begin, part = (time, h) if count == 1 else (drive.times[j], drive.times[j + 1] - drive.times[j])
        if failed(m, calls.do_step(parts.do_step[c], parts.instance[c], begin, part, final), c, STEP):
            return 1
    if parts.signal_count[c] == 0:
        return 0
    status = calls.exchange(
        parts.get_real[c], parts.instance[c], m.at.signal_references[c], parts.signal_count[c], m.at.signals[c]
    )
    return failed(m, status, c, GET)


@shared
def sweep(
    plan: Plan,
    m: Memory,
    first: int,
    last: int,
    drive: Drive,
    time: float,
    h: float,
    sequential: int,
    mode: int,
    final: int,
) -> int:
    """Step the parts order[first:last] from `time` by `h` [s]; 1 where one refused."""
    for k in range(first, last):
        c = plan.order[k]
        feed(plan, m, c, drive, h, sequential, mode)
        if step_part(plan, m, c, drive, time, h, final):
            return 1
    return 0
