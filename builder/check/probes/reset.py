"""fmi2Reset: the run after it is the run before it."""

from __future__ import annotations

import random
from collections.abc import Iterator

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Said, Values, differ
from builder.check.probes.instance import Instance
from builder.check.probes.perturbation import other_value
from builder.check.rules import Finding

_TOLERANCE = 1e-9


def probe(bench: Bench) -> Said:
    """Run, disturb, reset, run again: from the middle, from initialization mode, after the end."""
    with bench.instance() as instance:
        first = _run(bench, instance)
        for where in ("between steps", "in initialization mode", "after fmi2Terminate"):
            _disturb(bench, instance, where)
            instance.need("Reset", note=f" {where}")
            yield from _compare(where, first, _run(bench, instance))
            instance.need("Reset")


def _run(bench: Bench, instance: Instance) -> list[Values]:
    bench.initialize(instance)
    return [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, bench.all_points())]


def _disturb(bench: Bench, instance: Instance, where: str) -> None:
    """Leave the instance with other parameters, inputs and states; what it refuses is not set."""
    if where == "between steps":  # it has just run: take it from where it is
        instance.need("Reset")
    bench.enter(instance)
    draw = random.Random(1)
    for variable in bench.description.of("parameter"):
        instance.set(variable, other_value(variable, draw))
    bench.drive(instance, bench.excitation(bench.timing.at(17)))
    if where == "in initialization mode":
        return
    instance.need("ExitInitializationMode")
    bench.run(instance, bench.excitation, range(min(20, bench.timing.count)))
    if where == "after fmi2Terminate":
        instance.need("Terminate")


def _compare(where: str, first: list[Values], second: list[Values]) -> Iterator[Finding]:
    worst = differ(first, second)
    if worst > _TOLERANCE:
        yield rules.RESET.finding(f"after fmi2Reset {where} the same run differs by {worst:.1e} of the outputs' size")
    elif worst > 0.0:
        yield rules.RESET_BITS.finding(f"after fmi2Reset {where} the same run differs by {worst:.1e}")
