"""Probe of plain simulations: start values, constant inputs, varying inputs, repeated with and without logs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import replace

from builder.check.catalogue import behaviour as rules
from builder.check.description import Variable
from builder.check.probes.bench import REACH, Bench, Measured, Results, Values, differ
from builder.check.probes.instance import CallError, Instance, Message, TerminatedError, Value, refused
from builder.check.probes.library import ERROR
from builder.check.rules import Finding, listed

_CONVERSION = re.compile(rb"%[-+ #0]*\d*(\.\d+)?(l|ll|h|z)?[diufFeEgGxXsScp]")


def probe(bench: Bench) -> Results:
    """Simulate and check start values, outputs, repeatability and log messages."""
    with bench.instance(replace(bench.birth, logging=True)) as instance:
        bench.initialize(instance)
        reached = _walk(bench, instance, bench.held)
        if reached == bench.timing.count:
            yield from _time(bench, instance)
            instance.need("Terminate")
    if bench.inputs:
        with bench.running() as instance, suppress(CallError):  # reported as a finding below
            reached = min(reached, _walk(bench, instance, bench.excitation))
    if reached < bench.timing.count:
        yield Measured(REACH, str(reached))
        bench.timing = replace(bench.timing, count=reached)
    yield from _start_values(bench)
    try:
        runs = [_run(bench, logging) for logging in (True, False)]
    except CallError as error:
        yield rules.EXCITED.finding(str(error))
        return
    (first, messages), (second, _) = runs
    yield from _finite(bench, first)
    if first and differ(first, second):
        yield rules.DETERMINISM.finding("a second run in the same process gave different outputs")
    yield from _messages(messages)


def _walk(bench: Bench, instance: Instance, signal: Callable[[float], Values]) -> int:
    """Step until the end, or until the FMU ends the simulation itself; return the number of completed steps."""
    for point in bench.all_points():
        try:
            bench.run(instance, signal, range(point, point + 1))
        except TerminatedError as error:
            if point == 0:
                raise CallError(str(error)) from None
            return point
    return bench.timing.count


def _run(bench: Bench, logging: bool) -> tuple[list[Values], list[Message]]:
    with bench.instance(replace(bench.birth, logging=logging)) as instance:
        bench.initialize(instance)
        rows = [instance.reals(bench.outputs), *bench.run(instance, bench.excitation, bench.all_points())]
        instance.need("Terminate")
        return rows, instance.messages


def _time(bench: Bench, instance: Instance) -> Iterator[Finding]:
    times = bench.description.of("independent")
    if not times:
        return
    point = bench.timing.count
    while (late := _lateness(bench, instance, times[0], point)) and point < bench.timing.whole:
        bench.run(instance, bench.held, range(point, point + 1))  # the FMU may have longer internal steps
        point += 1
    if late:
        yield rules.TIME.finding(f"{times[0].name} is {late!r} s behind at {bench.timing.at(point)!r} s")


def _lateness(bench: Bench, instance: Instance, time: Variable, point: int) -> float:
    """Return the difference [s] between the time of a point and the time variable; 0 if it is only rounding."""
    (found,), there = instance.reals([time]), bench.timing.at(point)
    return 0.0 if abs(found - there) <= 1e-9 * max(1.0, abs(there)) else there - found


def _start_values(bench: Bench) -> Iterator[Finding]:
    wrong = []
    with bench.initializing() as instance:
        for variable in bench.description.variables:
            if variable.start is None or not _has_start(variable):
                continue
            status, value = instance.get(variable)
            if refused(status):
                raise CallError(
                    f"fmi2Get of {variable.name} in initialization mode was rejected{instance.last_message()}"
                )
            if not _agrees(variable, value):
                wrong.append(f"{variable.name} is {value!r}, but {variable.start} in the XML")
    if wrong:
        yield rules.START_AGREES.finding("; ".join(wrong[:5]) + (" ..." if len(wrong) > 5 else ""))


def _has_start(variable: Variable) -> bool:
    return variable.is_callable and (variable.causality == "input" or variable.effective_initial == "exact")


def _agrees(variable: Variable, value: Value) -> bool:
    start = variable.start or ""
    if isinstance(value, str):
        return value == start
    if variable.type == "Boolean":
        return bool(value) == (start.strip() in ("true", "1"))
    stated = variable.number("start")
    return stated is None or math.isclose(float(value), stated, rel_tol=1e-12)


def _finite(bench: Bench, rows: list[Values]) -> Iterator[Finding]:
    columns = zip(bench.outputs, zip(*rows, strict=True), strict=True)
    wrong = [v.name for v, column in columns if not all(map(math.isfinite, column))]
    if wrong:
        yield rules.FINITE.finding(f"not finite: {listed(wrong)}")


def _messages(messages: list[Message]) -> Iterator[Finding]:
    errors = list(dict.fromkeys(_shown(m.text) for m in messages if m.status >= ERROR))
    if errors:
        yield rules.LOGGED_ERROR.finding(f"it logged {listed(errors, most=2)}")
    if wrong := next((m for m in messages if _is_unformatted(m)), None):
        yield rules.LOG_TEXT.finding(f"it logged {wrong.text[:200]!r}")


def _is_unformatted(message: Message) -> bool:
    try:
        text = message.text.decode("utf-8")
    except UnicodeDecodeError:
        return True
    return bool(_CONVERSION.search(message.text)) or not all(c.isprintable() or c in "\n\t\r" for c in text)


def _shown(text: bytes) -> str:
    return text.decode("utf-8", "replace").strip()[:200]
