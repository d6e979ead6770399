"""Outputs after initialization, before any step: they must be those from which the first step goes on."""

from __future__ import annotations

import random
from collections.abc import Iterator

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Said, Skip, Values, step
from builder.check.probes.instance import CallError, Instance
from builder.check.probes.perturbation import other_value
from builder.check.rules import Finding, listed

_TINY = (1e-7, 1e-6)  # s
_ELSEWHERE = 12.5  # s: where the jump of an input of the FMU's own at its start time does not come again
#: A jump: so many times what a tiny step changes, beyond what rounding makes of the output's size.
_TIMES, _ROUNDING = 30.0, 1e-9


def probe(bench: Bench) -> Said:
    """Compare at the start values, and with all inputs moved; an input that jumps at the start time is no defect."""
    if not bench.description.can("canHandleVariableCommunicationStepSize") or not bench.outputs:
        yield Skip("it has no Real outputs, or takes steps of one size only")
        return
    for inputs in (bench.held(0.0), [other_value(v, random.Random(2)) for v in bench.inputs]):
        wrong = _jumps(bench, inputs, bench.timing.start)
        if wrong:
            wrong = {name: said for name, said in wrong.items() if name in _jumps_elsewhere(bench, inputs, wrong)}
        yield from _told(wrong)


def _told(wrong: dict[str, str]) -> Iterator[Finding]:
    if wrong:
        yield rules.FIRST_OUTPUTS.finding(listed(list(wrong.values()), most=3))


def _jumps_elsewhere(bench: Bench, inputs: Values, found: dict[str, str]) -> dict[str, str]:
    """Return the jumps from another start time; those already found where the FMU does not start there."""
    try:
        return _jumps(bench, inputs, bench.timing.start + _ELSEWHERE)
    except CallError:
        return found


def _jumps(bench: Bench, inputs: Values, start: float) -> dict[str, str]:
    """Return by name what is said of each output that jumps over a step of next to no length."""
    before, *after = (_outputs(bench, inputs, start, h) for h in (0.0, *_TINY))
    if after[0] == after[1] and not _is_at_rest(bench, inputs, start, after[0]):
        return {}  # it has steps of its own, longer than these: the change may be that of a whole one
    found = {}
    for variable, old, new, later in zip(bench.outputs, before, *after, strict=True):
        size = max(abs(old), abs(new), variable.number("nominal") or 1.0)  # FMI: 1 where none is given
        jump, rate = abs(new - old), abs(later - new)
        if variable.variability == "continuous" and jump > max(_TIMES * rate, _ROUNDING * size):
            found[variable.name] = f"{variable.name} is {old:.6g} before the first step, {new:.6g} {_TINY[0]:g} s later"
    return found


def _outputs(bench: Bench, inputs: Values, start: float, h: float) -> Values:
    """Return the outputs after a step of h [s], or before any step."""
    with bench.instance() as instance:
        _initialize(bench, instance, inputs, start)
        if h > 0.0:
            bench.drive(instance, inputs)
            step(instance, start, h)
        return instance.reals(bench.outputs)


def _is_at_rest(bench: Bench, inputs: Values, start: float, outputs: Values) -> bool:
    """Say whether the outputs stay as they are over long steps too."""
    return all(_outputs(bench, inputs, start, n * bench.timing.step) == outputs for n in (1, 2, 4))


def _initialize(bench: Bench, instance: Instance, inputs: Values, start: float) -> None:
    bench.enter(instance, start=start)
    bench.drive(instance, inputs)
    instance.need("ExitInitializationMode")
