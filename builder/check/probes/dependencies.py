"""Probes of dependencies and of derivatives, compared with the declared ones and with differences."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from math import ceil, log2
from operator import itemgetter

from builder.check.probes.bench import (
    Bench,
    CallError,
    Instance,
    Results,
    Skip,
    Value,
    Values,
    amplitude,
    change_of,
    inside,
    other_value,
    refused,
    set_other_parameters,
    status_name,
)
from builder.check.rules import Fault, Faults, listed, some
from eightpost.fmi import Description, Variable

# ---- Declared and observed dependencies -----------------------------------------------------------------------------

#: Changes relative to the unknown's size (at least its nominal value): possible by rounding, and never by rounding.
_ROUNDING, _CERTAIN = 1e-13, 1e-9

_HIDDEN, _FALSE = ", which it does not declare", ", which it declares"


def declared_pairs(description: Description, section: str) -> dict[str, set[str]]:
    """Return the names of the declared dependencies of each unknown that declares any."""
    found: dict[str, set[str]] = {}
    for unknown in description.in_section(section):
        variable = description.variable(unknown.index)
        if variable is not None and unknown.dependencies is not None:
            known = (description.variable(index) for index in unknown.dependencies)
            found[variable.name] = {v.name for v in known if v is not None}
    return found


class Pairs:
    """Pairs of unknown and known: declared pairs, and pairs observed when the known was changed.

    `tried` are the names of the knowns that are changed; further ones may be added.
    """

    def __init__(self, declared: Mapping[str, set[str]], tried: set[str]) -> None:
        self._declared, self.tried = declared, tried
        self._seen: set[tuple[str, str]] = set()
        self._certain: set[tuple[str, str]] = set()

    def record(self, unknown: Variable, known: Variable, values: tuple[float, float]) -> None:
        """Record the two values of an unknown for two values of a known."""
        first, second = values
        change, size = abs(second - first), max(abs(first), abs(second), unknown.number("nominal") or 1.0)
        if change > _ROUNDING * size:
            self._seen.add((unknown.name, known.name))
        if change > _CERTAIN * size:
            self._certain.add((unknown.name, known.name))

    def declares(self, unknown: Variable, known: Variable) -> bool:
        """Return whether a dependency is declared."""
        return known.name in self._declared.get(unknown.name, {known.name})

    def _unseen(self) -> list[tuple[str, str]]:
        return [
            (unknown, known)
            for unknown, names in self._declared.items()
            for known in sorted(names & self.tried)
            if (unknown, known) not in self._seen
        ]

    def unseen_knowns(self) -> set[str]:
        """Return the knowns of all declared pairs that were not observed."""
        return {known for _, known in self._unseen()}

    def faults(self, where: str, *, velocities: str = "dependency-false") -> Faults:
        """Compare both; `velocities` is the rule for declared dependencies of velocities that were never observed."""
        hidden = [(u, known) for u, known in sorted(self._certain) if known not in self._declared.get(u, {known})]
        for unknown, knowns in groupby(hidden, key=itemgetter(0)):
            yield "dependency-hidden", some((k for _, k in knowns), f"{where} {unknown} depends on ", _HIDDEN)
        for unknown, knowns in groupby(self._unseen(), key=itemgetter(0)):
            rule = velocities if unknown.rpartition(".")[2] == "velocity" else "dependency-false"
            yield rule, some((k for _, k in knowns), f"{where} {unknown} never depended on ", _FALSE)


# ---- Points of a run to which an instance can return ----------------------------------------------------------------

_MOST_POINTS = 10


@dataclass(frozen=True)
class Place:
    """A point of a run: the inputs up to it, its time [s], an instance, and a function that returns it to the point."""

    bench: Bench
    inputs: Values
    time: float
    instance: Instance
    back: Callable[[], object]

    def after(self, inputs: Values, h: float) -> Values:
        """Return the outputs after a step of h [s] from this point with these inputs."""
        self.back()
        self.bench.drive(self.instance, inputs)
        self.instance.advance(self.time, h)
        return self.instance.reals(self.bench.outputs)


@contextmanager
def place(bench: Bench, seed: int, scale: float, *, moves: bool) -> Iterator[Place]:
    """Provide a point of a run: inputs `scale` amplitudes from their start values, changed parameters if `moves`.

    Raises:
        CallError: A call was rejected on the way.
    """
    time = bench.timing.at(_points(bench))
    with bench.instance() as instance:
        inputs = _go(bench, instance, seed, scale, moves)
        if bench.description.can("canGetAndSetFMUstate"):
            state = instance.state()
            yield Place(bench, inputs, time, instance, lambda: instance.need("SetFMUstate", state))
            return

        def again() -> None:
            instance.need("Reset")
            _go(bench, instance, seed, scale, moves)

        yield Place(bench, inputs, time, instance, again)


def _points(bench: Bench) -> int:
    return min(_MOST_POINTS, bench.timing.count)


def _go(bench: Bench, instance: Instance, seed: int, scale: float, moves: bool) -> Values:
    draw = random.Random(seed)
    bench.enter(instance)
    if moves:
        set_other_parameters(bench, instance, draw)
    instance.need("ExitInitializationMode")
    inputs = [_input(variable, draw, scale) for variable in bench.inputs]
    bench.run(instance, lambda _: inputs, range(_points(bench)))
    return inputs


def _input(variable: Variable, draw: random.Random, scale: float) -> float:
    start = variable.number("start") or 0.0
    return inside(variable, start + scale * (other_value(variable, draw) - start))


# ---- Dependencies at initialization ---------------------------------------------------------------------------------

#: Distance of inputs from their start values, in amplitudes, for each point.
_SCALES = (1.0, 1.0, 3.0, 3.0, 10.0, 10.0, 10.0, 10.0)
_SWEEP, _MOST, _DECADES = 400, 20_000, 4

#: Least change of a parameter over a sweep, that of one with start value 0: a thousandth of a parameter that is almost
#: 0 (a slope of 1e-6 N.s/m) has an effect below rounding.
_LEAST_CHANGE = 1e-4


def probe_initial_dependencies(bench: Bench) -> Results:
    """Perturb each known at several points; if no effect is observed, also over a sweep of each input."""
    declared = declared_pairs(bench.description, "InitialUnknowns")
    unknowns = [v for v in _unknowns(bench) if v.name in declared]
    knowns = [v for v in bench.description.variables if v.type in ("Real", "Boolean") and v.is_settable_at_start]
    if not unknowns or not knowns:
        yield Skip("no dependencies are declared" if not declared else "there is nothing to perturb")
        return
    pairs = Pairs(declared, set())
    draw = random.Random(2)
    for scale in _SCALES:
        with bench.initializing() as instance:
            _set_all(bench, instance, draw, scale)
            for known in knowns:
                _perturb_start(instance, unknowns, known, pairs, change_of(known))
    _sweep(bench, unknowns, pairs)
    yield from pairs.faults("in initialization mode")


def _unknowns(bench: Bench) -> list[Variable]:
    found = (bench.description.variable(u.index) for u in bench.description.in_section("InitialUnknowns"))
    return [v for v in found if v is not None and v.type == "Real" and v.is_callable]


def _set_all(bench: Bench, instance: Instance, draw: random.Random, scale: float) -> None:
    """Set values other than the start values; variables whose value is rejected keep their value."""
    for variable in bench.description.of("parameter", "Boolean"):
        instance.set(variable, draw.random() < 0.5)
    set_other_parameters(bench, instance, draw)
    for variable in bench.inputs:
        instance.set(variable, _input(variable, draw, scale))


def _perturb_start(
    instance: Instance, unknowns: Sequence[Variable], known: Variable, pairs: Pairs, change: float
) -> None:
    """Change one known by `change` and restore it; record the unknowns that changed, if they were restored too.

    A known whose every change contradicts other parameters says nothing about its dependencies.
    """
    status, value = instance.get(known)
    failed, before = instance.get_reals(unknowns)
    if refused(status) or refused(failed) or refused(instance.set(known, _changed(known, value, change))):
        return
    failed, during = instance.get_reals(unknowns)
    if refused(instance.set(known, value)) or refused(failed):
        return
    failed, after = instance.get_reals(unknowns)
    if refused(failed) or after != before:
        return
    pairs.tried.add(known.name)
    for unknown, old, new in zip(unknowns, before, during, strict=True):
        pairs.record(unknown, known, (old, new))


def _changed(known: Variable, value: Value, change: float) -> Value:
    if known.type == "Boolean":
        return not value
    moved = inside(known, float(value) + change)
    return moved if moved != value else inside(known, float(value) - change)


def _sweep(bench: Bench, unknowns: Sequence[Variable], pairs: Pairs) -> None:
    """Sweep each input: some parameters only have an effect in a narrow range of an input, often near its start."""
    for variable in bench.inputs:
        names = pairs.unseen_knowns()
        knowns = [v for v in bench.description.variables if v.name in names]
        if not knowns:
            return
        with bench.initializing() as instance:
            _set_all(bench, instance, random.Random(3), 1.0)
            count = min(_SWEEP, _MOST // (len(knowns) * len(bench.inputs)))
            for value in _spread(variable, count):
                if not refused(instance.set(variable, inside(variable, value))):
                    for known in knowns:
                        _perturb_start(instance, unknowns, known, pairs, max(change_of(known), _LEAST_CHANGE))


def _spread(variable: Variable, count: int) -> Iterator[float]:
    """Yield values on both sides of the start value, up to ten amplitudes, with geometric spacing."""
    start, farthest, half = variable.number("start") or 0.0, 10.0 * amplitude(variable), max(count // 2, 2)
    yield start
    for k in range(half):
        distance = farthest * 10.0 ** (-_DECADES * k / (half - 1))
        yield from (start - distance, start + distance)


# ---- Feedthrough over a tiny step -----------------------------------------------------------------------------------

_LONG, _SHORT = 1e-6, 1e-7  # s
_FIXED = "it only supports a fixed step size"

#: Minimum share of the change over the short step that must remain at step size zero to count as feedthrough.
_SHARE = 0.05

#: Maximum share of a direct change by which it differs in the first of doubled steps in which it does.
_TRACE = 1e-6

#: Distance of inputs from their start values, in amplitudes, and whether parameters differ from their start values.
_POINTS = ((1.0, False), (1.0, True), (3.0, True), (10.0, True), (10.0, True))


def probe_dependencies(bench: Bench) -> Results:
    """Perturb each input over two tiny steps."""
    declared = declared_pairs(bench.description, "Outputs")
    if reason := _reason_to_skip(bench, declared):
        yield Skip(reason)
        return
    pairs = Pairs(declared, {v.name for v in bench.inputs})
    refusals = []
    for seed, (scale, moves) in enumerate(_POINTS):
        try:
            with place(bench, seed, scale, moves=moves) as there:
                _perturb(bench, there, pairs)
        except CallError as error:
            refusals.append(str(error))
    if len(refusals) == len(_POINTS):
        yield Skip(f"steps of {_SHORT:g} s fail: {refusals[0]}")
        return
    yield from pairs.faults("over a step", velocities="dependency-velocity")


def _reason_to_skip(bench: Bench, declared: dict[str, set[str]]) -> str:
    if not bench.inputs or not bench.outputs:
        return "there are no Real inputs, or no Real outputs"
    if not declared:
        return "no dependencies are declared"
    return "" if bench.description.can("canHandleVariableCommunicationStepSize") else _FIXED


def _perturb(bench: Bench, there: Place, pairs: Pairs) -> None:
    plain = {h: there.after(there.inputs, h) for h in (_LONG, _SHORT)}
    if there.after(there.inputs, _SHORT) != plain[_SHORT]:
        raise CallError("repeating the same step gives different outputs")
    for position, known in enumerate(bench.inputs):
        for value in _others(known, there.inputs[position]):
            moved = [*there.inputs[:position], value, *there.inputs[position + 1 :]]
            after = {h: there.after(moved, h) for h in (_LONG, _SHORT)}
            for k, unknown in enumerate(bench.outputs):
                long, short = (after[h][k] - plain[h][k] for h in (_LONG, _SHORT))
                direct = _direct(long, short)
                if direct and long == short and not _begins_at_once(there, moved, k, short):
                    continue  # the change is due to an internal step of the FMU that is longer than both steps
                if direct and not pairs.declares(unknown, known) and not _is_confirmed(there, moved, k, short, direct):
                    continue  # the change begins with powers of the step size that two steps cannot separate
                if direct:
                    pairs.record(unknown, known, (plain[_SHORT][k], plain[_SHORT][k] + direct))


def _others(known: Variable, value: float) -> set[float]:
    """Return values to try: farther from, closer to, and on the other side of the start value."""
    size, start = amplitude(known), known.number("start") or 0.0
    tries = (value + size, value - size, 2 * start - value)
    return {inside(known, other) for other in tries} - {value}


def _direct(long: float, short: float) -> float:
    """Return the change extrapolated linearly to step size zero; 0 if the change comes through the states."""
    direct = (_LONG * short - _SHORT * long) / (_LONG - _SHORT)
    return direct if _SHARE * abs(short) < abs(direct) < 2.0 * abs(short) else 0.0


def _is_confirmed(there: Place, moved: Values, output: int, short: float, direct: float) -> bool:
    """Return whether about the same change remains at step size zero by a third step, ten times shorter.

    What two powers of the step size leave there falls with the square of the steps that it is extrapolated from.
    """
    try:
        shorter = there.after(moved, _SHORT / 10.0)[output] - there.after(there.inputs, _SHORT / 10.0)[output]
    except CallError:  # such a step is refused
        return True
    return abs(_direct(short, shorter)) > 0.5 * abs(direct)


def _begins_at_once(there: Place, moved: Values, output: int, change: float) -> bool:
    """Return whether a change that two tiny steps show alike is there from the beginning of a step.

    Steps are doubled until the change differs. A change that states add to grows from rounding, so that it first
    differs by a trace. If the FMU makes internal steps, it first differs by what a whole internal step adds.
    """
    longest = 4.0 * there.bench.timing.step
    for doubling in range(max(0, ceil(log2(longest / _LONG)) - 1), -1, -1):
        h = longest / 2.0**doubling
        later = there.after(moved, h)[output] - there.after(there.inputs, h)[output]
        if later != change:
            return abs(later - change) <= _TRACE * abs(change)
    return True


# ==== Probe of directional derivatives, compared with central differences, and of input and output derivatives =======

_DERIVATIVE_POINTS = 3
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


def _in_initialization(bench: Bench) -> Iterator[Fault]:
    wrong: dict[str, str] = {}
    for seed in range(_DERIVATIVE_POINTS):
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

    fault = _judge(stated, at, unknown, known, 1.0)
    instance.set(known, value)
    return fault


def _judge(stated: float, at: Callable[[float], float | None], unknown: Variable, known: Variable, wider: float) -> str:
    """Return the error of a derivative as text; the known is changed by its usual change times `wider`."""
    change = wider * change_of(known)
    ends = [at(shift * change) for shift in (-1.0, -0.5, 0.5, 1.0)]
    values = [end for end in ends if end is not None]
    size = max(*map(abs, values), unknown.number("nominal") or 1.0) if len(values) == len(ends) else 0.0
    noise = 1e-14 * size, _NOTHING * size / (1e3 * change_of(known))
    return judged(stated, values, change, *noise) if size else ""


def judged(stated: float, ends: Sequence[float], change: float, rounding: float, least: float) -> str:
    """Return the error of a derivative as text; "" if it is correct or if the function is not smooth there.

    The function counts as smooth if two central differences agree.

    Args:
        stated: Stated derivative.
        ends: Values of the unknown after changes of the known by -1, -0.5, 0.5 and 1 times `change`.
        change: Change of the known.
        rounding: Rounding error of an end.
        least: Error of the derivative that has no effect.
    """
    a, b, c, d = ends
    wide, narrow = (d - a) / (2.0 * change), (c - b) / change
    if abs(wide - narrow) > _SMOOTH * abs(narrow) + rounding / change:
        return ""
    is_right = abs(stated - narrow) <= _WRONG * abs(narrow) + 10.0 * rounding / change + least
    return "" if is_right else f"{stated:.6g} instead of {narrow:.6g}"


def _over_steps(bench: Bench) -> Results:
    if not bench.description.can("canGetAndSetFMUstate"):
        yield Skip("it needs FMU states", "directional derivatives over steps")
        return
    if not bench.description.can("canHandleVariableCommunicationStepSize"):
        yield Skip(_FIXED, "directional derivatives over steps")
        return
    wrong: dict[str, str] = {}
    for seed in range(_DERIVATIVE_POINTS):
        with place(bench, seed, 1.0, moves=False) as there:
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
    return "rejected" if refused(status) else _judge(stated, at, unknown, known, 10.0)


def _findings(where: str, wrong: dict[str, str]) -> Iterator[Fault]:
    shown = (f"{pair} is {fault}" for pair, fault in wrong.items())
    yield "directional-derivative", some(shown, f"{where} ", most=3)


def _input_derivatives(bench: Bench) -> Iterator[Fault]:
    h, t = bench.timing.step, bench.timing.start
    moving = bench.description.interpolated_inputs
    ends = []
    for size in (0.0, 1.0):
        with bench.running() as instance:
            bench.drive(instance, bench.held(t))
            status = instance.set_derivatives(moving, [size * amplitude(v) / h for v in moving])
            if refused(status):
                yield "input-derivatives", f"fmi2SetRealInputDerivatives rejects order 1{instance.last_message()}"
                return
            instance.advance(t, h)
            ends.append(instance.reals(bench.outputs))
    if bench.outputs and ends[0] == ends[1]:
        yield "interpolates", "a step with derivatives of all inputs gives the same outputs as a step without"


def _output_derivatives(bench: Bench) -> Iterator[Fault]:
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
        yield "output-derivatives", f"fmi2GetRealOutputDerivatives of order {order} {what}"
        return
