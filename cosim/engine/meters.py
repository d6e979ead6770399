"""Measures summed over a run, step by step: energy per bond, coupling defects, time beyond limits."""

from __future__ import annotations

from cosim.engine.compiled import shared
from cosim.engine.plan import Memory, Plan
from cosim.engine.sweep import pace_of

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
def add_bonds(plan: Plan, m: Memory, h: float) -> None:
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
def add_limits(plan: Plan, m: Memory, h: float) -> None:
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
