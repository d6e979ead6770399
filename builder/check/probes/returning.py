"""Return to the same point of a run repeatedly: by FMU state if the FMU supports it, otherwise by a new run."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from builder.check.description import Variable
from builder.check.probes.bench import Bench, Values, inside, step
from builder.check.probes.instance import Instance
from builder.check.probes.pairs import other_value

_POINTS = 10


@dataclass(frozen=True)
class Route:
    """The run to a point: inputs `scale` amplitudes from their start values, changed parameters if `moves`."""

    seed: int
    scale: float
    moves: bool


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
        step(self.instance, self.time, h)
        return self.instance.reals(self.bench.outputs)


@contextmanager
def place(bench: Bench, route: Route) -> Iterator[Place]:
    """Provide the point to which a route leads.

    Raises:
        CallError: A call was rejected on the way.
    """
    time = bench.timing.at(_points(bench))
    with bench.instance() as instance:
        inputs = _go(bench, instance, route)
        if bench.description.can("canGetAndSetFMUstate"):
            state = instance.state()
            yield Place(bench, inputs, time, instance, lambda: instance.need("SetFMUstate", state))
            return

        def again() -> None:
            instance.need("Reset")
            _go(bench, instance, route)

        yield Place(bench, inputs, time, instance, again)


def _points(bench: Bench) -> int:
    return min(_POINTS, bench.timing.count)


def _go(bench: Bench, instance: Instance, route: Route) -> Values:
    draw = random.Random(route.seed)
    bench.enter(instance)
    if route.moves:
        for variable in bench.description.of("parameter"):
            instance.set(variable, other_value(variable, draw))
    instance.need("ExitInitializationMode")
    inputs = [_input(variable, draw, route.scale) for variable in bench.inputs]
    bench.run(instance, lambda _: inputs, range(_points(bench)))
    return inputs


def _input(variable: Variable, draw: random.Random, scale: float) -> float:
    start = variable.number("start") or 0.0
    return inside(variable, start + scale * (other_value(variable, draw) - start))
