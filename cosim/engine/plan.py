"""A resolved system as flat arrays: input of the loop (Plan) and data that it changes (Memory).

Parts (components) are numbered in the order in which they are stepped. All elements of one part are contiguous:
`inputs[c]` to `inputs[c + 1]` are the inputs of part c. A *term* is a contribution to an input, `weight * signal +
offset`; a *signal* is an output that is read after every step, an *extra* one that is read at recorded points only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
#: Unsigned, so that compiled code need not check for negative indices.
Indices = NDArray[np.uint32]
References = NDArray[np.uint32]

#: Coupling values over a step whose end values are not known yet.
HELD, INTERPOLATED, EXTRAPOLATED, PARABOLIC, GUESSED = 0, 1, 2, 3, 4

#: Kinds of schemes.
JACOBI, GAUSS_SEIDEL, IMPLICIT = 0, 1, 2

#: Reasons why the loop stopped.
DONE, STOPPED, REFUSED, DIVERGED, STUCK = 0, 1, 2, 3, 4

#: Calls that can be refused.
SET, SLOPES, STEP, GET, SAVE, RESTORE, DERIVE = 0, 1, 2, 3, 4, 5, 6


class Mode(NamedTuple):
    """Settings of the scheme for a step."""

    kind: int  #: JACOBI, GAUSS_SEIDEL or IMPLICIT.
    values: int  #: HELD, INTERPOLATED or EXTRAPOLATED: coupling values whose end value is not known yet.
    tolerance: float  #: Largest disagreement of an implicit step, relative to an unknown's size.
    most: int  #: Maximum number of iterations of an implicit step with one Jacobian.
    settling: float  #: Time after which limits are watched [s].
    final: int  #: 1 if no earlier state will be restored.


class Parts(NamedTuple):
    """Parts: addresses of their functions, their instances, and start indices in the other tables, (C,) or (C+1,).

    `inputs`, `terms`, `driven`, `signals`, `extras`: start index of each part. `ramps`: 1 if its inputs may change over
    a step; `follows`: 1 if it is stepped from each point of the drive to the next.
    """

    set_real: Integers
    set_slopes: Integers
    do_step: Integers
    get_real: Integers
    save: Integers
    restore: Integers
    instance: Integers
    ramps: Integers
    follows: Integers
    inputs: Indices
    terms: Indices
    driven: Indices
    signals: Indices
    extras: Indices
    input_count: Integers
    signal_count: Integers
    extra_count: Integers


class Inputs(NamedTuple):
    """Inputs, (N,): reference, order of the derivative that is set, and the constant part of the value."""

    reference: References
    order: NDArray[np.int32]
    constant: Reals


class Terms(NamedTuple):
    """Terms, (T,): the signal and the input; `early`: 1 if the source's part comes before the input's in the order.

    `start`, `end`: weights of both ends for a part that holds its inputs: a half each, for the mean; only the end if a
    coupled output follows the input without delay.
    """

    source: Indices
    target: Indices
    early: Integers
    weight: Reals
    offset: Reals
    start: Reals
    end: Reals


class Driven(NamedTuple):
    """Inputs that the drive moves, (F,): the input, the drive's channel, and the conversion."""

    target: Indices
    channel: Indices
    factor: Reals
    offset: Reals


class Signals(NamedTuple):
    """References of the signals (S,) and of the extras (E,)."""

    reference: References
    extra_reference: References


class Bonds(NamedTuple):
    """Bonds, (B,): their terms, and factors to joules for twice the mean sent value times the mean received value."""

    velocity: Indices
    force: Indices
    given: Reals
    taken: Reals


class Watch(NamedTuple):
    """Signals whose time beyond a limit is counted, (W,): where `sign` (1 or -1) times the signal exceeds `limit`."""

    signal: Indices
    sign: Reals
    limit: Reals


class Loops(NamedTuple):
    """Unknowns of implicit steps: signals that are needed before their part has stepped.

    Groups are parts that are connected with each other: `parts[g]` to `parts[g + 1]`, with the unknowns `unknowns[g]`
    to `unknowns[g + 1]` of `signal` (G+1,); `matrix[g]` is the start of the group's inverse Jacobian; `least` is the
    minimum size of each unknown.
    """

    parts: Indices
    unknowns: Indices
    signal: Indices
    matrix: Indices
    least: Reals


class Direct(NamedTuple):
    """Recorded outputs that follow, without delay, inputs whose end value a step can only assume.

    One row per part with such outputs: the `part`, and the address of its function `derive`, (P,). Its outputs are
    `outputs[p]` to `outputs[p + 1]` of `column` (of the tape) and `unknown` (references), its inputs `inputs[p]` to
    `inputs[p + 1]` of `input` and `known` (references).
    """

    part: Indices
    derive: Integers
    outputs: Indices
    column: Indices
    unknown: References
    inputs: Indices
    input: Indices
    known: References


class Levels(NamedTuple):
    """Levels of consecutive parts that take nothing from each other: `parts[l]` to `parts[l + 1]` (L+1,).

    `groups[g]` to `groups[g + 1]` are the levels of group g (G+1,).
    """

    parts: Indices
    groups: Indices


class Drive(NamedTuple):
    """Drive: times (T+1,) [s] of points, its values (T+1, D), its means between them (T, D).

    `starts` (T+1, D): start value of the straight line that replaces the drive over a coupling step from this point.
    """

    times: Reals
    samples: Reals
    starts: Reals
    means: Reals


class Step(NamedTuple):
    """Coupling step of `size` [s] from `time` [s]; the drive's points at its ends are `first` and `last`.

    `per_second` is 1 / `size`. A signal that changed by `x` over the last step, and by `y` over the one before, changes
    by `line` x over this one on a straight line, by `newer` x - `older` y on a parabola; `sag` is a factor for _start.
    """

    time: float
    size: float
    first: int
    last: int
    per_second: float
    line: float
    newer: float
    older: float
    sag: float


