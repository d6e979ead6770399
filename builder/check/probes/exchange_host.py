"""An integrator's side of model exchange: instances, their states and derivatives."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes import c_double
from dataclasses import replace

from builder.check.probes.bench import Bench, Values, amplitude
from builder.check.probes.instance import CallError, Instance, refused
from builder.check.probes.library import MODEL_EXCHANGE, EventInfo
from eightpost.fmi.description import Variable, whole_number

_MOST_ITERATIONS = 100


class Host:
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

    def vector(self, instance: Instance, name: str, count: int | None = None) -> Values:
        """Return the array that a function fills; nothing is called for an empty one."""
        size = self.count if count is None else count
        buffer = (c_double * size)()
        if size:
            instance.need(name, buffer, size)
        return list(buffer)

    def set_states(self, instance: Instance, values: Sequence[float]) -> None:
        """Set the continuous states."""
        if self.count:
            instance.need("SetContinuousStates", (c_double * self.count)(*values), self.count)

    @contextmanager
    def instance(self) -> Iterator[Instance]:
        """Provide an instance after fmi2Instantiate."""
        with self.bench.instance(replace(self.bench.birth, kind=MODEL_EXCHANGE)) as created:
            yield created

    @contextmanager
    def continuous(self) -> Iterator[Instance | None]:
        """Provide an instance in continuous-time mode; None if the FMU ends the simulation at once."""
        with self.instance() as created:
            self.bench.initialize(created)
            if iterate_events(created):
                yield None
                return
            created.need("EnterContinuousTimeMode")
            yield created

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
        return [*self.vector(instance, "GetDerivatives"), *instance.reals(self.bench.outputs)]


def _is_state(variable: Variable) -> bool:
    return variable.type == "Real" and (variable.is_callable or variable.is_array)


def iterate_events(instance: Instance) -> bool:
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
