"""Probe of fmi2Reset: a run after it must equal the run before it."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator
from dataclasses import dataclass

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Results, Skip, Values, differ, step
from builder.check.probes.instance import CallError, Instance, TerminatedError
from builder.check.probes.pairs import other_value
from builder.check.rules import Finding

_TOLERANCE = 1e-9
_STRIDE = 10  # steps
_PATIENCE, _PROCESSOR_PATIENCE = 40.0, 15.0  # s


def probe(bench: Bench) -> Results:
    """Run, disturb, reset, run again: from the middle, from initialization mode, after the end."""
    with bench.instance() as instance:
        first = _run(bench, instance)
        for where in ("between steps", "in initialization mode", "after fmi2Terminate"):
            _disturb(bench, instance, where)
            instance.need("Reset", note=f" {where}")
            yield from _compare(where, first, _run(bench, instance))
            instance.need("Reset")
    yield from _late(bench)


def _late(bench: Bench) -> Iterator[Finding | Skip]:
    """Reset after twice the default experiment and repeat the run: some defects only occur or show late."""
    most = 2 * bench.timing.whole
    with bench.instance() as instance:
        first = _long_run(bench, instance, most)
        if first.refusal is None:
            yield from _repeated(bench, instance, first)
        elif isinstance(first.refusal, TerminatedError):
            yield from _after_the_end(bench, instance)
    end = bench.timing.at(first.steps)
    if first.refusal is not None:
        with bench.instance() as instance:  # it is reset just before the step that was rejected
            _long_run(bench, instance, first.steps, patient=True)
            yield from _repeated(bench, instance, first)
    if first.steps < most:
        yield Skip(str(first.refusal or "it would take too long"), f"a reset later than {end:g} s")


def _repeated(bench: Bench, instance: Instance, first: _LongRun) -> Iterator[Finding]:
    where = f"at {bench.timing.at(first.steps):g} s"
    instance.need("Reset", note=f" {where}")
    again = _long_run(bench, instance, first.steps, patient=True)
    if again.refusal is not None:
        yield rules.RESET.finding(f"after fmi2Reset {where} the same run ends earlier: {again.refusal}")
        return
    common = min(len(first.rows), len(again.rows))
    yield from _compare(where, first.rows[:common], again.rows[:common])


def _after_the_end(bench: Bench, instance: Instance) -> Iterator[Finding]:
    """Reset an instance that has ended the simulation itself."""
    try:
        instance.need("Reset", note=" after the FMU ended the simulation")
        bench.initialize(instance)
        bench.run(instance, bench.excitation, range(1))
    except CallError as error:
        yield rules.RESET_ENDED.finding(str(error))


@dataclass(frozen=True)
class _LongRun:
    """A run of many steps: outputs at every tenth point, the number of steps, and the error of the last step."""

    rows: list[Values]
    steps: int
    refusal: CallError | None


def _long_run(bench: Bench, instance: Instance, most: int, *, patient: bool = False) -> _LongRun:
    """Step until the time limit, or until a step is rejected; inputs are constant over ten steps."""
    bench.initialize(instance)
    rows: list[Values] = []
    point = 0
    end, processor_end = time.monotonic() + _PATIENCE, time.process_time() + _PROCESSOR_PATIENCE
    try:
        while point < most:
            if point % _STRIDE == 0:
                if not patient and (time.monotonic() > end or time.process_time() > processor_end):
                    break
                rows.append(instance.reals(bench.outputs))
                bench.drive(instance, bench.excitation(bench.timing.at(point)))
            step(instance, bench.timing.at(point), bench.timing.step)
            point += 1
    except CallError as error:  # after the end of its experiment an FMU may have no data
        return _LongRun(rows, point, error)
    return _LongRun(rows, point, None)


def _run(bench: Bench, instance: Instance) -> list[Values]:
    bench.initialize(instance)
    return [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, bench.all_points())]


def _disturb(bench: Bench, instance: Instance, where: str) -> None:
    """Change parameters, inputs and states of the instance; values that it rejects are ignored."""
    if where == "between steps":  # the instance has just run
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
