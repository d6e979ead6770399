"""Probe of model exchange, and an integrator's side of it."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from ctypes import c_double, c_int
from dataclasses import replace

from builder.check.probes.bench import (
    Bench,
    CallError,
    Instance,
    Results,
    Skip,
    Values,
    amplitude,
    differ,
    refused,
    wrong_times,
)
from builder.check.probes.dependencies import declared_pairs, judged
from builder.check.probes.library import MODEL_EXCHANGE, EventInfo, MissingFunctionError, binary_path, library_of
from builder.check.rules import Fault, listed, some
from eightpost.fmi import Variable, whole_number

_MOST_ITERATIONS = 100


class _EndedError(Exception):
    """The FMU ends the simulation at once, so that there is nothing to check."""


class _Host:
    """Instances for model exchange, and what the description says about them."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        pairs = [p for p in bench.description.state_pairs() if all(map(_is_state, p))]
        lengths = bench.description.lengths
        #: One variable for each element of the arrays of states and derivatives.
        self.derivatives = [derivative for derivative, _ in pairs for _ in range(lengths.get(derivative.name, 1))]
        self.states = [state for derivative, state in pairs for _ in range(lengths.get(derivative.name, 1))]
        self.count = len(self.states)
        self.has_all_sizes = all(lengths.get(derivative.name, 1) for derivative, _ in pairs)
        self.indicators = whole_number(bench.description.event_indicators) or 0
        self.inputs = [v for v in bench.inputs if v.variability == "continuous"]
        self.knowns, self.unknowns = [*self.inputs, *self.states], [*self.derivatives, *bench.outputs]

    def vector(self, instance: Instance, name: str, count: int | None = None) -> Values:
        """Return the array that a function fills; nothing is called for an empty one."""
        size = self.count if count is None else count
        buffer = (c_double * size)(*[math.nan] * size)  # what the FMU does not set is not finite
        if size:
            instance.need(name, buffer, size)
        return list(buffer)

    def set_states(self, instance: Instance, values: Sequence[float]) -> None:
        """Set the continuous states."""
        if self.count:
            instance.need("SetContinuousStates", (c_double * self.count)(*values), self.count)

    def instance(self) -> AbstractContextManager[Instance]:
        """Provide an instance after fmi2Instantiate."""
        return self.bench.instance(replace(self.bench.birth, kind=MODEL_EXCHANGE))

    @contextmanager
    def continuous(self) -> Iterator[tuple[Instance, Values]]:
        """Provide an instance in continuous-time mode, and its states at the start.

        Raises:
            _EndedError: The FMU ends the simulation at once.
        """
        with self.instance() as created:
            self.bench.initialize(created)
            if _iterate_events(created).terminateSimulation:
                raise _EndedError
            created.need("EnterContinuousTimeMode")
            yield created, self.states_of(created)

    def states_of(self, instance: Instance) -> Values:
        """Return the continuous states."""
        return self.vector(instance, "GetContinuousStates")

    def point(self, start: Values, k: int) -> tuple[Values, Values]:
        """Return inputs and states near the start, different ones for each k."""
        inputs = [(v.number("start") or 0.0) + 0.3 * amplitude(v) * math.sin(1.0 + i + 2.0 * k)
                  for i, v in enumerate(self.inputs)]  # fmt: skip
        states = [x + 0.1 * size * math.sin(2.0 + i + 3.0 * k) for i, (x, size) in enumerate(self.sizes(start))]
        return inputs, states

    def sizes(self, start: Values) -> list[tuple[float, float]]:
        """Return each state's value at the start and its size: the nominal value."""
        return [(x, abs(state.number("nominal") or 1.0)) for x, state in zip(start, self.states, strict=True)]

    def go(self, instance: Instance, inputs: Values, states: Values) -> Values:
        """Set inputs and states; return the derivatives, then the outputs.

        Raises:
            CallError: A call was rejected.
        """
        if refused(instance.set_reals(self.inputs, inputs)):
            raise CallError(f"fmi2SetReal of inputs is rejected in continuous-time mode{instance.last_message()}")
        self.set_states(instance, states)
        return self.results(instance)

    def results(self, instance: Instance) -> Values:
        """Return the derivatives, then the outputs."""
        return [*self.vector(instance, "GetDerivatives"), *instance.reals(self.bench.outputs)]


