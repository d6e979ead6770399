"""Probe of directional derivatives, compared with central differences, and of input and output derivatives."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from builder.check.probes.bench import Bench, Results, Skip, Values, amplitude, change_of, other_value, step
from builder.check.probes.dependencies import Place, Route, declared_pairs, place
from builder.check.probes.instance import Instance, refused, status_name
from builder.check.rules import RULES, Finding, listed
from eightpost.fmi.description import Variable

_POINTS = 3
_TINY = 1e-6  # s
_SMOOTH, _WRONG, _NOTHING = 1e-4, 1e-3, 1e-8


def probe_derivatives(bench: Bench) -> Results:
    """Check the derivatives that the flags declare."""
    if bench.description.can("providesDirectionalDerivative"):
        yield from _in_initialization(bench)
        yield from _over_steps(bench)
    else:
        yield Skip("providesDirectionalDerivative is not true", "directional derivatives")
    if bench.description.interpolated_inputs:
        yield from _input_derivatives(bench)
    else:
        yield Skip("canInterpolateInputs is not true", "input derivatives")
    yield from _output_derivatives(bench)


def _in_initialization(bench: Bench) -> Iterator[Finding]:
    wrong: dict[str, str] = {}
    for seed in range(_POINTS):
        with bench.initializing() as instance:
            draw = random.Random(seed)
            for variable in bench.inputs:
                instance.set(variable, other_value(variable, draw))
            for unknown, known in _pairs(bench, "InitialUnknowns"):
                if fault := _compare_at_start(instance, unknown, known):
                    wrong.setdefault(f"{unknown.name} by {known.name}", fault)
    yield from _findings("in initialization mode", wrong)


def _pairs(bench: Bench, section: str) -> list[tuple[Variable, Variable]]:
    by_name = bench.description.by_name
    return [
        (by_name[unknown], by_name[known])
        for unknown, names in declared_pairs(bench.description, section).items()
        for known in sorted(names)
        if by_name[unknown].type == by_name[known].type == "Real"
        and by_name[unknown].is_callable
        and by_name[known].is_callable
    ]


def _compare_at_start(instance: Instance, unknown: Variable, known: Variable) -> str:
    _, value = instance.get(known)
    status, stated = instance.directional(unknown, known)
    if refused(status):
        return "rejected"

    def at(shift: float) -> float | None:
        done = instance.set(known, float(value) + shift)
        status, (result,) = instance.get_reals([unknown])
        return None if refused(done) or refused(status) else result

    fault = _judge(stated, at, _sizes(unknown, known, change_of(known)))
    instance.set(known, value)
    return fault


@dataclass(frozen=True)
class _Sizes:
    """The change of the known variable, its range in practice, and the minimum size of the unknown."""

    change: float
    reach: float
    unknown: float


def _sizes(unknown: Variable, known: Variable, change: float) -> _Sizes:
    return _Sizes(change, 1e3 * change_of(known), unknown.number("nominal") or 1.0)


def _judge(stated: float, at: Callable[[float], float | None], sizes: _Sizes) -> str:
    """Return the error of a derivative as text; "" if it is correct or if the function is not smooth there.

    The function counts as smooth if two central differences agree.
    """
    change = sizes.change
    ends = [at(shift * change) for shift in (-1.0, -0.5, 0.5, 1.0)]
    if None in ends:
        return ""
    a, b, c, d = (float(end or 0.0) for end in ends)
    wide, narrow = (d - a) / (2 * change), (c - b) / change
    size = max(*map(abs, (a, b, c, d)), sizes.unknown)
    if abs(wide - narrow) > _SMOOTH * abs(narrow) + 1e-14 * size / change:
        return ""
    if abs(stated - narrow) <= _WRONG * abs(narrow) + 1e-13 * size / change + _NOTHING * size / sizes.reach:
        return ""
    return f"{stated:.6g} instead of {narrow:.6g}"


def _over_steps(bench: Bench) -> Results:
    if not bench.description.can("canGetAndSetFMUstate"):
        yield Skip("it needs FMU states", "directional derivatives over steps")
        return
    if not bench.description.can("canHandleVariableCommunicationStepSize"):
        yield Skip("it only supports a fixed step size", "directional derivatives over steps")
        return
    wrong: dict[str, str] = {}
    for seed in range(_POINTS):
        with place(bench, Route(seed, 1.0, moves=False)) as there:
            for unknown, known in _pairs(bench, "Outputs"):
                if known in bench.inputs and (fault := _compare_step(there, unknown, known)):
                    wrong.setdefault(f"{unknown.name} by {known.name}", fault)
    yield from _findings("between steps", wrong)


def _compare_step(there: Place, unknown: Variable, known: Variable) -> str:
    position, output = there.bench.inputs.index(known), there.bench.outputs.index(unknown)

    def at(shift: float) -> float:
        """Return the output extrapolated to step size zero from three short steps, without the part of the states."""
        moved: Values = list(there.inputs)
        moved[position] += shift
        whole, half, quarter = (there.after(moved, h)[output] for h in (_TINY, _TINY / 2, _TINY / 4))
        return (whole - 6 * half + 8 * quarter) / 3

    there.after(there.inputs, _TINY / 4)
    status, stated = there.instance.directional(unknown, known)
    return "rejected" if refused(status) else _judge(stated, at, _sizes(unknown, known, 10 * change_of(known)))


def _findings(where: str, wrong: dict[str, str]) -> Iterator[Finding]:
    if wrong:
        shown = [f"{pair} is {fault}" for pair, fault in wrong.items()]
        yield RULES["directional-derivative"].finding(f"{where} {listed(shown, most=3)}")


def _input_derivatives(bench: Bench) -> Iterator[Finding]:
    h, t = bench.timing.step, bench.timing.start
    moving = bench.description.interpolated_inputs
    ends = []
    for size in (0.0, 1.0):
        with bench.running() as instance:
            bench.drive(instance, bench.held(t))
            status = instance.set_derivatives(moving, [size * amplitude(v) / h for v in moving])
            if refused(status):
                yield RULES["input-derivatives"].finding(
                    f"fmi2SetRealInputDerivatives rejects order 1{instance.last_message()}"
                )
                return
            step(instance, t, h)
            ends.append(instance.reals(bench.outputs))
    if bench.outputs and ends[0] == ends[1]:
        yield RULES["interpolates"].finding(
            "a step with derivatives of all inputs gives the same outputs as a step without"
        )


def _output_derivatives(bench: Bench) -> Iterator[Finding]:
    """Read all declared orders after a few steps."""
    outputs = [v for v in bench.outputs if v.variability == "continuous"]
    for order in range(1, bench.description.output_derivative_order + 1 if outputs else 1):
        with bench.running() as instance:
            bench.run(instance, bench.excitation, range(min(3, bench.timing.count)))
            status, values = instance.output_derivatives(outputs, order)
            if refused(status):
                what = f"returned {status_name(status)}{instance.last_message()}"
            elif wrong := [v.name for v, value in zip(outputs, values, strict=True) if not math.isfinite(value)]:
                what = f"returned values that are not finite for {listed(wrong)}"
            else:
                continue
        yield RULES["output-derivatives"].finding(f"fmi2GetRealOutputDerivatives of order {order} {what}")
        return
