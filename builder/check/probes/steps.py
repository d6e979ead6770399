"""Probe of steps of irregular length, also from other start times."""

from __future__ import annotations

import math
from collections.abc import Iterator

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Results, Skip
from builder.check.probes.instance import Instance, is_error, refused, status_name
from builder.check.probes.library import DISCARD
from builder.check.rules import Finding

_LENGTHS = (1e-3, 1e-7, 0.05, 3.3e-4, 1e-6, 7e-3, 1e-5, 1 / 3 * 1e-2, 0.02, 1.1e-7)
_LATER = (0.0, 12.5, 1234.5)  # s after the start of the default experiment


def probe(bench: Bench) -> Results:
    """Step with irregular lengths from several start times."""
    if not bench.description.can("canHandleVariableCommunicationStepSize"):
        yield Skip("canHandleVariableCommunicationStepSize is not true")
        return
    for later in _LATER:
        start = bench.timing.start + later
        with bench.instance() as instance:
            bench.enter(instance, start=start)
            instance.need("ExitInitializationMode")
            yield from _walk(bench, instance, start)


def _walk(bench: Bench, instance: Instance, start: float) -> Iterator[Finding]:
    time = start
    for round_number in range(4):
        for length in _LENGTHS:
            bench.drive(instance, bench.excitation(time, 0.5))
            status = instance.step(time, length)
            if status == DISCARD and instance.has_terminated():
                return
            if refused(status):
                is_usual = start == bench.timing.start  # after the end of its experiment an FMU may have no data
                rule = rules.STEPS if is_error(status) and is_usual else rules.STEPS_DISCARDED
                yield rule.finding(f"from {time!r} s by {length:g} s: {status_name(status)}{instance.last_message()}")
                return
            time += length
            if not all(map(math.isfinite, instance.reals(bench.outputs))):
                yield rules.FINITE.finding(
                    f"after irregular steps up to {length:g} s, at {time:g} s, round {round_number}"
                )
                return