def _is_state(variable: Variable) -> bool:
    return variable.type == "Real" and (variable.is_callable or variable.is_array)


def _iterate_events(instance: Instance) -> EventInfo:
    """Do an event iteration; return what the FMU asks for at its end, or when it ends the simulation."""
    for _ in range(_MOST_ITERATIONS):
        info = EventInfo()
        instance.need("NewDiscreteStates", ctypes.byref(info))
        if info.terminateSimulation or not info.newDiscreteStatesNeeded:
            return info
    raise CallError(f"fmi2NewDiscreteStates still needs new discrete states after {_MOST_ITERATIONS} iterations")


# ==== Probe of model exchange: modes, states, derivatives, dependencies, directional derivatives, FMU states =========

_STEPS, _H = 4, 1e-6  # of Euler's method [s]
#: Results of both kinds agree if they differ by less than this share of an output's range, and the result of model
#: exchange is known if half the step changes it by less than a tenth of that.
_AGREEMENT = 0.02
_POINTS, _PARTS = 20, 8
#: A larger difference is the error of the FMU's own solver if this many steps in place of one halve it.
_FINER = 4


def probe_model_exchange(bench: Bench) -> Results:
    """Instantiate for model exchange, integrate, and check what an integrator relies on."""
    declared = bench.description.model_exchange
    if declared is None:
        yield Skip("it does not support model exchange")
        return
    name = declared.get("modelIdentifier", "")
    if name != bench.description.identifier:
        path = binary_path(bench.folder, name, bench.description.fmi)
        if path is None:
            yield Skip("its model exchange has no binary for this platform")
            return
        bench.library = library_of(bench.description, path, bench.library.progress)
    host = _Host(bench)
    if not host.has_all_sizes:
        yield Skip("the sizes of its arrays of states are not known")
        return
    try:
        for check in (_integrated, _modes, _arrays, _repeated, _dependencies, _directional, _restored):
            with suppress(_EndedError):
                yield from check(host)
    except (CallError, MissingFunctionError) as error:
        yield "model-exchange", f"instantiated for model exchange, {error}"
        return
    if bench.description.co_simulation is not None and name == bench.description.identifier:
        yield from _agreement(host)


#: Derivatives at a time and states, and a method: the states after a step from a time.
_Rates = Callable[[float, Values], Values]
_Method = Callable[[_Rates, float, float, Values], Values]


def _integrated(host: _Host) -> Iterator[Fault]:
    """Do a few tiny steps of Euler's method."""
    with host.continuous() as (instance, states):
        nominals = host.vector(instance, "GetNominalsOfContinuousStates")
        if not all(math.isfinite(value) and value > 0.0 for value in nominals):
            yield "nominals-agree", f"not positive: {nominals[:6]}"
        stated = [(s.name, own, s.number("nominal")) for s, own in zip(host.states, nominals, strict=True)]
        wrong = (name for name, own, text in stated if text is not None and not math.isclose(own, text, rel_tol=1e-6))
        yield "nominals-agree", some(wrong, "different from the description for ")
        now = yield from _small_steps(host, instance, states)
        if now is None:
            return
        instance.need("EnterEventMode")
        info = _iterate_events(instance)
        if info.nextEventTimeDefined and not info.nextEventTime >= now:
            yield "event-requests", f"at {now!r} s, the next event is at {info.nextEventTime!r} s"
        tunable = (v for v in host.bench.description.of("parameter") if v.variability == "tunable")
        locked = (v.name for v in tunable if refused(instance.set(v, v.number("start") or 0.0)))
        yield "exchange-inputs", some(locked, "rejected in event mode: ")
        before = host.states_of(instance)
        instance.need("EnterContinuousTimeMode")
        if host.states_of(instance) != before:
            yield "states-set", "the values change when continuous-time mode is entered"
        instance.need("Terminate")


