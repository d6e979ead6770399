"""Probe of model exchange: an FMU that only supports co-simulation must not declare it."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator
from ctypes import c_double, c_int
from dataclasses import replace

from builder.check.catalogue import behaviour as rules
from builder.check.probes.bench import Bench, Results, Skip
from builder.check.probes.instance import CallError, Instance
from builder.check.probes.library import MODEL_EXCHANGE, EventInfo, MissingFunctionError
from builder.check.rules import Finding

_STEPS, _H = 5, 1e-6  # s: Euler's method must stay stable for a stiff model
_MOST_ITERATIONS = 100


def probe(bench: Bench) -> Results:
    """Do a few tiny steps of Euler's method."""
    declared = bench.description.model_exchange
    if declared is None:
        yield Skip("it does not support model exchange")
    elif declared.get("modelIdentifier") != bench.description.identifier:
        yield Skip("its model exchange is in a separate binary")
    else:
        yield from _run(bench)


def _run(bench: Bench) -> Iterator[Finding]:
    try:
        with bench.instance(replace(bench.birth, kind=MODEL_EXCHANGE)) as instance:
            yield from _steps(bench, instance)
    except (CallError, MissingFunctionError) as error:
        yield rules.MODEL_EXCHANGE.finding(f"instantiated for model exchange, {error}")


def _steps(bench: Bench, instance: Instance) -> Iterator[Finding]:
    bench.initialize(instance)
    if _iterate_events(instance):
        return
    instance.need("EnterContinuousTimeMode")
    count = len(bench.description.in_section("Derivatives"))
    indicators = _count(bench.description.attributes.get("numberOfEventIndicators", "0"))
    nominals = _vector(instance, "GetNominalsOfContinuousStates", count)
    if not all(math.isfinite(value) and value > 0.0 for value in nominals):
        yield rules.MODEL_EXCHANGE.finding(f"nominals of continuous states are not positive: {nominals[:6]}")
    states = _vector(instance, "GetContinuousStates", count)
    for point in range(1, _STEPS + 1):
        slopes = _vector(instance, "GetDerivatives", count)
        instance.need("SetTime", bench.timing.start + point * _H)
        states = [x + _H * slope for x, slope in zip(states, slopes, strict=True)]
        if states:
            instance.need("SetContinuousStates", (c_double * count)(*states), count)
        enter, end = c_int(), c_int()
        instance.need("CompletedIntegratorStep", 1, ctypes.byref(enter), ctypes.byref(end))
        _vector(instance, "GetEventIndicators", indicators)
        if enter.value or end.value:
            return  # an early event of the FMU is not a defect
    instance.need("Terminate")


def _iterate_events(instance: Instance) -> bool:
    """Do the event iteration after initialization; return whether the FMU ends the simulation there.

    Raises:
        CallError: A call was rejected, or the iteration does not end.
    """
    for _ in range(_MOST_ITERATIONS):
        info = EventInfo()
        instance.need("NewDiscreteStates", ctypes.byref(info))
        if info.terminateSimulation:
            return True
        if not info.newDiscreteStatesNeeded:
            return False
    raise CallError(f"fmi2NewDiscreteStates still needs new discrete states after {_MOST_ITERATIONS} iterations")


def _vector(instance: Instance, name: str, count: int) -> list[float]:
    values = (c_double * count)()
    if count:
        instance.need(name, values, count)
    return list(values)


def _count(text: str) -> int:
    return int(text) if text.isascii() and text.isdigit() else 0
