"""Vehicles with a structural or an identified model, as stored in vehicle files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, astuple, dataclass, field, replace
from math import isfinite
from typing import Any, Literal, NamedTuple

import numpy as np

from eightpost.corners import channel
from eightpost.display import Summarized, Summary, some
from eightpost.errors import ParameterError
from eightpost.validity import Validity
from eightpost.vehicle import quarter_car, seven_dof
from eightpost.vehicle.bristle import Bristle
from eightpost.vehicle.conversions import add_port_damping, add_port_stiffness
from eightpost.vehicle.quantities import check_static
from eightpost.vehicle.quarter_car import QuarterCar
from eightpost.vehicle.seven_dof import SevenDof
from eightpost.vehicle.statespace import StateSpace

Model = Literal["quarter_car", "seven_dof", "state_space"]

#: Largest rates of growth of a motion [1/s]: with the baseline dampers it grows by half in a minute at most, and
#: without any, shocks in a loop with a delay of a millisecond still hold it.
GROWTH_WITH_DAMPERS, GROWTH_WITHOUT = 0.007, 100.0


@dataclass(frozen=True, slots=True, repr=False)
class StructuralVehicle(Summarized):
    """Vehicle that is defined by its masses, springs and dampers."""

    name: str  #: Name of the vehicle.
    parameters: QuarterCar | SevenDof  #: Parameters, SI.
    #: Values of the static state by output, SI: `{"lf.tire_force": 3300.0, "front.ride_height": 0.1}`. Outputs of the
    #: model are changes from it; the FMU adds it. Missing values are 0.
    static: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check the static state against the outputs."""
        object.__setattr__(self, "static", check_static(self.static, self.coupled().output_names, self.name))

    def _summary(self) -> Summary:
        known = self.parameters
        sprung = known.sprung_mass
        unsprung = known.unsprung_mass if isinstance(known, QuarterCar) else sum(known.unsprung_mass)
        model = self.coupled()
        return Summary.of(
            f"Vehicle {self.name}: {self.model}",
            ("masses", f"{sprung:.4g} kg sprung, {unsprung:.4g} kg unsprung"),
            ("inputs", some(model.input_names)),
            ("outputs", some(model.output_names)),
            ("static state", some(f"{name} {value:.4g}" for name, value in self.static.items() if value)),
        )

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
    """Friction and progressive spring at a port; their force is added to the shock force.

        F_f tanh(v / v_f) + F_s z / z_s + k2 d^2

    with the velocity v and the displacement d of the port, and the bristle's deflection z. The identified model is the
    car about the mean loads of its tests, and d is zero there. Without loads, d is `-mean_travel`; the car about that
    state (`IdentifiedVehicle.unloaded`) has the same spring k2 d^2 with its own d, and a stiffness that is lower by
    `2 k2 mean_travel`.
    """

    force: float = 0.0  #: Friction force F_f of the part that creeps [N], not below zero.
    velocity: float = 0.005  #: Smoothing velocity v_f of the change of sign [m/s], above zero.
    bristle: Bristle = Bristle()  #: The part that sticks; its default has no force.
    #: Coefficient k2 of the port spring [N/m2]: a spring that is stiffer in compression has a positive one.
    spring: float = 0.0
    #: Displacement from the state without loads to the mean of the tests [m]; it matters for a spring only.
    mean_travel: float = 0.0

    @property
    def acts(self) -> bool:
        """Whether any element has a force."""
        return self.force > 0.0 or self.bristle.force > 0.0 or self.spring != 0.0

    @property
    def sliding_force(self) -> float:
        """Friction force of a port that slides [N]."""
        return self.force + self.bristle.force

    def fault(self) -> str | None:
        """Return what is wrong with the values, None if they are valid."""
        own = self.bristle
        for name, value, is_in_range, range_ in (
            ("force", self.force, self.force >= 0.0, "N, not below zero"),
            ("velocity", self.velocity, self.velocity > 0.0, "m/s, above zero"),
            ("bristle.force", own.force, own.force >= 0.0, "N, not below zero"),
            ("bristle.reach", own.reach, own.reach > 0.0, "m, above zero"),
            ("bristle.static_ratio", own.static_ratio, own.static_ratio >= 1.0, "at least 1"),
            ("bristle.stribeck_velocity", own.stribeck_velocity, own.stribeck_velocity > 0.0, "m/s, above zero"),
            ("spring", self.spring, True, "N/m2"),
            ("mean_travel", self.mean_travel, True, "m"),
        ):
            if not (isfinite(value) and is_in_range):
                return f"{name} is {value!r}; give a finite number [{range_}]"
        return None


def _stated(law: Friction) -> dict[str, Any]:
    """Return the values that are not the defaults of their fields: a later version may have further fields."""
    known = {**law._asdict(), "bristle": asdict(law.bristle)}
    usual = {**Friction()._asdict(), "bristle": asdict(Bristle())}
    return {name: value for name, value in known.items() if value != usual[name]}


def _plain(law: Friction) -> Friction:
    """Return the same law with Python's numbers."""
    own = Bristle(*(float(value) for value in astuple(law.bristle)))
    return Friction(float(law.force), float(law.velocity), own, float(law.spring), float(law.mean_travel))


