"""Vehicles with a structural or an identified model, as stored in vehicle files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Literal, NamedTuple

from eightpost.errors import ParameterError
from eightpost.validity import Validity
from eightpost.vehicle import quarter_car, seven_dof
from eightpost.vehicle.conversions import add_port_damping
from eightpost.vehicle.quantities import check_static
from eightpost.vehicle.quarter_car import QuarterCar
from eightpost.vehicle.seven_dof import SevenDof
from eightpost.vehicle.statespace import StateSpace

Model = Literal["quarter_car", "seven_dof", "state_space"]


@dataclass(frozen=True, slots=True)
class StructuralVehicle:
    """Vehicle that is defined by its masses, springs and dampers.

    Attributes:
        name: Name of the vehicle.
        parameters: Parameters, SI.
        static: Values of the static state by output, SI: `{"lf.tire_force": 3300.0, "front.ride_height":
            0.1}`. Outputs of the model are changes from it; the FMU adds it. Missing values are 0.
    """

    name: str
    parameters: QuarterCar | SevenDof
    static: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the static state against the outputs."""
        object.__setattr__(self, "static", check_static(self.static, self.coupled().output_names, self.name))

    @property
    def model(self) -> Model:
        """Return the kind of model, the value of `model` in the file."""
        return "quarter_car" if isinstance(self.parameters, QuarterCar) else "seven_dof"

    def coupled(self) -> StateSpace:
        """Return the model without its own dampers, whose inputs are the whole shock forces."""
        if isinstance(self.parameters, QuarterCar):
            return quarter_car.coupled(self.parameters)
        return seven_dof.coupled(self.parameters)

    def with_damper(self) -> StateSpace:
        """Return the model with its linear dampers, for frequency responses and modes."""
        if isinstance(self.parameters, QuarterCar):
            return quarter_car.with_damper(self.parameters)
        return seven_dof.with_damper(self.parameters)


class Friction(NamedTuple):
    """Suspension friction at a port, `F_f tanh(v / v_f)`, which is added to the shock force.

    Attributes:
        force: Friction force F_f [N], not below zero.
        velocity: Smoothing velocity v_f of the change of sign [m/s], above zero.
    """

    force: float
    velocity: float


@dataclass(frozen=True, slots=True)
class IdentifiedVehicle:
    """Vehicle that is defined by an identified linear model.

    Attributes:
        name: Name of the vehicle.
        state_space: Identified model, around the baseline damping: its shock inputs are shock force minus `c v`.
        baseline_damping: Damping rate c by port [N.s/m] ("lf", ...; "" for a quarter car), the dissertation's C-bar.
            The input of a port that is missing here is the whole force.
        static: Values of the static state by output, SI; see `StructuralVehicle`.
        sources: SHA-256 digests of the files that the vehicle was identified from, by name.
        friction: Friction by port; the shock forces of the identification included it. Missing ports have no friction.
        validity: Verdict on the model and the ranges that it covers; None if they are not known.
    """

    name: str
    state_space: StateSpace
    baseline_damping: Mapping[str, float] = field(default_factory=dict)
    static: Mapping[str, float] = field(default_factory=dict)
    sources: Mapping[str, str] = field(default_factory=dict)
    friction: Mapping[str, Friction] = field(default_factory=dict)
    validity: Validity | None = None

    def __post_init__(self) -> None:
        """Check the static state and the ports against the model's channels."""
        names = self.state_space.output_names
        object.__setattr__(self, "static", check_static(self.static, names, self.name))
        object.__setattr__(self, "baseline_damping", {k: float(v) for k, v in self.baseline_damping.items()})
        object.__setattr__(self, "sources", dict(self.sources))
        friction = {k: Friction(float(v.force), float(v.velocity)) for k, v in self.friction.items()}
        object.__setattr__(self, "friction", friction)
        self._check_ports("baseline damping", self.baseline_damping)
        self._check_ports("friction", self.friction)
        for port, law in friction.items():
            if not (isfinite(law.force) and law.force >= 0.0 and isfinite(law.velocity) and law.velocity > 0.0):
                raise ParameterError(
                    f"{self.name}: the friction of the port {port!r} has the force {law.force!r} N and the velocity "
                    f"{law.velocity!r} m/s; give a force not below zero and a velocity above zero"
                )

    def _check_ports(self, what: str, given: Iterable[str]) -> None:
        inputs = self.state_space.input_names
        ports = [name.removesuffix("force").rstrip(".") for name in inputs]
        for port in given:
            if port not in ports:
                raise ParameterError(
                    f"{self.name}: {what} is given for the port {port!r}, but it has no force input; the inputs are "
                    f"{', '.join(inputs)}"
                )

    @property
    def model(self) -> Model:
        """Return the kind of model, the value of `model` in the file."""
        return "state_space"

    def coupled(self) -> StateSpace:
        """Return the model without the baseline damping, whose inputs are the whole shock forces.

        Raises:
            ParameterError: The model is discrete, or a shock velocity has a direct term.
        """
        if not self.baseline_damping:
            return self.state_space
        return add_port_damping(self.state_space, {port: -c for port, c in self.baseline_damping.items()})

    def with_damper(self) -> StateSpace:
        """Return the identified model, with its baseline damping."""
        return self.state_space


Vehicle = StructuralVehicle | IdentifiedVehicle