class Plan(NamedTuple):
    """A resolved system."""

    parts: Parts
    inputs: Inputs
    terms: Terms
    driven: Driven
    signals: Signals
    bonds: Bonds
    watch: Watch
    loops: Loops
    levels: Levels
    direct: Direct


class Addresses(NamedTuple):
    """Memory addresses of each part's references and values, (C,), for calls; the last four of each row of Direct."""

    input_references: Integers
    orders: Integers
    starts: Integers
    values: Integers
    rates: Integers
    slopes: Integers
    signal_references: Integers
    signals: Integers
    extra_references: Integers
    extras: Integers
    unknowns: Integers
    effects: Integers
    knowns: Integers
    gaps: Integers


class Memory(NamedTuple):
    """Data that a run changes.

    `ahead`, `now`, `past`, `older`: signals at the end of the step, at its start, and at the starts of the two before
    it; `last`: durations of those two [s], `pace`: 1 / `last`. `seen`: `now`, followed by `extra`. `start`, `rate`:
    inputs at the start of the step, and their slopes; `value`, `slope`: the same for a part of it. `fed`: mean of each
    term over the step; `assumed`: its end value. `defect`: squared difference of the assumed and the actual end value
    of a bond's term, summed; `total`, `squares`: sums of the term itself. `gap`: actual minus assumed end values of
    the inputs of Direct; `effect`: what the outputs lack for that. `states`: two saved states of each part.
    `size` to `turn`: data of an implicit step. `calls`: number of calls of parts so far, and the part that is called,
    which may never return; `clock`: start of its step [s].
    """

    seen: Reals
    now: Reals
    ahead: Reals
    past: Reals
    older: Reals
    guess: Reals
    start: Reals
    value: Reals
    rate: Reals
    slope: Reals
    fed: Reals
    assumed: Reals
    extra: Reals
    residual: Reals
    transferred: Reals
    defect: Reals
    total: Reals
    squares: Reals
    watched: Reals
    duration: Reals
    gap: Reals
    effect: Reals
    last: Reals
    pace: Reals
    states: Integers
    size: Reals
    known: Integers
    missed: Reals
    after: Reals
    move: Reals
    change: Reals
    left: Reals
    right: Reals
    inverse: Reals
    jacobian: Reals
    kept: Reals
    turn: Integers
    counts: Integers
    failure: Integers
    calls: Integers
    clock: Reals
    stop: Integers
    at: Addresses


#: Indices of Memory.counts: iterations, Jacobians, steps that did not converge, rejected steps, steps made.
ITERATIONS, JACOBIANS, LOOSE, REJECTED, STEPS = 0, 1, 2, 3, 4


def memory(plan: Plan) -> Memory:
    """Return zeroed memory for a plan."""
    signals, unknowns, parts = plan.signals.reference.size, plan.loops.signal.size, plan.parts.instance.size
    sizes = {
        **dict.fromkeys(("ahead", "past", "older", "guess"), signals),
        **dict.fromkeys(("start", "value", "rate", "slope"), plan.inputs.reference.size),
        **dict.fromkeys(("fed", "assumed", "defect", "total", "squares"), plan.terms.source.size),
        **dict.fromkeys(("residual", "transferred"), plan.bonds.velocity.size),
        **dict.fromkeys(("missed", "after", "move", "change", "left", "right"), unknowns),
        **dict.fromkeys(("inverse", "jacobian"), int(plan.loops.matrix[-1])),
        **{"watched": plan.watch.signal.size + 1, "duration": 1, "clock": 1, "kept": 2},
        **{"gap": plan.direct.input.size, "effect": plan.direct.column.size},
    }
    counts = {"states": 2 * parts, "known": plan.loops.parts.size - 1, "turn": 4, "counts": 5, "failure": 4}
    counts |= {"calls": 2, "stop": 1}
    arrays: dict[str, NDArray[Any]] = {name: np.zeros(size) for name, size in sizes.items()}
    arrays |= {name: np.zeros(count, np.int64) for name, count in counts.items()}
    seen = np.zeros(signals + plan.signals.extra_reference.size)
    arrays |= {"seen": seen, "now": seen[:signals], "extra": seen[signals:], "size": plan.loops.least.copy()}
    arrays |= {"last": np.full(2, 1e300), "pace": np.full(2, 1e-300)}
    return Memory(**arrays, at=_addresses(plan, arrays))


def _addresses(plan: Plan, arrays: Mapping[str, NDArray[Any]]) -> Addresses:
    parts, inputs, signals, direct = plan.parts, plan.inputs, plan.signals, plan.direct
    places: dict[str, tuple[NDArray[Any], Indices]] = {
        "input_references": (inputs.reference, parts.inputs),
        "orders": (inputs.order, parts.inputs),
        "starts": (arrays["start"], parts.inputs),
        "values": (arrays["value"], parts.inputs),
        "rates": (arrays["rate"], parts.inputs),
        "slopes": (arrays["slope"], parts.inputs),
        "signal_references": (signals.reference, parts.signals),
        "signals": (arrays["ahead"], parts.signals),
        "extra_references": (signals.extra_reference, parts.extras),
        "extras": (arrays["extra"], parts.extras),
        "unknowns": (direct.unknown, direct.outputs),
        "effects": (arrays["effect"], direct.outputs),
        "knowns": (direct.known, direct.inputs),
        "gaps": (arrays["gap"], direct.inputs),
    }
    return Addresses(
        **{name: a.ctypes.data + a.itemsize * begins[:-1].astype(np.int64) for name, (a, begins) in places.items()}
    )