@dataclass(frozen=True, slots=True, repr=False)
class IdentifiedVehicle(Summarized):
    """Vehicle that is defined by an identified linear model."""

    name: str  #: Name of the vehicle.
    #: Identified model, around the baseline damping: its shock inputs are shock force minus `c v`.
    state_space: StateSpace
    #: Damping rate c by port [N.s/m] ("lf", ...; "" for a quarter car), the dissertation's C-bar. The input of a port
    #: that is missing here is the whole force.
    baseline_damping: Mapping[str, float] = field(default_factory=dict)
    #: Values of the static state by output, SI; see `StructuralVehicle`.
    static: Mapping[str, float] = field(default_factory=dict)
    #: SHA-256 digests of the files that the vehicle was identified from, by name.
    sources: Mapping[str, str] = field(default_factory=dict)
    #: Friction and springs by port; the shock forces of the identification included them. Missing ports have none.
    friction: Mapping[str, Friction] = field(default_factory=dict)
    #: Verdict on the model and the ranges that it covers; None if they are not known. It is "unknown" if `numbers` are
    #: not those that were judged.
    validity: Validity | None = None

    def __post_init__(self) -> None:
        """Check the static state and the ports against the model's channels."""
        names = self.state_space.output_names
        object.__setattr__(self, "static", check_static(self.static, names, self.name))
        object.__setattr__(self, "baseline_damping", {k: float(v) for k, v in self.baseline_damping.items()})
        object.__setattr__(self, "sources", dict(self.sources))
        friction = {k: _plain(v) for k, v in self.friction.items()}
        object.__setattr__(self, "friction", friction)
        self._check_ports("baseline damping", self.baseline_damping)
        self._check_ports("friction", self.friction)
        for port, law in friction.items():
            if (fault := law.fault()) is not None:
                raise ParameterError(f"{self.name}: the friction of the port {port!r} is invalid: {fault}")
            if law.spring and channel(port, "displacement") not in names:
                raise ParameterError(
                    f"{self.name}: the port {port!r} has a spring of {law.spring!r} N/m2, but the model has no output "
                    f"{channel(port, 'displacement')}; identify that output, or remove the spring"
                )
        if self.validity is not None:
            object.__setattr__(self, "validity", self.validity.checked(self.numbers, self.name))

    @property
    def numbers(self) -> Mapping[str, Any]:
        """All that the verdict is about: model, channels, damping, static state, friction, records."""
        model = self.state_space
        return {
            **{name: getattr(model, name).tolist() for name in ("A", "B", "C", "D")},
            "dt": model.dt,
            "channels": [(known.name, known.unit) for known in (*model.inputs, *model.outputs)],
            "baseline_damping": self.baseline_damping,
            "static": self.static,
            "friction": {port: _stated(law) for port, law in self.friction.items()},
            "records": sorted(self.sources.values()),
        }

    def _summary(self) -> Summary:
        verdict = self.validity.verdict if self.validity else None
        model = self.state_space
        damping = (f"{port or 'port'} {value:.4g} N.s/m" for port, value in self.baseline_damping.items())
        friction = (f"{port or 'port'} {law.sliding_force:.3g} N" for port, law in self.friction.items() if law.acts)
        return Summary.of(
            f"Identified vehicle {self.name}",
            ("verdict", verdict.headline if verdict else "not stated"),
            ("reason", str(verdict.decisive[0]) if verdict and verdict.reasons else ""),
            ("model", f"{len(model.A)} states"),
            ("inputs", some(model.input_names)),
            ("outputs", some(model.output_names)),
            ("baseline damping", some(damping)),
            ("friction", some(friction)),
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
        """Return the model without the baseline damping, whose inputs are the whole shock forces and loads.

        It is the car about the state without loads; see `unloaded`.

        Raises:
            ParameterError: The model is discrete, or a shock velocity has a direct term, or the displacement of a
                port with a spring.
        """
        model = self.unloaded().state_space
        if not self.baseline_damping:
            return model
        return add_port_damping(model, {port: -c for port, c in self.baseline_damping.items()})

    def unloaded(self) -> IdentifiedVehicle:
        """Return the vehicle about the state without loads; the identified one is about the mean loads of its tests.

        Raises:
            ParameterError: The model is discrete, or the displacement of a port with a spring has a direct term.
        """
        softer = {p: -2.0 * law.spring * law.mean_travel for p, law in self.friction.items() if law.mean_travel}
        if not softer:
            return self
        laws = {port: law._replace(mean_travel=0.0) for port, law in self.friction.items()}
        model = add_port_stiffness(self.state_space, softer)
        return replace(self, state_space=model, friction=laws, validity=None)

    def with_damper(self) -> StateSpace:
        """Return the identified model, with its baseline damping."""
        return self.state_space

    def instability(self) -> str | None:
        """Return which motion of the continuous model grows too fast to be simulated; None if none does."""
        tried = [("without dampers", self.coupled(), GROWTH_WITHOUT)]
        if self.baseline_damping:
            tried.insert(0, ("with its baseline dampers", self.state_space, GROWTH_WITH_DAMPERS))
        for dampers, model, largest in tried:
            poles = model.poles()
            growth = float(poles.real.max(initial=0.0))
            if growth > largest:
                frequency = float(np.abs(poles[np.argmax(poles.real)].imag) / (2.0 * np.pi))
                return f"{dampers}, a motion of {frequency:.3g} Hz grows at a rate of {growth:.3g} 1/s"
        return None


Vehicle = StructuralVehicle | IdentifiedVehicle
