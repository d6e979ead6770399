"""The loop over coupling steps, fixed and adaptive; compiled, or the same functions in plain Python."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isnan
from typing import Any, NamedTuple

from cosim.engine import blocks
from cosim.engine.blocks import Block, shared
from cosim.engine.plan import (
    DIVERGED,
    DONE,
    GET,
    LOOSE,
    REFUSED,
    REJECTED,
    STEP,
    STEPS,
    STOPPED,
    STUCK,
    Drive,
    Indices,
    Integers,
    Memory,
    Mode,
    Plan,
    Reals,
    Step,
)
from cosim.engine.sweep import (
    call,
    failed,
    missed_effects,
    pace_of,
    restore_parts,
    save_parts,
    step_from,
    step_group,
    step_once,
)
from eightpost.extras import is_installed
from eightpost.fmi import DISCARD

# ---- Measures summed over a run, step by step -----------------------------------------------------------------------

_DIVERGED = 1e15


@shared
def _add_term(plan: Plan, m: Memory, k: int, h: float) -> float:
    """Add the squared difference of the assumed and the actual end value of term k, and the sums of the term itself.

    Return twice the mean of the term's source.
    """
    terms = plan.terms
    now, end = m.now[terms.source[k]], m.ahead[terms.source[k]]
    came = terms.weight[k] * end + terms.offset[k]
    missed = m.assumed[k] - came
    m.defect[k] += missed * missed * h
    m.total[k] += came * h
    m.squares[k] += came * came * h
    twice: float = now + end
    return twice


@shared
def _add_bonds(plan: Plan, m: Memory, h: float) -> None:
    """Add the defects of both terms of every bond, and the energy given at one end minus that received at the other."""
    bonds = plan.bonds
    m.duration[0] += h
    for b in range(bonds.velocity.size):
        v, f = bonds.velocity[b], bonds.force[b]
        moved, pushed = _add_term(plan, m, v, h), _add_term(plan, m, f, h)
        given = bonds.given[b] * moved * m.fed[f] * h
        taken = bonds.taken[b] * pushed * m.fed[v] * h
        m.residual[b] += given - taken
        m.transferred[b] += abs(taken)


@shared
def _add_limits(plan: Plan, m: Memory, h: float) -> None:
    """Add the step to the time of every limit that is exceeded at its end."""
    watch = plan.watch
    m.watched[watch.signal.size] += h
    for w in range(watch.signal.size):
        if watch.sign[w] * m.ahead[watch.signal[w]] > watch.limit[w]:
            m.watched[w] += h


@shared
def _first_senseless(m: Memory) -> int:
    s = 0
    while abs(m.now[s]) < _DIVERGED:
        s += 1
    return s


@shared
def accept(m: Memory, h: float) -> int:
    """Make the end of the step the start of the next one.

    Return the first signal whose value is not plausible, or -1.
    """
    pace = pace_of(m, h)
    m.last[1], m.pace[1] = m.last[0], m.pace[0]
    m.last[0], m.pace[0] = h, pace
    sensible = 0
    for s in range(m.now.size):
        value = m.ahead[s]
        m.older[s] = m.past[s]
        m.past[s] = m.now[s]
        m.now[s] = value
        sensible += abs(value) < _DIVERGED
    return -1 if sensible == m.now.size else _first_senseless(m)


# ---- The loop over coupling steps -----------------------------------------------------------------------------------


class Tape(NamedTuple):
    """Recording: rows (R, M), times (R,), and the position of each column in Memory.seen.

    `position` (1,) is the index of the next row.
    """

    rows: Reals
    times: Reals
    columns: Indices
    position: Integers


class Grid(NamedTuple):
    """Communication points (K+1,) [s], the steps between them (K,) [s], and flags of recorded points (K+1,).

    `points` (K+1,) are the communication points as components get them: rounded as the sum of the steps. `drive`: drive
    at these points and at its own points between them; `begins` (K+1,) are the indices of the former.
    """

    times: Reals
    points: Reals
    steps: Reals
    recorded: Integers
    begins: Integers
    drive: Drive


class Knots(NamedTuple):
    """The drive's own points (Q,) [s] and values (Q, D), linear between them.

    `events` are the times at which steps must end, `recorded` flags those that are recorded.
    """

    times: Reals
    values: Reals
    events: Reals
    recorded: Integers


class Control(NamedTuple):
    """Settings of an adaptive run: tolerances per signal, order of the scheme, smallest and largest step [s]."""

    signal: Integers
    absolute: Reals
    relative: float
    order: int
    least: float
    largest: float


class Progress(NamedTuple):
    """State of an adaptive run, (1,) each: time, step to try, last error, next event, drive interval, extreme steps.

    `scale`: largest value so far of each coupled signal; `once`: signals after a whole step (S,); `drive`: drive at
    both ends of a step.
    """

    time: Reals
    step: Reals
    error: Reals
    event: Integers
    knot: Integers
    smallest: Reals
    greatest: Reals
    scale: Reals
    once: Reals
    drive: Drive


@shared
def record(plan: Plan, m: Memory, tape: Tape, time: float) -> int:
    """Read the extras and record a row; return 1 if a part refused."""
    parts, at = plan.parts, m.at
    for c in range(parts.instance.size):
        if parts.extra_count[c] > 0:
            call(m, c)
            status = blocks.exchange(
                parts.get_real[c], parts.instance[c], at.extra_references[c], parts.extra_count[c], at.extras[c]
            )
            if failed(m, status, c, GET):
                return 1
    row = tape.position[0]
    for k in range(tape.columns.size):
        tape.rows[row, k] = m.seen[tape.columns[k]]
    tape.times[row] = time
    tape.position[0] = row + 1
    return 0


@shared
def _record_end(plan: Plan, m: Memory, tape: Tape, time: float, drive: Drive, last: int, mode: int) -> int:
    """Record a row at the end of a step, with outputs that follow inputs without delay as of their actual values."""
    if record(plan, m, tape, time):
        return 1
    direct, row = plan.direct, tape.position[0] - 1
    for p in range(direct.part.size):
        if missed_effects(plan, m, p, drive, last, mode):
            return 1
    for k in range(direct.column.size):
        tape.rows[row, direct.column[k]] += m.effect[k]
    return 0


@shared
def _one_step(plan: Plan, m: Memory, drive: Drive, step: Step, mode: Mode) -> int:
    """Step every part; return 1 if one refused."""
    m.clock[0] = step.time
    for g in range(plan.loops.parts.size - 1):
        if step_group(plan, m, g, drive, step, mode):
            return 1
    return 0


@shared
def _end_step(plan: Plan, m: Memory, end: float, h: float, mode: Mode) -> int:
    """Add the step of `h` that ends at `end` [s] to the measures.

    Return the first signal whose value is not plausible, or -1.
    """
    _add_bonds(plan, m, h)
    if end > mode.settling:
        _add_limits(plan, m, h)
    m.counts[STEPS] += 1
    return accept(m, h)


def march(plan: Plan, m: Memory, tape: Tape, grid: Grid, mode: Mode, first: int, last: int) -> int:
    """Make the steps first to last - 1 of a grid; return the reason for the end, with its index in failure[3]."""
    for k in range(first, last):
        m.failure[3] = k
        if m.stop[0] != 0:
            return STOPPED
        end = grid.times[k + 1]
        step = step_from(m, grid.points[k], grid.steps[k], grid.begins[k], grid.begins[k + 1])
        if _one_step(plan, m, grid.drive, step, mode):
            return REFUSED
        bad = _end_step(plan, m, end, step.size, mode)
        if bad >= 0:
            m.failure[1] = bad
            return DIVERGED
        if grid.recorded[k + 1] == 1 and _record_end(plan, m, tape, end, grid.drive, step.last, mode.values):
            return REFUSED
    m.failure[3] = last
    return DONE


@shared
def _drive_at(knots: Knots, k: int, time: float, row: Reals) -> None:
    """Compute the drive at a time within its interval k."""
    if knots.times.size < 2:
        for d in range(row.size):
            row[d] = knots.values[0, d] if knots.times.size == 1 else 0.0
        return
    share = (time - knots.times[k]) / (knots.times[k + 1] - knots.times[k])
    for d in range(row.size):
        row[d] = knots.values[k, d] + share * (knots.values[k + 1, d] - knots.values[k, d])


@shared
def _driven_step(plan: Plan, m: Memory, knots: Knots, p: Progress, time: float, h: float, mode: Mode) -> int:
    """Make one step within an interval of the drive."""
    times, samples, starts, means = p.drive.times, p.drive.samples, p.drive.starts, p.drive.means
    times[0] = time
    times[1] = time + h
    _drive_at(knots, p.knot[0], time, samples[0])
    _drive_at(knots, p.knot[0], time + h, samples[1])
    for d in range(samples.shape[1]):
        starts[0, d] = samples[0, d]
        means[0, d] = 0.5 * (samples[0, d] + samples[1, d])
    return _one_step(plan, m, p.drive, step_from(m, time, h, 0, 1), mode)


@shared
def _assign(to: Reals, values: Reals) -> None:
    for k in range(to.size):
        to[k] = values[k]


@shared
def _copy(m: Memory, kept: Memory) -> None:
    """Copy everything that a step changes and that must be restored if it is rejected."""
    _assign(kept.now, m.now)
    _assign(kept.past, m.past)
    _assign(kept.older, m.older)
    _assign(kept.residual, m.residual)
    _assign(kept.transferred, m.transferred)
    _assign(kept.defect, m.defect)
    _assign(kept.total, m.total)
    _assign(kept.squares, m.squares)
    _assign(kept.watched, m.watched)
    _assign(kept.duration, m.duration)
    _assign(kept.last, m.last)
    _assign(kept.pace, m.pace)
    _assign(kept.size, m.size)
    kept.counts[LOOSE] = m.counts[LOOSE]
    kept.counts[STEPS] = m.counts[STEPS]


@shared
def _difference(m: Memory, once: Reals, control: Control, scale: Reals) -> float:
    """Return the difference of one step and two halves, relative to the allowed error."""
    worst = 0.0
    for i in range(control.signal.size):
        s = control.signal[i]
        allowed = control.absolute[i] + control.relative * max(scale[i], abs(m.now[s]))
        error = abs(m.now[s] - once[s]) / ((2.0**control.order - 1.0) * allowed)
        # A value that is not a number must be kept, because it means disagreement.
        worst = error if error > worst or isnan(error) else worst
    return worst


@shared
def _grow(m: Memory, control: Control, scale: Reals) -> None:
    """Update the largest values so far after an accepted step."""
    for i in range(control.signal.size):
        scale[i] = max(scale[i], abs(m.now[control.signal[i]]))


@shared
def _next_step(control: Control, h: float, error: float, before: float) -> float:
    """Return the next step by a proportional-integral controller (Gustafsson, 1991), which varies the step smoothly."""
    exponent = 1.0 / (control.order + 1.0)
    factor = 0.9 * max(error, 1e-8) ** (-0.7 * exponent) * max(before, 1e-8) ** (0.4 * exponent)
    chosen: float = min(max(h * min(max(factor, 0.2), 4.0), control.least), control.largest)
    return chosen


@shared
def _smaller_step(control: Control, h: float, error: float) -> float:
    """Return the step after a rejected one, whose error is known unless a part refused it or gave no number."""
    known = 0.0 < error < 1e9
    shrink = max(0.2, 0.9 * error ** (-1.0 / (control.order + 1.0))) if known else 0.2
    smaller: float = max(control.least, h * shrink)
    return smaller


@shared
def _try_step(
    plan: Plan, m: Memory, kept: Memory, knots: Knots, mode: Mode, control: Control, p: Progress, time: float, h: float
) -> float:
    """Make one step, then the same as two halves, which are kept; return the error, -1 if a part refused."""
    count = plan.parts.instance.size
    _copy(m, kept)
    if save_parts(plan, m, 0, count, 0):
        return -1.0
    for half in range(3):
        at = time + 0.5 * h if half == 2 else time
        part = (
            h if half == 0 else 0.5 * h if half == 1 else time + h - at
        )  # the sum of the steps is the end, to the bit
        if _driven_step(plan, m, knots, p, at, part, mode):
            return -1.0
        if half == 0:
            _assign(p.once, m.ahead)
            if restore_parts(plan, m, 0, count, 0):
                return -1.0
        else:
            _end_step(plan, m, at + part, part, mode)
    return _difference(m, p.once, control, p.scale)


def _march_adaptive(  # noqa: PLR0911 -- one return for each reason to stop
    plan: Plan, m: Memory, kept: Memory, tape: Tape, knots: Knots, mode: Mode, control: Control, p: Progress, last: int
) -> int:
    """Make at most `last` accepted steps, ending steps at every event; failure[3] is 1 at the end of the run.

    Return the reason why it stopped.
    """
    m.failure[3] = 0
    for _ in range(last):
        if p.event[0] == knots.events.size:
            m.failure[3] = 1
            return DONE
        if m.stop[0] != 0:
            return STOPPED
        time, event = p.time[0], knots.events[p.event[0]]
        while p.knot[0] < knots.times.size - 2 and time >= knots.times[p.knot[0] + 1]:
            p.knot[0] += 1
        wanted, left = p.step[0], event - time
        lands = left <= 1.1 * wanted
        h = left if lands else min(wanted, 0.5 * left)  # avoids a very short step before the event
        error = _try_step(plan, m, kept, knots, mode, control, p, time, h)
        if error < 0.0 and not (m.failure[0] == DISCARD and m.failure[2] == STEP and h > control.least):
            return REFUSED
        if not 0.0 <= error <= 1.0:
            m.counts[REJECTED] += 1
            if restore_parts(plan, m, 0, plan.parts.instance.size, 0):
                return REFUSED
            _copy(kept, m)
            if h <= control.least * 1.0000001:
                return STUCK
            p.step[0] = _smaller_step(control, h, error)
            continue
        _grow(m, control, p.scale)
        chosen = _next_step(control, h, error, p.error[0])
        p.step[0] = max(chosen, wanted) if lands and chosen >= h else chosen
        p.error[0] = error
        p.smallest[0] = min(p.smallest[0], h)
        p.greatest[0] = max(p.greatest[0], h)
        p.time[0] = event if lands else time + h
        if lands:
            p.event[0] += 1
            if knots.recorded[p.event[0] - 1] == 1 and _record_end(plan, m, tape, event, p.drive, 1, mode.values):
                return REFUSED
    return DONE


# ==== Selection of the loop: compiled, or the same functions in plain Python =========================================

#: Number of steps between checks for Ctrl-C and updates of the progress bar.
COMPILED_CHUNK, PYTHON_CHUNK = 20_000, 100

ENGINES = ("auto", "compiled", "python")


Bind = Callable[..., Callable[..., int]]


def bound(function: Callable[..., int]) -> Bind:
    """Return a function that takes the named tuples of `function` and returns a function of its other arguments."""
    return lambda *tuples: partial(function, *tuples)


def compiled(function: Callable[..., int], instead: dict[str, Callable[..., int]]) -> Bind:
    """Return the same as machine code; the named tuples become blocks, the other arguments are integers."""

    def bind(*tuples: Any) -> Callable[..., int]:
        from cosim.engine.machine_code import machine_code  # noqa: PLC0415 -- LLVM, which the interpreted loop does not need

        blocks = tuple(map(Block, tuples))
        machine = machine_code(function, tuple(block.kind for block in blocks), instead)
        return lambda *numbers: machine(*(block.address for block in blocks), *numbers)

    return bind


def is_interpreted(engine: str) -> bool:
    """Return whether an engine interprets the loop; `auto` does without numba, with equal results."""
    return engine == "python" or (engine == "auto" and not is_installed("numba"))


def loop(engine: str, *, adaptive: bool, implicit: bool) -> tuple[Bind, int]:
    """Return the function that binds the loop, and the number of steps per call.

    Args:
        engine: One of `ENGINES`.
        adaptive: Whether an error estimate controls the steps.
        implicit: Whether steps are repeated.
    """
    function = _march_adaptive if adaptive else march
    if is_interpreted(engine):
        return bound(function), PYTHON_CHUNK
    return compiled(function, {} if implicit else {"step_group": step_once}), COMPILED_CHUNK
