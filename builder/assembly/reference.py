"""Reference results of an assembly, computed from the library's laws and exact linear step, never from a binary.

The coupling scheme is an independent implementation of that in fmus/assembly/model.c.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import ceil

import numpy as np
from numpy.typing import NDArray

from builder.assembly.models import VehicleModel, shock_law, vehicle_model
from builder.assembly.parts import Part
from builder.assembly.plan import Assembly, Link
from builder.documents.reference import COUNT, STEP, Reference, rounded, vehicle_inputs
from builder.interface import Interface
from eightpost.shock import ShockLaw
from eightpost.vehicle import friction

Array = NDArray[np.float64]

_MEAN_DEFECT = 5.0 / 12.0
_LEAST_SPREAD = 1e-4


def assembly_reference(assembly: Assembly, interface: Interface) -> Reference | None:
    """Return the response of an assembly to sums of sines at all inputs, with different frequencies at each input.

    Returns None if its vehicle has no equilibrium; the FMU then refuses to start with its default parameters.
    """
    inputs = [v for v in interface.variables if v.causality == "input"]
    starts = np.array([float(v.start or 0.0) for v in inputs])
    u = rounded(starts + vehicle_inputs([v.unit or "1" for v in inputs]))
    run = _Run(assembly, tuple(v.name for v in inputs), interface.names("output"))
    step = next(float(v.start or 0.0) for v in interface.variables if v.name == "coupling_step")
    count = ceil(STEP / step * (1.0 - 1e-9))
    try:
        run.start(u[0])
    except ValueError:
        return None
    rows = [run.outputs()]
    for held in u[:COUNT]:
        for _ in range(count):
            run.step(held, STEP / count)
        rows.append(run.outputs())
    return Reference(run.inputs, u, run.names, np.array(rows))


class _Run:
    """A running assembly: the vehicle's state, the lagged forces, and every output by `component.variable`."""

    def __init__(self, assembly: Assembly, inputs: tuple[str, ...], names: tuple[str, ...]) -> None:
        self.inputs, self.names = inputs, names
        self._assembly = assembly
        self._vehicle: VehicleModel = vehicle_model(assembly)
        self._laws: dict[str, ShockLaw] = {part.name: shock_law(assembly, part) for part in assembly.shocks}
        self._state = np.zeros(self._vehicle.stepper.A.shape[0])
        self._lagged = dict.fromkeys(self._laws, 0.0)
        self._now: dict[str, float] = {}
        self._slope = {f"{name}.force": 0.0 for name in self._laws}
        # Per force: integral of squared prediction errors, mean, integral of squared deviations from the mean.
        self._meters = {f"{name}.force": (0.0, 0.0, 0.0) for name in self._laws}
        self._time = 0.0
        self._wires = {part.name: tuple(self._wiring(part)) for part in assembly.parts}

    def _wiring(self, part: Part) -> Iterator[tuple[int | None, tuple[Link, ...]]]:
        """Yield the index of the assembly's input and the links for each input of a part."""
        for name in part.interface.names("input"):
            full = f"{part.name}.{name}"
            yield self.inputs.index(full) if full in self.inputs else None, self._assembly.into(part, name)

    def start(self, u: Array) -> None:
        """Solve for the shock forces that are consistent with the vehicle's start state; at rest both are linear."""
        forces = [f"{name}.force" for name in self._laws]
        count = len(forces)
        none, *ones = (
            self._start_under(u, dict(zip(forces, row, strict=True))) for row in (np.zeros(count), *np.eye(count))
        )
        gains = np.column_stack([one - none for one in ones])
        found = np.linalg.solve(np.eye(count) - gains, none)
        self._start_under(u, dict(zip(forces, found.tolist(), strict=True)))

    def _start_under(self, u: Array, forces: dict[str, float]) -> Array:
        model, self._now = self._vehicle, dict(forces)
        fed = self._fed(self._assembly.vehicle.name, u, self._now)
        if model.starts_at_equilibrium:
            self._state = model.stepper.equilibrium(fed)
        self._take_vehicle(fed)
        for name, law in self._laws.items():
            velocity, displacement = self._fed(name, u, self._now)
            self._lagged[name] = law.static_force(velocity)
            self._now[f"{name}.force"] = law.response(self._lagged[name], velocity, displacement).force
        return np.array([self._now[f"{name}.force"] for name in self._laws])

    def step(self, u: Array, h: float) -> None:
        """Do one micro step with the inputs held."""
        before = dict(self._now)
        ahead = {name: before[name] + slope * h for name, slope in self._slope.items()}
        self._step_vehicle(u, before, before | ahead, h)
        for name, law in self._laws.items():
            (v0, _), (v1, x1) = self._fed(name, u, before), self._fed(name, u, self._now)
            self._lagged[name] = law.follow(self._lagged[name], v0, v1, h)
            self._now[f"{name}.force"] = law.response(self._lagged[name], v1, x1).force
        self._time += h
        for name, assumed in ahead.items():
            came, (missed, mean, spread) = self._now[name], self._meters[name]
            nearer = mean + (came - mean) * h / self._time
            self._meters[name] = (
                missed + h * (assumed - came) ** 2,
                nearer,
                spread + h * (came - mean) * (came - nearer),
            )
            self._slope[name] = (came - before[name]) / h

    def _step_vehicle(self, u: Array, before: dict[str, float], ahead: dict[str, float], h: float) -> None:
        model, name = self._vehicle, self._assembly.vehicle.name
        u0, u1 = self._fed(name, u, before), self._fed(name, u, ahead)
        self._state = friction.advance(model.stepper, model.friction, self._state, u0, u1, h)
        self._take_vehicle(u1)

    def _take_vehicle(self, u: Array) -> None:
        model, part = self._vehicle, self._assembly.vehicle
        y = friction.output(model.stepper, model.friction, self._state, u) + model.offsets
        for name, value in zip(part.interface.names("output"), y.tolist(), strict=True):
            self._now[f"{part.name}.{name}"] = value

    def _fed(self, component: str, u: Array, now: dict[str, float]) -> Array:
        """Return the inputs of a part."""
        return np.array(
            [
                (0.0 if outside is None else u[outside]) + sum(_through(link, now) for link in links)
                for outside, links in self._wires[component]
            ]
        )

    def outputs(self) -> list[float]:
        """Return all outputs of the assembly, in order."""
        errors = {name: self._error(meter) for name, meter in self._meters.items()}
        own = {f"{name.removesuffix('force')}coupling_error": error for name, (error, _) in errors.items()}
        worst = max(100.0 * error / spread if spread > 0.0 else 0.0 for error, spread in errors.values())
        values = self._now | own | {"coupling_error": worst}
        return [values[name] for name in self.names]

    def _error(self, meter: tuple[float, float, float]) -> tuple[float, float]:
        """Return a force's RMS local error and its standard deviation [N]; 0 if it is almost constant."""
        if self._time == 0.0:
            return 0.0, 0.0
        missed, mean, squares = meter
        spread = (max(squares, 0.0) / self._time) ** 0.5
        moves = spread > _LEAST_SPREAD * (abs(mean) + 1.0)
        return _MEAN_DEFECT * (missed / self._time) ** 0.5, spread if moves else 0.0


def _through(link: Link, now: dict[str, float]) -> float:
    return link.gain * (link.factor * now[link.source] + link.offset)