def _small_steps(host: _Host, instance: Instance, states: Values) -> Generator[Fault, None, float | None]:
    """Do the steps, with an event wherever the FMU asks for one; return the time [s], or None after a finding."""
    requests, now = 0, host.bench.timing.start
    for point in range(1, _STEPS + 1):
        slopes = host.vector(instance, "GetDerivatives")
        if not all(map(math.isfinite, slopes)):
            yield "derivatives-finite", f"at the start: {slopes[:6]}"
            return None
        now = host.bench.timing.start + point * _H
        instance.need("SetTime", now)
        yield from wrong_times(host.bench, instance, now)
        states = [x + _H * slope for x, slope in zip(states, slopes, strict=True)]
        host.set_states(instance, states)
        wants_event, ends = _completed(instance)
        if not all(map(math.isfinite, host.vector(instance, "GetEventIndicators", host.indicators))):
            yield "derivatives-finite", "an event indicator is not finite near the start"
            return None
        if ends:
            yield "event-requests", f"the simulation is ended {point * _H:g} s after its start"
            return None
        if wants_event:
            requests += 1
            instance.need("EnterEventMode")
            _iterate_events(instance)
            instance.need("EnterContinuousTimeMode")
            states = host.states_of(instance)
    if requests == _STEPS:
        yield "event-requests", f"after each of {_STEPS} steps of {_H:g} s"
        return None
    return now


def _completed(instance: Instance) -> tuple[bool, bool]:
    enter, end = c_int(), c_int()
    instance.need("CompletedIntegratorStep", 1, ctypes.byref(enter), ctypes.byref(end))
    return bool(enter.value), bool(end.value)


def _modes(host: _Host) -> Iterator[Fault]:
    """Call functions in modes in which they are not allowed."""
    zeros = (c_double * max(host.count, 1))(*[0.0] * max(host.count, 1))
    states = [("SetContinuousStates", (zeros, host.count))] if host.count else []
    step_call = [("DoStep", (host.bench.timing.start, host.bench.timing.step, 1))]
    accepted = []
    with host.instance() as instance:
        for name, arguments in (("EnterContinuousTimeMode", ()), ("SetTime", (0.0,)), *states):
            if not refused(instance.call(name, *arguments)):
                accepted.append(f"fmi2{name} before initialization")
    with host.instance() as instance:
        host.bench.initialize(instance)
        for name, arguments in (*states, *step_call):
            with suppress(MissingFunctionError):
                if not refused(instance.call(name, *arguments)):
                    accepted.append(f"fmi2{name} in event mode")
    yield "exchange-order", some(accepted, "accepted: ")


def _arrays(host: _Host) -> Iterator[Fault]:
    """Set states, and read states and derivatives as arrays and as variables."""
    with host.continuous() as (instance, start):
        for k in range(2 if host.count else 0):
            inputs, states = host.point(start, k)
            slopes = host.go(instance, inputs, states)[: host.count]
            if not all(map(math.isfinite, slopes)):
                yield "derivatives-finite", f"near the start: {slopes[:6]}"
                return
            if host.states_of(instance) != states:
                yield "states-set", "the values differ from those that were set"
                return
            for what, variables, values in (("states", host.states, states), ("derivatives", host.derivatives, slopes)):
                scalars = [(v, value) for v, value in zip(variables, values, strict=True) if not v.is_array]
                read = instance.reals([v for v, _ in scalars])
                wrong = [v.name for (v, a), b in zip(scalars, read, strict=True)
                         if not math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-300)]  # fmt: skip
                if wrong:
                    yield "states-variables", f"{what} differ: {listed(wrong)}"
                    return


def _repeated(host: _Host) -> Iterator[Fault]:
    """Evaluate two points in turns, and change the inputs alone."""
    with host.continuous() as (instance, start):
        first, second = (host.point(start, k) for k in (0, 1))
        rows = [host.go(instance, *point) for point in (first, second, first, first)]
        if not all(math.isfinite(value) for row in rows for value in row):
            yield "derivatives-finite", "near the start, derivatives or outputs are not finite"
        elif not rows[0] == rows[2] == rows[3]:
            yield "derivatives-repeatable", "the same inputs and states gave other derivatives or outputs after others"
        elif host.inputs:
            host.go(instance, *second)
            expected = host.go(instance, second[0], first[1])
            for point in (second, first):
                host.go(instance, *point)
            instance.set_reals(host.inputs, second[0])
            if host.results(instance) != expected:
                yield "derivatives-repeatable", "a change of inputs alone is ignored or used late"


def _evaluations(host: _Host, instance: Instance, base: tuple[Values, Values]) -> Callable[[int, float], Values]:
    """Return a function of a known's index and a change of it: derivatives, then outputs."""
    count = len(host.inputs)

    def at(known: int, change: float) -> Values:
        values = [*base[0], *base[1]]
        values[known] += change
        return host.go(instance, values[:count], values[count:])

    return at


