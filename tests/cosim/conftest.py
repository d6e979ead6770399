"""A component built from functions: coupling is tested without any FMU."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import pytest

from cosim import Capabilities, Variable
from cosim.conversion import named_unit
from eightpost.errors import StepError


@dataclass
class FunctionComponent:
    """A state advanced by `advance(state, start, end, step)` and read by `outputs(state, inputs)`.

    Inputs are dictionaries by name; `start` and `end` are equal where inputs are held.
    """

    variables: Mapping[str, Variable]
    outputs: Callable[[float, dict[str, float]], dict[str, float]]
    advance: Callable[[float, dict[str, float], dict[str, float], float], float] = lambda state, *_: state
    state: float = 0.0
    capabilities: Capabilities = field(default_factory=Capabilities)
    identity: str = "function"
    source: str = "test"
    messages: tuple[str, ...] = ()
    log: list[tuple] = field(default_factory=list)
    fails_at: float = float("inf")

    def begin(self, start, stop, parameters):
        self.inputs = {n: 0.0 for n, v in self.variables.items() if v.causality == "input"}
        self.slopes = dict.fromkeys(self.inputs, 0.0)
        self.parameters = dict(parameters)

    def end_initialization(self):
        self.log.append(("started",))

    def set(self, names: Sequence[str], values: Sequence[float]):
        self.inputs.update(zip(names, values, strict=True))
        self.slopes = dict.fromkeys(self.inputs, 0.0)

    def set_derivatives(self, names, values):
        self.slopes.update(zip(names, values, strict=True))

    def get(self, names):
        values = self.outputs(self.state, self.inputs)
        return [values[name] for name in names]

    def step(self, time, step):
        if time >= self.fails_at:
            raise StepError(f"component failed at {time}")
        start = dict(self.inputs)
        self.inputs = {n: v + self.slopes[n] * step for n, v in self.inputs.items()}
        self.state = self.advance(self.state, start, self.inputs, step)
        self.log.append((time, step, start, dict(self.inputs)))

    def finish(self):
        self.log.append(("finished",))


def variable(name, causality, unit="1", direct=()):
    return Variable(name, causality, unit=named_unit(unit) if unit else None, direct=frozenset(direct))


def table(*variables):
    return {v.name: v for v in variables}


@pytest.fixture
def make():
    """What tests build components from."""

    class Make:
        component = FunctionComponent
        variable = staticmethod(variable)
        table = staticmethod(table)

        @staticmethod
        def gain(factor=1.0, unit_in="N", unit_out="N", **options):
            """y = factor * u, with a direct term."""
            ports = table(variable("u", "input", unit_in), variable("y", "output", unit_out, ["u"]))
            return FunctionComponent(ports, lambda _, u: {"y": factor * u["u"]}, **options)

        @staticmethod
        def integrator(unit_in="N", unit_out="m/s", **options):
            """x' = u, y = x: no direct term."""
            ports = table(variable("u", "input", unit_in), variable("y", "output", unit_out))

            def advance(x, start, end, step):
                return x + 0.5 * (start["u"] + end["u"]) * step

            return FunctionComponent(ports, lambda x, _: {"y": x}, advance, **options)

    return Make
