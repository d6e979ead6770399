"""Probes of single calls: those that hosts make in different ways, and invalid ones, which must be rejected."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, suppress
from ctypes import c_double, c_uint
from dataclasses import dataclass, replace
from typing import Any

from builder.check.probes.bench import (
    C_TYPES,
    Bench,
    CallError,
    Instance,
    Results,
    Value,
    base_type,
    other_value,
    refused,
    status_name,
)
from builder.check.probes.library import ERROR, FATAL, FREEING_NOTHING, MissingFunctionError
from builder.check.rules import Fault, listed, some
from eightpost.fmi import Variable

# ---- What hosts do in different ways --------------------------------------------------------------------------------

_NAME = "a model/its ünits: " * 20
_MOST_LOST = 5  # parameters


def probe_hosts(bench: Bench) -> Results:
    """Do what some hosts do and others do not, with an instance for each."""
    for rule, habit in {"instance-name": _named, "tolerance": _with_tolerance, "stop-rounding": _stopped}.items():
        try:
            habit(bench)
        except CallError as error:
            yield rule, str(error)
    yield "start-kept", some(_lost(bench), "set before initialization mode, with another value in it: ")


def _named(bench: Bench) -> None:
    with bench.running(birth=replace(bench.birth, name=_NAME)) as instance:
        bench.run(instance, bench.held, range(1))


def _with_tolerance(bench: Bench) -> None:
    with bench.instance() as instance:
        instance.need("SetupExperiment", 1, 1e-6, bench.timing.start, 0, 0.0, note=" with a tolerance")
        for name in ("EnterInitializationMode", "ExitInitializationMode"):
            instance.need(name, note=" with a tolerance")


def _stopped(bench: Bench) -> None:
    """Step to a stop time that the sum of the steps exceeds by rounding."""
    start, h = bench.timing.start, bench.timing.step
    times = [*itertools.accumulate([h] * bench.timing.count, initial=start)]
    count = next((k for k, time in enumerate(times) if time > start + k * h), 0)
    with bench.running(stop=start + count * h if count else None) as instance:
        for time in times[:count]:
            bench.drive(instance, bench.held(time))
            instance.advance(time, h)


def _lost(bench: Bench) -> Iterator[str]:
    """Yield parameters that do not keep a value that was set before initialization mode."""
    for variable in bench.description.of("parameter")[:_MOST_LOST]:
        value = other_value(variable, random.Random(1))
        with suppress(CallError), bench.instance() as instance:  # it may contradict another parameter
            if not refused(instance.set(variable, value)):
                bench.enter(instance)
                if not math.isclose(float(instance.get(variable)[1]), value, rel_tol=1e-6):
                    yield variable.name


# ---- Calls in the wrong order, invalid steps, locked variables ------------------------------------------------------


@dataclass(frozen=True)
class _Misuse:
    """A call that must be rejected: its title, the rule, the preparation of the instance, and the call."""

    title: str
    rule: str
    instance: Callable[[], AbstractContextManager[Instance]]
    call: Callable[[Instance], int]


def probe_state_machine(bench: Bench) -> Results:
    """Try every invalid call, then valid ones; a step of NaN comes last, because some FMUs never return from it."""
    yield from _refusals(bench, list(_misuses(bench)))
    yield from _guid(bench)
    yield from _tunable(bench)
    nan = _Misuse("fmi2DoStep of NaN", "step-arguments", bench.running, _stepping(bench.timing.start, math.nan))
    yield from _refusals(bench, [nan])


def _refusals(bench: Bench, misuses: list[_Misuse]) -> Iterator[Fault]:
    silent, stuck, fatal = [], [], []
    for misuse in misuses:
        with misuse.instance() as instance:
            before = len(instance.messages)
            status = misuse.call(instance)
            if not refused(status):
                yield misuse.rule, f"{misuse.title} returned {status_name(status)}"
                continue
            silent += [] if len(instance.messages) > before else [misuse.title]
            fatal += [misuse.title] if status == FATAL else []
            stuck += [] if status == FATAL or _runs_after_reset(bench, instance) else [misuse.title]
    yield "refusal-logged", some(silent)
    yield "never-fatal", some(fatal)
    yield "usable-after-refusal", some(stuck)


def _stepping(time: float, size: float) -> Callable[[Instance], int]:
    return lambda instance: instance.step(time, size)


def _misuses(bench: Bench) -> Iterator[_Misuse]:
    t, h = bench.timing.start, bench.timing.step

    def calling(name: str) -> Callable[[Instance], int]:
        return lambda instance: instance.call(name)

    def terminated(instance: Instance) -> int:
        instance.need("Terminate")
        return instance.step(t, h)

    def past_the_end(instance: Instance) -> int:
        bench.enter(instance, stop=t + 3 * h)
        instance.need("ExitInitializationMode")
        for point in range(3):
            instance.advance(bench.timing.at(point), h)
        return instance.step(t + 3 * h, h)

    enter, leave = "EnterInitializationMode", "ExitInitializationMode"
    yield _Misuse("fmi2DoStep before initialization", "call-order", bench.instance, _stepping(t, h))
    yield _Misuse("fmi2DoStep in initialization mode", "call-order", bench.initializing, _stepping(t, h))
    yield _Misuse(f"fmi2{leave} before initialization mode", "call-order", bench.instance, calling(leave))
    yield _Misuse(f"fmi2{enter} twice", "call-order", bench.initializing, calling(enter))
    yield _Misuse(f"fmi2{enter} after initialization", "call-order", bench.running, calling(enter))
    yield _Misuse("fmi2DoStep after fmi2Terminate", "call-order", bench.running, terminated)
    yield _Misuse("fmi2DoStep from a wrong point", "step-arguments", bench.running, _stepping(t + 10 * h, h))
    yield _Misuse("fmi2DoStep of zero length", "step-arguments", bench.running, _stepping(t, 0.0))
    yield _Misuse("fmi2DoStep of negative length", "step-arguments", bench.running, _stepping(t, -h))
    yield _Misuse("fmi2DoStep past the stop time", "stop-time", bench.instance, past_the_end)
    yield from _locked(bench)


def _locked(bench: Bench) -> Iterator[_Misuse]:
    """Yield calls that set fixed parameters and outputs after initialization."""

    def setting(variable: Variable, value: Value) -> Callable[[Instance], int]:
        return lambda instance: instance.set(variable, value)

    fixed = [v for v in bench.description.of("parameter") if v.variability == "fixed"]
    for variable in fixed[:1]:
        call, title = setting(variable, variable.number("start") or 0.0), f"the fixed {variable.name} between steps"
        yield _Misuse(f"setting {title}", "locked", bench.running, call)
    for variable in bench.outputs[:1]:
        yield _Misuse(f"setting the output {variable.name}", "locked", bench.running, setting(variable, 0.0))


def _runs_after_reset(bench: Bench, instance: Instance) -> bool:
    try:
        instance.need("Reset")
        bench.initialize(instance)
        bench.run(instance, bench.held, range(3))
    except (CallError, MissingFunctionError):
        return False
    return True


def _guid(bench: Bench) -> Iterator[Fault]:
    created = Instance(bench.library, replace(bench.birth, guid="{00000000-0000-0000-0000-000000000000}"))
    if created.address is not None:
        created.free()
        yield "guid-checked", "fmi2Instantiate with a wrong GUID returned an instance"


def _tunable(bench: Bench) -> Iterator[Fault]:
    wrong = []
    live = [v for v in bench.description.of("parameter") if v.variability == "tunable"]
    for variable in [*live, *bench.inputs]:
        with bench.running() as instance:
            status = instance.set(variable, variable.number("start") or 0.0)
            if status < ERROR and not refused(status):
                status = instance.step(bench.timing.start, bench.timing.step)
            wrong += [variable.name] if refused(status) else []
    yield "tunable", some(wrong, "rejected when set to the start value between steps: ")


# ---- Unknown references and invalid values --------------------------------------------------------------------------


def probe_values(bench: Bench) -> Results:
    """Try unknown references, then invalid values."""
    yield from _unknown_references(bench)
    yield from _bad_values(bench)


def _unknown_references(bench: Bench) -> Iterator[Fault]:
    accepted = []
    for kind, buffer_type in C_TYPES.items():
        used = {int(v.reference) for v in bench.description.variables if v.is_callable and base_type(v) == kind}
        for reference in {max(used, default=0) + 1, 2**31 + min(used, default=0), 2**32 - 1} - used:
            for way in ("Get", "Set"):
                with bench.running() as instance:
                    content = (buffer_type * 1)(b"x" if kind == "String" else 0)
                    note = f" of the unknown reference {reference}"
                    status = instance.call(f"{way}{kind}", (c_uint * 1)(reference), 1, content, note=note)
                    accepted += [] if refused(status) else [f"fmi2{way}{kind} of {reference}"]
    yield "bad-reference", some(accepted, "accepted: ")


def _bad_values(bench: Bench) -> Iterator[Fault]:
    """Set invalid values; the instance is replaced after it accepts one or changes a value."""
    accepted: dict[str, list[str]] = {}
    changed: list[str] = []
    settable = [v for v in bench.description.variables if v.type == "Real" and v.is_settable_at_start]
    with ExitStack() as stack:
        instance = stack.enter_context(bench.initializing())
        for variable, rule, value in ((v, *case) for v in settable for case in _bad(v)):
            if not refused(instance.set(variable, value)):
                accepted.setdefault(rule, []).append(f"{variable.name} = {value}")
            elif _is_unchanged(instance, variable):
                continue
            else:
                changed.append(variable.name)
            stack.close()
            instance = stack.enter_context(bench.initializing())
        if not accepted and not _continues(bench, instance):
            changed.append("the step after rejected values")
    for rule, names in accepted.items():
        yield rule, f"accepted: {listed(names)}"
    yield "old-value", some(changed, "changed: ")


def _bad(variable: Variable) -> Iterator[tuple[str, float]]:
    for value in (math.nan, math.inf, -math.inf):
        yield "not-finite", value
    for end, sign in (("min", -1.0), ("max", 1.0)):
        limit = variable.number(end)
        if limit is not None and abs(limit) < 1e300:
            yield "out-of-range", limit + sign * max(1.0, abs(limit))


def _is_unchanged(instance: Instance, variable: Variable) -> bool:
    status, value = instance.get(variable)
    return not refused(status) and value == (variable.number("start") or 0.0)


def _continues(bench: Bench, instance: Instance) -> bool:
    try:
        instance.need("ExitInitializationMode")
        bench.run(instance, bench.held, range(3))
    except CallError:
        return False
    return True


# ---- NULL arguments -------------------------------------------------------------------------------------------------


def probe_null(bench: Bench) -> Results:
    """Call fmi2FreeInstance(NULL), which the standard allows; then NULL for a missing folder and for each array."""
    bench.library.begin(FREEING_NOTHING)
    bench.library.function("FreeInstance")(None)
    if not (bench.folder / "resources").is_dir():
        with suppress(CallError), bench.instance(replace(bench.birth, resources=None)):  # it may return NULL
            pass
    accepted = []
    for name, arguments in _calls(bench):
        with bench.running() as instance:
            status = instance.call(name, *arguments, note=" with NULL")
            accepted += [] if refused(status) else [f"fmi2{name}"]
    yield "null-argument", some(dict.fromkeys(accepted), "accepted by ")


def _calls(bench: Bench) -> Iterator[tuple[str, tuple[Any, ...]]]:
    real = (bench.inputs or bench.outputs)[:1]
    if real:
        reference, value = (c_uint * 1)(int(real[0].reference)), (c_double * 1)()
        for name in ("GetReal", "SetReal"):
            yield name, (None, 1, value)
            yield name, (reference, 1, None)
    if bench.description.can("canGetAndSetFMUstate"):
        yield "GetFMUstate", (None,)
        yield "SetFMUstate", (None,)
    if bench.description.can("canSerializeFMUstate"):
        yield "DeSerializeFMUstate", (None, 8, None)
    if bench.description.can("providesDirectionalDerivative"):
        yield "GetDirectionalDerivative", (None, 1, None, 1, None, None)
    if bench.description.can("canInterpolateInputs") and bench.inputs:
        yield "SetRealInputDerivatives", (None, 1, None, None)