def _changes(host: _Host, start: Values) -> Values:
    return [1e-3 * amplitude(v) for v in host.inputs] + [1e-3 * max(size, abs(x)) for x, size in host.sizes(start)]


def _declared(host: _Host) -> dict[str, set[str]]:
    description = host.bench.description
    return declared_pairs(description, "Outputs") | declared_pairs(description, "Derivatives")


def _dependencies(host: _Host) -> Iterator[Fault]:
    """Change every input and state; whatever follows must be declared."""
    declared, hidden = _declared(host), set()
    with host.continuous() as (instance, start):
        for point in range(2):
            at = _evaluations(host, instance, host.point(start, point))
            for k, change in enumerate(_changes(host, start)):
                before, after = at(k, 0.0), at(k, 30.0 * change)
                for unknown, a, b in zip(host.unknowns, before, after, strict=True):
                    names = declared.get(unknown.name)
                    is_moved = abs(b - a) > 1e-9 * max(abs(a), abs(b), abs(unknown.number("nominal") or 1e-3))
                    # An output that is a state depends on itself, which the description need not state.
                    if is_moved and names is not None and not _aliases(host, host.knowns[k]) & {unknown.name, *names}:
                        hidden.add(f"{unknown.name} depends on {host.knowns[k].name}")
    yield "derivative-hidden", some(sorted(hidden))


def _aliases(host: _Host, variable: Variable) -> set[str]:
    alike = host.bench.description.variables
    return {v.name for v in alike if (v.type, v.reference) == (variable.type, variable.reference)}


def _directional(host: _Host) -> Results:
    """Compare directional derivatives with central differences where the functions are smooth."""
    if not host.bench.description.can_exchange("providesDirectionalDerivative"):
        yield Skip("providesDirectionalDerivative of ModelExchange is not true", "directional derivatives by states")
        return
    wrong: dict[str, str] = {}
    with host.continuous() as (instance, start):
        for point in range(2):
            base = host.point(start, point)
            at = _evaluations(host, instance, base)
            for k, (known, change) in enumerate(zip(host.knowns, _changes(host, start), strict=True)):
                rows = [at(k, share * change) for share in (-1.0, -0.5, 0.5, 1.0)]
                host.go(instance, *base)
                for i, unknown in enumerate(host.unknowns):
                    if unknown.is_array or known.is_array or unknown.name in _aliases(host, known):
                        continue
                    status, stated = instance.directional(unknown, known)
                    ends = [row[i] for row in rows]
                    fault = judged(stated, ends, change, 1e-12 * max(map(abs, ends)), 0.0)
                    if fault := "rejected" if refused(status) else fault:
                        wrong.setdefault(f"{unknown.name} by {known.name}", fault)
        wrong |= _sums(host, instance)
    if wrong:
        yield "exchange-directional", listed([f"{pair} is {fault}" for pair, fault in wrong.items()], most=3)


def _sums(host: _Host, instance: Instance) -> dict[str, str]:
    """Compare the derivative of each unknown by all knowns at once with the sum of those by one."""
    wrong = {}
    for unknown in host.unknowns:
        others = [known for known in host.knowns if not known.is_array and unknown.name not in _aliases(host, known)]
        single = [instance.directional(unknown, known) for known in others]
        if unknown.is_array or len(others) < 2 or any(refused(status) for status, _ in single):
            continue
        status, total = instance.directional(unknown, *others)
        expected, size = sum(value for _, value in single), sum(abs(value) for _, value in single)
        if refused(status) or not abs(total - expected) <= 1e-9 * size:
            fault = "rejected" if refused(status) else f"{total!r}, not {expected!r}"
            wrong[f"{unknown.name} by {len(others)} variables at once"] = fault
    return wrong


def _restored(host: _Host) -> Results:
    """Save an FMU state in continuous-time mode, move on, and restore it."""
    if not host.bench.description.can_exchange("canGetAndSetFMUstate"):
        yield Skip("canGetAndSetFMUstate of ModelExchange is not true", "FMU states in model exchange")
        return
    with host.continuous() as (instance, start):
        before = host.go(instance, *host.point(start, 0))
        states = host.states_of(instance)
        state = instance.state()
        host.go(instance, *host.point(start, 1))
        instance.need("SetFMUstate", state)
        if host.results(instance) != before or host.states_of(instance) != states:
            yield "exchange-state", "after fmi2SetFMUstate states, derivatives or outputs differ"
        instance.call("FreeFMUstate", ctypes.byref(state))


