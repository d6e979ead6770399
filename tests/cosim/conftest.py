"""Components built from functions, to test the coupling without any FMU, and systems of native FMUs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from cosim import Bond, Capabilities, FmuComponent, System, Variable
from cosim.components.component import named_unit
from eightpost.corners import CORNERS
from eightpost.errors import StepError
from eightpost.signals import Drivefile, TimeSeries

from .mass_and_damper import restorable_parts


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

    def __post_init__(self):
        self.first_state = self.state

    def begin(self, start, stop, parameters):
        self.state = self.first_state
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


@pytest.fixture(scope="session")
def make():
    """Builders of components and their variables."""

    class Make:
        component = FunctionComponent
        variable = staticmethod(variable)
        table = staticmethod(table)

        @staticmethod
        def gain(factor=1.0, unit_in="N", unit_out="N", **options):
            """y = factor * u, with feedthrough."""
            ports = table(variable("u", "input", unit_in), variable("y", "output", unit_out, ["u"]))
            return FunctionComponent(ports, lambda _, u: {"y": factor * u["u"]}, **options)

        @staticmethod
        def integrator(unit_in="N", unit_out="m/s", **options):
            """x' = u, y = x: no feedthrough."""
            ports = table(variable("u", "input", unit_in), variable("y", "output", unit_out))

            def advance(x, start, end, step):
                return x + 0.5 * (start["u"] + end["u"]) * step

            return FunctionComponent(ports, lambda x, _: {"y": x}, advance, **options)

    return Make


@pytest.fixture
def parts(make):
    """Builder of the mass and the damper of tests/cosim/mass_and_damper.py: parts(damping, law, speed)."""
    return restorable_parts(make)


@pytest.fixture(scope="session")
def track() -> Drivefile:
    """The demo's drive file: wheelloader positions and loads of the whole car, 500 points a second."""
    return Drivefile.read(Path(__file__).resolve().parents[2] / "examples" / "data" / "track.parquet")


@pytest.fixture(scope="session")
def bumps() -> Drivefile:
    """30 s of two roads for quarter cars, `a` and `b`, 250 points a second: sums of sines from 0.7 to 19 Hz."""
    time = 0.004 * np.arange(7501)
    rows = {
        name: sum(amplitude * np.sin(2.0 * np.pi * rate * time) for amplitude, rate in parts)
        for name, parts in {"a": ((0.02, 0.7), (0.004, 6.1), (0.0007, 19.0)), "b": ((0.015, 1.3), (0.003, 9.7))}.items()
    }
    return Drivefile(TimeSeries.from_channels(time, {name: ("m", row) for name, row in rows.items()}))


@pytest.fixture
def seven_dof(fmus):
    """Builder of a seven-DOF car with its shocks: seven_dof(law, car=, parts=, **parameters of every shock FMU)."""

    def join(law: str = "lpnl2", *, car: Path | None = None, parts=None, **parameters: float) -> System:
        given = dict(parts or {})
        names = [corner for corner in CORNERS if corner not in given]
        components = {"car": FmuComponent(car or fmus["seven_dof"], "car")}
        components |= {name: given[name] if name in given else FmuComponent(fmus[law], name) for name in CORNERS}
        bonds = [Bond.between(f"car.{name}", name, displacement=name in names) for name in CORNERS]
        return System(components, bonds, parameters=dict.fromkeys(names, parameters))

    return join


@pytest.fixture
def quarter_cars(fmus):
    """Builder of unconnected quarter cars on the roads of `bumps`: quarter_cars("ab") for both or "a" for one."""

    def join(names: str = "a", components=None, **parameters: float) -> System:
        made = components or {}
        for name in names:
            made.setdefault(f"car_{name}", FmuComponent(fmus["quarter_car"], f"car_{name}"))
            made.setdefault(f"shock_{name}", FmuComponent(fmus["lpnl2"], f"shock_{name}"))
        parts = {f"{what}_{name}": made[f"{what}_{name}"] for name in names for what in ("car", "shock")}
        bonds = [Bond.between(f"car_{name}", f"shock_{name}") for name in names]
        constants = {f"car_{name}.aero_force": 0.0 for name in names}
        return System(parts, bonds, constants=constants, parameters={f"shock_{name}": parameters for name in names})

    return join
