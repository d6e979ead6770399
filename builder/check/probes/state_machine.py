"""Probe of invalid calls: each is made on a new instance and must be rejected."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace

from builder.check.catalogue import behaviour as rules
from builder.check.description import Variable
from builder.check.probes.bench import Bench, Results, step
from builder.check.probes.instance import CallError, Instance, Value, refused, status_name
from builder.check.probes.library import ERROR, FATAL, MissingFunctionError
from builder.check.rules import Finding, Rule, listed


@dataclass(frozen=True)
class _Misuse:
    """A call that must be rejected: its title, the rule, the preparation of the instance, and the call."""

    title: str
    rule: Rule
    instance: Callable[[], AbstractContextManager[Instance]]
    call: Callable[[Instance], int]


def probe(bench: Bench) -> Results:
    """Try every invalid call, then valid ones; a step of NaN comes last, because some FMUs never return from it."""
    yield from _refusals(bench, list(_misuses(bench)))
    yield from _guid(bench)
    yield from _tunable(bench)
    yield from _refusals(bench, [_Misuse("fmi2DoStep of NaN", rules.STEP, bench.running, _nan_step(bench))])


def _refusals(bench: Bench, misuses: list[_Misuse]) -> Iterator[Finding]:
    silent, stuck, fatal = [], [], []
    for misuse in misuses:
        with misuse.instance() as instance:
            before = len(instance.messages)
            status = misuse.call(instance)
            if not refused(status):
                yield misuse.rule.finding(f"{misuse.title} returned {status_name(status)}")
                continue
            silent += [] if len(instance.messages) > before else [misuse.title]
            fatal += [misuse.title] if status == FATAL else []
            stuck += [] if status == FATAL or _runs_after_reset(bench, instance) else [misuse.title]
    for rule, titles in ((rules.REFUSAL_LOGGED, silent), (rules.NEVER_FATAL, fatal), (rules.USABLE, stuck)):
        if titles:
            yield rule.finding(listed(titles))


def _nan_step(bench: Bench) -> Callable[[Instance], int]:
    return lambda instance: instance.step(bench.timing.start, math.nan)


def _misuses(bench: Bench) -> Iterator[_Misuse]:
    t, h = bench.timing.start, bench.timing.step

    def stepping(time: float, size: float) -> Callable[[Instance], int]:
        return lambda instance: instance.step(time, size)

    def calling(name: str) -> Callable[[Instance], int]:
        return lambda instance: instance.call(name)

    yield _Misuse("fmi2DoStep before initialization", rules.ORDER, bench.instance, stepping(t, h))
    yield _Misuse("fmi2DoStep in initialization mode", rules.ORDER, bench.initializing, stepping(t, h))
    yield _Misuse(
        "fmi2ExitInitializationMode before initialization mode",
        rules.ORDER,
        bench.instance,
        calling("ExitInitializationMode"),
    )
    yield _Misuse(
        "fmi2EnterInitializationMode twice", rules.ORDER, bench.initializing, calling("EnterInitializationMode")
    )
    yield _Misuse(
        "fmi2EnterInitializationMode after initialization",
        rules.ORDER,
        bench.running,
        calling("EnterInitializationMode"),
    )
    yield _Misuse("fmi2DoStep after fmi2Terminate", rules.ORDER, bench.running, _terminated(bench))
    yield _Misuse("fmi2DoStep from a wrong point", rules.STEP, bench.running, stepping(t + 10 * h, h))
    yield _Misuse("fmi2DoStep of zero length", rules.STEP, bench.running, stepping(t, 0.0))
    yield _Misuse("fmi2DoStep of negative length", rules.STEP, bench.running, stepping(t, -h))
    yield _Misuse("fmi2DoStep past the stop time", rules.STOP_TIME, bench.instance, _past_the_end(bench))
    yield from _locked(bench)


def _terminated(bench: Bench) -> Callable[[Instance], int]:
    def call(instance: Instance) -> int:
        instance.need("Terminate")
        return instance.step(bench.timing.start, bench.timing.step)

    return call


def _past_the_end(bench: Bench) -> Callable[[Instance], int]:
    t, h = bench.timing.start, bench.timing.step

    def call(instance: Instance) -> int:
        bench.enter(instance, stop=t + 3 * h)
        instance.need("ExitInitializationMode")
        for point in range(3):
            step(instance, bench.timing.at(point), h)
        return instance.step(t + 3 * h, h)

    return call


def _locked(bench: Bench) -> Iterator[_Misuse]:
    """Yield calls that set fixed parameters and outputs after initialization."""

    def setting(variable: Variable, value: Value) -> Callable[[Instance], int]:
        return lambda instance: instance.set(variable, value)

    fixed = [v for v in bench.description.of("parameter") if v.variability == "fixed"]
    for variable in fixed[:1]:
        value = variable.number("start") or 0.0
        yield _Misuse(
            f"setting the fixed {variable.name} between steps", rules.LOCKED, bench.running, setting(variable, value)
        )
    for variable in bench.outputs[:1]:
        yield _Misuse(f"setting the output {variable.name}", rules.LOCKED, bench.running, setting(variable, 0.0))


def _runs_after_reset(bench: Bench, instance: Instance) -> bool:
    try:
        instance.need("Reset")
        bench.initialize(instance)
        bench.run(instance, bench.held, range(3))
    except (CallError, MissingFunctionError):
        return False
    return True


def _guid(bench: Bench) -> Iterator[Finding]:
    created = Instance(bench.library, replace(bench.birth, guid="{00000000-0000-0000-0000-000000000000}"))
    if created.address is not None:
        created.free()
        yield rules.GUID_CHECKED.finding("fmi2Instantiate with a wrong GUID returned an instance")


def _tunable(bench: Bench) -> Iterator[Finding]:
    wrong = []
    live = [v for v in bench.description.of("parameter") if v.variability == "tunable"]
    for variable in [*live, *bench.inputs]:
        with bench.running() as instance:
            status = instance.set(variable, variable.number("start") or 0.0)
            if status < ERROR and not refused(status):
                status = instance.step(bench.timing.start, bench.timing.step)
            wrong += [variable.name] if refused(status) else []
    if wrong:
        yield rules.TUNABLE.finding(f"rejected when set to the start value between steps: {listed(wrong)}")
