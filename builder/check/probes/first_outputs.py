"""Probe of the outputs after initialization and before any step: the first step must continue from them."""

from __future__ import annotations

import random
from collections.abc import Iterator

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Results, Skip, Values, step
from builder.check.probes.instance import CallError, Instance
from builder.check.probes.pairs import other_value
from builder.check.rules import Finding, listed

_TINY = (1e-7, 1e-6)  # s
_ELSEWHERE = 12.5  # s: another start time, at which an internal input of the FMU does not jump again
#: Minimum jump relative to the change in a tiny step, and relative to the output's size (rounding).
_TIMES, _ROUNDING = 30.0, 1e-9


def probe(bench: Bench) -> Results:
    """Compare the outputs at the start values and with other inputs.

    A jump at the start time only is not a defect: it may come from an internal input of the FMU.
    """
    if not bench.description.can("canHandleVariableCommunicationStepSize") or not bench.outputs:
        yield Skip("it has no Real outputs, or only supports a fixed step size")
        return
    for inputs in (bench.held(0.0), [other_value(v, random.Random(2)) for v in bench.inputs]):
        wrong = _jumps(bench, inputs, bench.timing.start)
        if wrong:
            wrong = {name: jump for name, jump in wrong.items() if name in _jumps_elsewhere(bench, inputs, wrong)}
        yield from _findings(wrong)


def _findings(wrong: dict[str, str]) -> Iterator[Finding]:
    if wrong:
        yield rules.FIRST_OUTPUTS.finding(listed(list(wrong.values()), most=3))


def _jumps_elsewhere(bench: Bench, inputs: Values, found: dict[str, str]) -> dict[str, str]:
    """Return the jumps at another start time; return `found` if the FMU cannot start there."""
    try:
        return _jumps(bench, inputs, bench.timing.start + _ELSEWHERE)
    except CallError:
        return found


def _jumps(bench: Bench, inputs: Values, start: float) -> dict[str, str]:
    """Return a description, by name, of each output that jumps in a tiny step."""
    before, *after = (_outputs(bench, inputs, start, h) for h in (0.0, *_TINY))
    if after[0] == after[1] and not _is_at_rest(bench, inputs, start, after[0]):
        return {}  # the FMU has longer internal steps: the change may be that of a whole internal step
    found = {}
    for variable, old, new, later in zip(bench.outputs, before, *after, strict=True):
        size = max(abs(old), abs(new), variable.number("nominal") or 1.0)  # default of FMI: 1
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
    """Return whether the outputs do not change over long steps either."""
    return all(_outputs(bench, inputs, start, n * bench.timing.step) == outputs for n in (1, 2, 4))


def _initialize(bench: Bench, instance: Instance, inputs: Values, start: float) -> None:
    bench.enter(instance, start=start)
    bench.drive(instance, inputs)
    instance.need("ExitInitializationMode")
