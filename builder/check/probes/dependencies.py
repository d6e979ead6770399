"""Which outputs follow an input without delay: those that still move when the step goes to nothing.

A change of an output that comes through the states shrinks with the step; a direct one stays.
"""

from __future__ import annotations

from builder.check.catalogue import behaviour as rules
from builder.check.description import Variable
from builder.check.probes.bench import Bench, Said, Skip, Values, amplitude, inside
from builder.check.probes.instance import CallError
from builder.check.probes.pairs import Pairs, declared_pairs
from builder.check.probes.returning import Place, Route, place

_LONG, _SHORT = 1e-6, 1e-7  # s

#: What of a change over the short step must be there with no step at all, to be direct.
_SHARE = 0.05

#: How far inputs go from their start values, in amplitudes, and whether parameters leave theirs.
_POINTS = ((1.0, False), (1.0, True), (3.0, True), (10.0, True), (10.0, True))


def probe(bench: Bench) -> Said:
    """Perturb each input over two tiny steps."""
    declared = declared_pairs(bench.description, "Outputs")
    if reason := _reason_not_to(bench, declared):
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
        yield Skip(f"steps of {_SHORT:g} s do not work: {refusals[0]}")
        return
    yield from pairs.findings("over a step", rules.FALSE_VELOCITY)


def _reason_not_to(bench: Bench, declared: dict[str, set[str]]) -> str:
    if not bench.inputs or not bench.outputs:
        return "there are no Real inputs, or no Real outputs"
    if not declared:
        return "no dependencies are declared"
    return "" if bench.description.can("canHandleVariableCommunicationStepSize") else "it takes steps of one size only"


def _perturb(bench: Bench, there: Place, pairs: Pairs) -> None:
    plain = {h: there.after(there.inputs, h) for h in (_LONG, _SHORT)}
    if there.after(there.inputs, _SHORT) != plain[_SHORT]:
        raise CallError("the same step twice gives other outputs")
    for position, known in enumerate(bench.inputs):
        for value in _others(known, there.inputs[position]):
            moved = [*there.inputs[:position], value, *there.inputs[position + 1 :]]
            after = {h: there.after(moved, h) for h in (_LONG, _SHORT)}
            for k, unknown in enumerate(bench.outputs):
                long, short = (after[h][k] - plain[h][k] for h in (_LONG, _SHORT))
                direct = _direct(long, short)
                if direct and long == short and not _stays(there, moved, k, short):
                    continue  # it came with a step of the FMU's own, longer than both
                if direct:
                    pairs.saw(unknown, known, (plain[_SHORT][k], plain[_SHORT][k] + direct))


def _others(known: Variable, value: float) -> set[float]:
    """Values to try: farther, nearer, and on the other side of the start value."""
    size, start = amplitude(known), known.number("start") or 0.0
    tries = (value + size, value - size, 2 * start - value)
    return {inside(known, other) for other in tries} - {value}


def _direct(long: float, short: float) -> float:
    """What is left of a change without any step, if it goes on linearly; 0 where it comes through the states."""
    direct = (_LONG * short - _SHORT * long) / (_LONG - _SHORT)
    return direct if _SHARE * abs(short) < abs(direct) < 2.0 * abs(short) else 0.0


def _stays(there: Place, moved: Values, output: int, change: float) -> bool:
    """Say whether a change of an output is the same after long steps: then no state has a part in it."""
    h = there.bench.timing.step
    return all(
        there.after(moved, length)[output] - there.after(there.inputs, length)[output] == change
        for length in (h, 2 * h, 4 * h)
    )
