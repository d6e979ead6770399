"""Probe of what only FMI 3.0 has: results of steps, intermediate updates, arrays, adjoint derivatives."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator, Sequence
from ctypes import c_char_p, c_double, c_size_t, c_uint
from dataclasses import replace
from typing import Any

from builder.check.probes.bench import Bench, CallError, Instance, Results, Skip, refused
from builder.check.probes.library import (
    CO_SIMULATION,
    MODEL_EXCHANGE,
    TYPES,
    Clock,
    FmuLibrary3,
    Logger3,
    MissingFunctionError,
    Update,
    path_of,
)
from builder.check.rules import Fault, some
from eightpost.fmi import Variable, whole_number

_STEPS = 20
_ROUNDING = 1e-9


def probe_version_3(bench: Bench) -> Results:
    """Check what the probes of both versions do not."""
    library = bench.library
    if not isinstance(library, FmuLibrary3):
        yield Skip("it is of FMI 2.0")
        return
    yield from _undeclared(bench, library)
    yield from _declared(bench, library)
    yield from _numbers(bench, library)
    if bench.description.co_simulation is None:
        yield Skip("the FMU does not support co-simulation", "steps, values and adjoint derivatives")
        return
    yield from _steps(bench, library)
    yield from _counts(bench, library)
    yield from _arrays(bench, library)
    yield from _adjoint(bench, library)


def _undeclared(bench: Bench, library: FmuLibrary3) -> Iterator[Fault]:
    """Try to instantiate interface types that the description does not declare."""
    description = bench.description
    for kind, declared, name in (
        (MODEL_EXCHANGE, description.model_exchange, "model exchange"),
        (CO_SIMULATION, description.co_simulation, "co-simulation"),
    ):
        if declared is None and (created := _created(bench, library, kind)) is not None:
            created.free()
            yield "undeclared-type", f"an instance for {name} was created"


def _declared(bench: Bench, library: FmuLibrary3) -> Iterator[Fault]:
    """Instantiate with event mode and for scheduled execution, if the description declares them."""
    birth, log = bench.birth, Logger3(lambda *_: None)
    first = (b"probe", birth.guid.encode(), path_of((birth.resources or "").encode()), False, False)
    none = ctypes.cast(ctypes.c_void_p(None), Update)
    lock = ctypes.CFUNCTYPE(None)(lambda: None)
    kinds = {
        "event mode": (bench.description.can("hasEventMode"), "CoSimulation", (True, False, None, 0, None, log, none)),
        "scheduled execution": (
            bench.description.is_scheduled, "ScheduledExecution", (None, log, Clock(lambda *_: None), lock, lock)
        ),
    }  # fmt: skip
    for name, (is_declared, function, arguments) in kinds.items():
        if is_declared:
            library.begin(f"fmi3Instantiate{function}", f" for {name}")
            address = library.native(f"Instantiate{function}")(*first, *arguments)
            if address is None:
                yield "declared-kind", f"fmi3Instantiate{function} with {name} returned NULL"
            else:
                library.native("FreeInstance")(address)


def _created(bench: Bench, library: FmuLibrary3, kind: int) -> Instance | None:
    try:
        created = Instance(library, replace(bench.birth, kind=kind))
    except MissingFunctionError:
        return None
    return created if created.address is not None else None


def _steps(bench: Bench, library: FmuLibrary3) -> Iterator[Fault]:
    """Step with varying inputs, and look at the results of each step and at its intermediate updates.

    Before a second run, all results have values that a step must replace.
    """
    wrong, outside, requested, steps = [], [], 0, 0
    for library.unset in (False, True):
        with bench.running() as instance:
            for point in range(min(_STEPS, bench.timing.count)):
                time, h = bench.timing.at(point), bench.timing.step
                bench.drive(instance, bench.excitation(time))
                if refused(instance.step(time, h)) and not library.unset:
                    break  # other probes report this
                steps += 1
                live, end, margin = library.live(instance.address), time + h, _ROUNDING * max(1.0, abs(time + h))
                late = f"lastSuccessfulTime {live.last.value!r} after a step to {end!r} s"
                wrong += [] if abs(live.last.value - end) <= margin else [late]
                flags = {"earlyReturn": live.early, "eventHandlingNeeded": live.event}
                flags["terminateSimulation"] = live.terminate
                wrong += [name for name, flag in flags.items() if flag.value]
                outside += [t for t in live.requests if not time - margin <= t <= end + margin]
                requested += len(live.requests)
    library.unset = False
    yield "step-results", some(dict.fromkeys(wrong), most=3)
    if outside:
        yield "intermediate-update", f"called at {outside[0]!r} s, outside the step"
    if library.intermediate_inputs and steps and not requested:
        yield "intermediate-inputs", f"never requested in {steps} steps"


def _counts(bench: Bench, library: FmuLibrary3) -> Iterator[Fault]:
    """Get and set one variable with a wrong number of values."""
    variables = [v for v in (*bench.inputs, *bench.outputs) if v.native == "Float64"][:1]
    accepted = []
    for variable in variables:
        references, values = (c_uint * 1)(int(variable.reference)), (c_double * 2)()
        for name in ("GetFloat64", "SetFloat64") if variable.causality == "input" else ("GetFloat64",):
            for count in (0, 2):
                with bench.running() as instance:
                    library.begin(f"fmi3{name} with {count} values for one variable")
                    status = library.native(name)(instance.address, references, 1, values, count)
                accepted += [] if refused(status) else [f"fmi3{name} with {count} values"]
    yield "value-count", some(accepted, "accepted for one variable: ")


def _arrays(bench: Bench, library: FmuLibrary3) -> Iterator[Fault]:
    description = bench.description
    arrays = [v for v in description.variables if description.lengths.get(v.name) and v.start and v.native in TYPES]
    with bench.instance() as instance:
        bench.enter(instance)
        for variable in arrays:
            stated = _start_values(variable, description.lengths[variable.name])
            if stated is None:
                continue  # a string, or values that the static rules report
            read = _read_array(library, instance, variable, len(stated))
            if read is None:
                count = f"{len(stated)} values of {variable.name}"
                yield "array-start", f"{count} cannot be read{instance.last_message()}"
            elif any(not math.isclose(a, b, rel_tol=1e-6, abs_tol=1e-300) for a, b in zip(read, stated, strict=True)):
                yield "array-start", f"{variable.name} is {read[:6]} in the binary, {stated[:6]} in the XML"


def _start_values(variable: Variable, length: int) -> list[float] | None:
    texts = (variable.start or "").split()
    if TYPES[variable.native] is c_char_p or len(texts) not in (1, length) or whole_number(variable.reference) is None:
        return None
    words = {"true": "1", "false": "0"}
    try:
        values = [float(words.get(text, text)) for text in texts]
    except ValueError:
        return None
    return values * length if len(values) == 1 else values


def _read_array(library: FmuLibrary3, instance: Instance, variable: Variable, length: int) -> Sequence[float] | None:
    native = "Int64" if variable.native == "Enumeration" else variable.native
    values: Any = (TYPES[native] * length)()
    library.begin(f"fmi3Get{native} of {variable.name}")
    reference = (c_uint * 1)(int(variable.reference))
    status = library.native(f"Get{native}")(instance.address, reference, 1, values, length)
    return None if refused(status) else [float(value) for value in values]


def _numbers(bench: Bench, library: FmuLibrary3) -> Iterator[Fault]:
    """Compare the numbers of states and event indicators; arrays count with all their elements."""
    description = bench.description
    if description.model_exchange is None:
        return
    created = _created(bench, library, MODEL_EXCHANGE)
    if created is None:
        return  # the probe of model exchange reports this
    sections = (("GetNumberOfContinuousStates", "Derivatives"), ("GetNumberOfEventIndicators", "EventIndicators"))
    for name, section in sections:
        count = c_size_t()
        library.begin(f"fmi3{name}")
        status = library.native(name)(created.address, ctypes.byref(count))
        variables = [description.variable(unknown.index) for unknown in description.in_section(section)]
        listed_count = sum(description.lengths.get(v.name, 1) for v in variables if v is not None)
        if refused(status) or count.value != listed_count:
            yield "number-of-states", f"fmi3{name} returns {count.value}, the description lists {listed_count}"
    created.free()


def _adjoint(bench: Bench, library: FmuLibrary3) -> Iterator[Fault]:
    """Compare adjoint with directional derivatives of all outputs by all inputs."""
    description = bench.description
    if not (description.can("providesAdjointDerivatives") and description.can("providesDirectionalDerivative")):
        return
    inputs = [v for v in bench.inputs if v.native == "Float64" and v.variability == "continuous"]
    if not inputs or not bench.outputs:
        return
    with bench.running() as instance:
        bench.drive(instance, bench.excitation(bench.timing.start + 0.3 * bench.timing.step))
        forward = [[_needed(instance, instance.directional(u, k)) for u in bench.outputs] for k in inputs]
        seed = [1.0 + 0.5 * k for k in range(len(bench.outputs))]
        backward = _sensitivities(library, instance, bench.outputs, inputs, seed)
    for variable, row, came in zip(inputs, forward, backward, strict=True):
        expected = sum(s * d for s, d in zip(seed, row, strict=True))
        size = sum(abs(s * d) for s, d in zip(seed, row, strict=True))
        if not abs(came - expected) <= 1e-9 * size:
            yield "adjoint-derivative", f"by {variable.name}: {came!r}, not {expected!r}"
            return


def _needed(instance: Instance, result: tuple[int, float]) -> float:
    status, value = result
    if refused(status):
        raise CallError(f"fmi3GetDirectionalDerivative was rejected{instance.last_message()}")
    return value


def _sensitivities(
    library: FmuLibrary3,
    instance: Instance,
    unknowns: Sequence[Variable],
    knowns: Sequence[Variable],
    seed: Sequence[float],
) -> list[float]:
    rows = [(c_uint * len(variables))(*(int(v.reference) for v in variables)) for variables in (unknowns, knowns)]
    result = (c_double * len(knowns))()
    library.begin("fmi3GetAdjointDerivative")
    status = library.native("GetAdjointDerivative")(
        instance.address, rows[0], len(unknowns), rows[1], len(knowns),
        (c_double * len(seed))(*seed), len(seed), result, len(knowns),
    )  # fmt: skip
    if refused(status):
        raise CallError(f"fmi3GetAdjointDerivative was rejected{instance.last_message()}")
    return list(result)
