"""Probe of feedthrough: outputs that still change with an input if the step size goes to zero.

A change of an output that comes through the states shrinks with the step size; a change by feedthrough does not.
"""

from __future__ import annotations

from builder.check.catalogue import behaviour as rules
from builder.check.description import Variable
from builder.check.probes.bench import Bench, Results, Skip, Values, amplitude, inside
from builder.check.probes.instance import CallError
from builder.check.probes.pairs import Pairs, declared_pairs
from builder.check.probes.returning import Place, Route, place

_LONG, _SHORT = 1e-6, 1e-7  # s

#: Minimum share of the change over the short step that must remain at step size zero to count as feedthrough.
_SHARE = 0.05

#: Distance of inputs from their start values, in amplitudes, and whether parameters differ from their start values.
_POINTS = ((1.0, False), (1.0, True), (3.0, True), (10.0, True), (10.0, True))


def probe(bench: Bench) -> Results:
    """Perturb each input over two tiny steps."""
    declared = declared_pairs(bench.description, "Outputs")
    if reason := _reason_to_skip(bench, declared):
        yield Skip(reason)
        return
    pairs = Pairs(declared, {v.name for v in bench.inputs})
    refusals = []
    for seed, (scale, moves) in enumerate(_POINTS):
        try:
            with place(bench, Route(seed, scale, moves)) as there:
                _perturb(bench, there, pairs)
        except CallError as error:
            refusals.append(str(error))
    if len(refusals) == len(_POINTS):
        yield Skip(f"steps of {_SHORT:g} s fail: {refusals[0]}")
        return
    yield from pairs.findings("over a step", rules.FALSE_VELOCITY)


def _reason_to_skip(bench: Bench, declared: dict[str, set[str]]) -> str:
    if not bench.inputs or not bench.outputs:
        return "there are no Real inputs, or no Real outputs"
    if not declared:
        return "no dependencies are declared"
    return (
        "" if bench.description.can("canHandleVariableCommunicationStepSize") else "it only supports a fixed step size"
    )


def _perturb(bench: Bench, there: Place, pairs: Pairs) -> None:
    plain = {h: there.after(there.inputs, h) for h in (_LONG, _SHORT)}
    if there.after(there.inputs, _SHORT) != plain[_SHORT]:
        raise CallError("repeating the same step gives different outputs")
    for position, known in enumerate(bench.inputs):
        for value in _others(known, there.inputs[position]):
            moved = [*there.inputs[:position], value, *there.inputs[position + 1 :]]
            after = {h: there.after(moved, h) for h in (_LONG, _SHORT)}
            for k, unknown in enumerate(bench.outputs):
                long, short = (after[h][k] - plain[h][k] for h in (_LONG, _SHORT))
                direct = _direct(long, short)
                if direct and long == short and not _stays(there, moved, k, short):
                    continue  # the change is due to an internal step of the FMU that is longer than both steps
                if direct:
                    pairs.record(unknown, known, (plain[_SHORT][k], plain[_SHORT][k] + direct))


def _others(known: Variable, value: float) -> set[float]:
    """Return values to try: farther from, closer to, and on the other side of the start value."""
    size, start = amplitude(known), known.number("start") or 0.0
    tries = (value + size, value - size, 2 * start - value)
    return {inside(known, other) for other in tries} - {value}


def _direct(long: float, short: float) -> float:
    """Return the change extrapolated linearly to step size zero; 0 if the change comes through the states."""
    direct = (_LONG * short - _SHORT * long) / (_LONG - _SHORT)
    return direct if _SHARE * abs(short) < abs(direct) < 2.0 * abs(short) else 0.0


def _stays(there: Place, moved: Values, output: int, change: float) -> bool:
    """Return whether a change of an output is the same after long steps, so that no state is involved."""
    h = there.bench.timing.step
    return all(
        there.after(moved, length)[output] - there.after(there.inputs, length)[output] == change
        for length in (h, 2 * h, 4 * h)
    )