# ---- The same results as co-simulation ------------------------------------------------------------------------------


def _agreement(host: _Host) -> Results:
    """Integrate a few communication steps with held inputs, and compare the outputs with those of co-simulation.

    Outputs that declare no dependency describe the run, not the model, and are left out.
    """
    bench = host.bench
    points = range(min(bench.timing.count, _POINTS))
    if not bench.outputs:
        return
    try:
        rough, fine = (_marched(host, points, parts, _stage) for parts in (_PARTS, 2 * _PARTS))
        if rough is None or fine is None or differ(fine, rough) > 0.1 * _AGREEMENT:
            yield Skip("events, or a step of a few hundred microseconds is too long", "model exchange by co-simulation")
            return
        plain = _stepped(bench, points, 1)
        worst = finer = _difference(host, fine, plain)
        if worst <= _AGREEMENT:
            return
        if bench.description.can("canHandleVariableCommunicationStepSize"):
            finer = _difference(host, fine, _stepped(bench, points, _FINER))
        first_order = _marched(host, points, 1, _euler)
        is_euler = first_order is not None and _difference(host, first_order, plain) < 0.1 * worst
    except CallError as error:
        yield Skip(str(error), "model exchange by co-simulation")
        return
    text = f"outputs differ by {100.0 * worst:.2g} % of their size in {len(points)} steps"
    if finer < 0.5 * worst:
        yield "exchange-accuracy", f"{text}, and by {100.0 * finer:.2g} % with {_FINER} steps in place of one"
    elif is_euler:
        yield "exchange-accuracy", f"{text}: its solver is Euler's with this step"
    else:
        yield "exchange-agrees", text


def _stepped(bench: Bench, points: range, parts: int) -> list[Values]:
    """Return the outputs of co-simulation at the communication points, with inputs held over each in several steps."""
    rows, h = [], bench.timing.step / parts
    with bench.running() as instance:
        for point in points:
            begin = bench.timing.at(point)
            bench.drive(instance, bench.excitation(begin))
            for part in range(parts):
                instance.advance(begin + part * h, h)
            rows.append(instance.reals(bench.outputs))
    return rows


def _difference(host: _Host, exchanged: list[Values], stepped: list[Values]) -> float:
    """Return the largest difference of the outputs that depend on something or are states, relative to their sizes."""
    declared, states = _declared(host), {state.reference for state in host.states}
    compared = [k for k, v in enumerate(host.bench.outputs) if declared.get(v.name) != set() or v.reference in states]
    return differ(*([[row[k] for k in compared] for row in rows] for rows in (exchanged, stepped)))


def _marched(host: _Host, points: range, parts: int, stage: _Method) -> list[Values] | None:
    """Return the outputs after each communication step in several steps of a method; None after an event."""
    bench, rows, h = host.bench, [], host.bench.timing.step / parts
    with suppress(_EndedError), host.continuous() as (instance, start):
        x = start

        def rates(time: float, states: Values) -> Values:
            instance.need("SetTime", time)
            host.set_states(instance, states)
            return host.vector(instance, "GetDerivatives")

        for point in points:
            begin = bench.timing.at(point)
            bench.drive(instance, bench.excitation(begin))
            for part in range(parts):
                x = stage(rates, begin + part * h, h, x)
            rates(begin + bench.timing.step, x)
            if any(_completed(instance)) or host.indicators:
                return None
            rows.append(instance.reals(bench.outputs))
        return rows
    return None


def _euler(rates: _Rates, time: float, h: float, x: Values) -> Values:
    return [a + h * b for a, b in zip(x, rates(time, x), strict=True)]


def _stage(rates: _Rates, time: float, h: float, x: Values) -> Values:
    def moved(slope: Values, share: float) -> Values:
        return [a + share * h * b for a, b in zip(x, slope, strict=True)]

    k1 = rates(time, x)
    k2 = rates(time + 0.5 * h, moved(k1, 0.5))
    k3 = rates(time + 0.5 * h, moved(k2, 0.5))
    k4 = rates(time + h, moved(k3, 1.0))
    return [a + h / 6.0 * (p + 2.0 * q + 2.0 * r + s) for a, p, q, r, s in zip(x, k1, k2, k3, k4, strict=True)]
