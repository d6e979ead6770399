"""A coupled run whose solution is known, of components that need no FMU and no C compiler."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, sin, sqrt

import numpy as np

import cosim
from cosim.components.component import named_unit
from eightpost.array_types import Array

#: A wheel on its tire, and a shock: mass [kg], stiffness [N/m], damping [N s/m], first displacement [m].
MASS, STIFFNESS, DAMPING, START = 45.0, 3.5e5, 2.0e3, 0.01
#: Coupling step and length of the run [s].
STEP, STOP = 1e-4, 0.2

_FREQUENCY = sqrt(STIFFNESS / MASS)


def coupled_run(engine: str) -> cosim.Result:
    """Run the mass and the damper as two components, which exchange velocity and force at every coupling step."""
    system = cosim.System(
        {"wheel": _Wheel(), "shock": _Shock()},
        connections=(
            cosim.Connection("wheel.velocity", "shock.velocity"),
            cosim.Connection("shock.force", "wheel.force", gain=-1.0),
        ),
    )
    return cosim.run(system, cosim.Scenario(stop=STOP), step=STEP, compared=False, engine=engine)


def solution(time: Array) -> Array:
    """Return the velocity of the coupled mass at times (N,) [s], as solved by hand [m/s] (N,).

    With the damping ratio `z = c / (2 sqrt(k m))`, `w = sqrt(k / m)` and `q = w sqrt(1 - z^2)`, the displacement
    `x = x0 exp(-z w t) (cos q t + z w / q sin q t)` has the velocity `-x0 w^2 / q exp(-z w t) sin q t`.
    """
    ratio = DAMPING / (2.0 * sqrt(STIFFNESS * MASS))
    damped = _FREQUENCY * sqrt(1.0 - ratio**2)
    return np.asarray(
        -START * _FREQUENCY**2 / damped * np.exp(-ratio * _FREQUENCY * time) * np.sin(damped * time), dtype=np.float64
    )


@dataclass
class _Part:
    """What both components have in common; neither has parameters."""

    variables: Mapping[str, cosim.Variable] = field(init=False)
    capabilities: cosim.Capabilities = field(default_factory=cosim.Capabilities)
    identity: str = "doctor"
    source: str = "eightpost doctor"
    messages: tuple[str, ...] = ()

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """Begin a run."""

    def end_initialization(self) -> None:
        """Leave initialization."""

    def set_derivatives(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set nothing: inputs are held."""

    def finish(self) -> None:
        """End the run."""


@dataclass
class _Wheel(_Part):
    """Mass on a spring with an external force, stepped exactly for a force that is held over the step."""

    displacement: float = START
    velocity: float = 0.0
    force: float = 0.0

    def __post_init__(self) -> None:
        self.variables = _variables(_variable("force", "input", "N"), _variable("velocity", "output", "m/s"))

    def begin(self, start: float, stop: float, parameters: Mapping[str, float | bool | str]) -> None:
        """Begin a run at the first displacement, at rest."""
        self.displacement, self.velocity, self.force = START, 0.0, 0.0

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set the force [N]."""
        for value in values:
            self.force = value

    def get(self, names: Sequence[str]) -> list[float]:
        """Return the velocity [m/s], or the force [N] that was set."""
        return [self.velocity if name == "velocity" else self.force for name in names]

    def step(self, time: float, step: float) -> None:
        """Advance by a step [s]."""
        rest = self.force / STIFFNESS
        away, turn = self.displacement - rest, _FREQUENCY * step
        self.displacement = rest + away * cos(turn) + self.velocity / _FREQUENCY * sin(turn)
        self.velocity = self.velocity * cos(turn) - away * _FREQUENCY * sin(turn)


@dataclass
class _Shock(_Part):
    """Linear damper."""

    velocity: float = 0.0

    def __post_init__(self) -> None:
        self.variables = _variables(
            _variable("velocity", "input", "m/s"), _variable("force", "output", "N", direct={"velocity"})
        )

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set the velocity [m/s]."""
        for value in values:
            self.velocity = value

    def get(self, names: Sequence[str]) -> list[float]:
        """Return the force [N], or the velocity [m/s] that was set."""
        return [DAMPING * self.velocity if name == "force" else self.velocity for name in names]

    def step(self, time: float, step: float) -> None:
        """Advance by a step [s]; there is no state."""


def _variable(name: str, causality: str, unit: str, direct: set[str] | None = None) -> cosim.Variable:
    return cosim.Variable(name, causality, unit=named_unit(unit), direct=frozenset(direct or ()))


def _variables(*found: cosim.Variable) -> dict[str, cosim.Variable]:
    return {variable.name: variable for variable in found}
