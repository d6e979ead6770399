"""Simulation of an identified vehicle, with measured shock forces or with shock laws at its ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass

import numpy as np
from scipy.sparse import csr_array

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import InputError, ParameterError, StepError
from eightpost.ident.vehicle.port_laws import with_port_laws
from eightpost.ident.vehicle.stability import discretise_by_parts
from eightpost.shock import ShockLaw
from eightpost.shock.law import State
from eightpost.signals import TimeSeries
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, kernel
from eightpost.vehicle.friction import deflection_after


def ports_of(model: StateSpace) -> tuple[str, ...]:
    """Return the ports of a vehicle, in the order of its inputs."""
    ports = (n.removesuffix("force").rstrip(".") for n in model.input_names if n.rpartition(".")[2] == "force")
    return tuple(port for port in ports if channel(port, "velocity") in model.output_names)


def port_numbers(law: Friction) -> tuple[float, ...]:
    """Return F_f, v_f, F_s, z_s, rho, v_s and k2 of a port; see `eightpost.vehicle.Friction`."""
    return law.force, law.velocity, *astuple(law.bristle), law.spring


# ---- Prediction of a rig record -------------------------------------------------------------------------------------

#: Subdivisions of the step that are tried if a steep law prevents the solution of a step.
_FINER = (1, 2, 4, 8)


def open_at_ports(vehicle: IdentifiedVehicle, record: TimeSeries) -> TimeSeries:
    """Return the vehicle's outputs under a record's roads, loads and shock forces, from rest.

        dF = F + F_f tanh(v / v_f) + F_s z / z_s + k2 d^2 - c v

    with the measured force F, the measured velocity v and displacement d, and the bristle's deflection z under v.

    Args:
        vehicle: Identified vehicle.
        record: Record without means; inputs of the vehicle that are not in it are zero.
    """
    model = vehicle.state_space
    whole = with_port_laws(record, vehicle.friction)
    u = np.zeros((len(record), len(model.inputs)))
    for j, name in enumerate(model.input_names):
        if name in whole:
            u[:, j] = whole[name]
    for port in ports_of(model):
        rate = vehicle.baseline_damping.get(port, 0.0)
        u[:, model.input_names.index(channel(port, "force"))] -= rate * record[channel(port, "velocity")]
    return series_of(model, record.time, _respond(model, u, 1.0 / record.sample_rate))


def port_by_port(vehicle: IdentifiedVehicle, drive: TimeSeries, laws: Mapping[str, ShockLaw]) -> TimeSeries:
    """Return the vehicle's outputs with arbitrary shock laws, at the drive's samples.

    Args:
        vehicle: Identified vehicle, with the friction at its ports.
        drive: Inputs without means, as for `simulate_with_shocks`.
        laws: Shock law of every port.

    Raises:
        StepError: The laws are too stiff even for an eighth of the drive's step.
    """
    for finer in _FINER:
        fine = drive if finer == 1 else drive.resample(finer * drive.sample_rate)
        try:
            outputs = simulate_with_shocks(vehicle, laws, fine).select(vehicle.state_space.output_names)
        except StepError:
            if finer == _FINER[-1]:
                raise
            continue
        channels = {n: (u, np.interp(drive.time, fine.time, row))
                    for n, u, row in zip(outputs.names, outputs.units, outputs.values, strict=True)}  # fmt: skip
        return TimeSeries.from_channels(drive.time, channels)
    raise AssertionError("one of the steps was the last")


def _discrete(model: StateSpace, step: float) -> kernel.Discrete:
    """Return the matrices of a step with inputs that are linear, or held at its start if the model is discrete."""
    if model.dt is None:
        return discretise_by_parts(model.A, model.B, step)
    if abs(step / model.dt - 1.0) > 1e-3:
        raise InputError(f"the step of {model.name} is {model.dt} s, that of the drive {step:g} s; resample the drive")
    return kernel.Discrete(model.A, model.B, np.zeros_like(model.B))


def _respond(model: StateSpace, u: Array, step: float) -> Array:
    """Return the outputs (p, N) for inputs (N, m)."""
    found = _discrete(model, step)
    A, pushed = csr_array(found.Ad), u[:-1] @ found.B0.T + u[1:] @ found.B1.T
    C, x, y = csr_array(model.C), np.zeros(len(model.A)), u @ model.D.T
    for k, push in enumerate(pushed, start=1):
        x = A @ x + push
        y[k] += C @ x
    return np.asarray(y.T)


def series_of(model: StateSpace, time: Array, outputs: Array) -> TimeSeries:
    """Return the outputs (p, N) of a model as channels."""
    channels = {c.name: (c.unit, row) for c, row in zip(model.outputs, outputs, strict=True)}
    return TimeSeries.from_channels(time, channels)


# ---- Simulation with arbitrary shock laws ---------------------------------------------------------------------------

_MAX_ITERATIONS = 50
#: Change of the forces [N] at which the iteration has converged.
_CLOSE = 1e-6


def simulate_with_shocks(vehicle: IdentifiedVehicle, shocks: Mapping[str, ShockLaw], drive: TimeSeries) -> TimeSeries:
    """Simulate an identified vehicle with shocks at its ports.

    Each shock gives a force F at the port velocity v. As the vehicle includes the baseline damper c, its input is F - c
    v plus the friction of the port. A continuous model is stepped exactly for inputs that are linear between the
    samples of the drive; the force at the end of a step is found by iteration. A discrete model uses the force of the
    previous sample, as its difference equation does.

    Args:
        vehicle: Identified vehicle. The input of a port without baseline damping is the whole force.
        shocks: Shock law by port ("lf", ...; "" for a quarter car). A port without a shock has no shock force.
        drive: Inputs of the vehicle by name; missing ones are zero, and forces of ports act in addition to the shocks.
            Its sample rate is that of the simulation.

    Returns:
        Outputs of the vehicle and the whole force of each shock, as `force` of its port, at the times of the drive.

    Raises:
        InputError: The drive or the shocks do not match the vehicle.
        StepError: The force of a step does not converge, as the step is too long for such stiff shocks.
    """
    loop = _Loop.of(vehicle, shocks, drive)
    outputs, forces = loop.run(drive)
    series = series_of(loop.model, drive.time, outputs)
    for port, row in zip(loop.ports, forces, strict=True):
        series = series.with_channel(channel(port, "force"), "N", row)
    return series


@dataclass(frozen=True, slots=True, eq=False)
class _Loop:
    model: StateSpace
    ports: tuple[str, ...]
    laws: tuple[ShockLaw | None, ...]
    damping: Array
    forces: list[int]
    velocities: list[int]
    displacements: list[int | None]
    friction: Array

    @classmethod
    def of(cls, vehicle: IdentifiedVehicle, shocks: Mapping[str, ShockLaw], drive: TimeSeries) -> _Loop:
        model = vehicle.state_space
        ports = ports_of(model)
        for port in shocks:
            if port not in ports:
                raise InputError(
                    f"there is no port {port!r}; the vehicle's ports are {', '.join(map(repr, ports)) or 'none'}"
                )
        _check_drive(model, drive)
        forces = [model.input_names.index(channel(port, "force")) for port in ports]
        velocities = [model.output_names.index(channel(port, "velocity")) for port in ports]
        if np.abs(model.D[np.ix_(velocities, forces)]).any():
            raise ParameterError(
                f"{model.name}: a shock velocity has a direct term in a shock force, which makes an algebraic loop; "
                "fit these paths with a numerator of lower degree than the denominator"
            )
        rows = {name: row for row, name in enumerate(model.output_names)}
        at = [rows.get(channel(port, "displacement")) for port in ports]
        damping = np.array([vehicle.baseline_damping.get(port, 0.0) for port in ports])
        friction = np.array([port_numbers(vehicle.friction.get(port, Friction())) for port in ports]).reshape(-1, 7).T
        return cls(model, ports, tuple(shocks.get(port) for port in ports), damping, forces, velocities, at, friction)

    def _change(self, force: Array, v: Array, bend: Array, d: Sequence[float]) -> Array:
        """Return the force of shocks, friction and port springs minus that of the baseline dampers [N] (ports,)."""
        creeping, width, sliding, reach, _, _, spring = self.friction
        own = creeping * np.tanh(v / width) + sliding / reach * bend + spring * np.square(d)
        return np.asarray(force + own - self.damping * v)

    def _bent(self, bend: Array, before: Array, now: Array, step: float) -> Array:
        """Return the deflections of the bristles after a step with linear velocities (ports,) [m]."""
        _, _, sliding, *law, _ = self.friction
        moved = deflection_after(bend, 0.5 * (before + now), step, *law)
        return np.where(sliding > 0.0, moved, bend)

    def run(self, drive: TimeSeries) -> tuple[Array, Array]:
        """Return the outputs (p, N) and the shock forces (ports, N)."""
        u = np.zeros((len(drive), len(self.model.inputs)))
        for name in drive.names:
            u[:, self.model.input_names.index(name)] = drive[name]
        model, step = self.model, 1.0 / drive.sample_rate
        found = _discrete(model, step)
        A, B0, B1, C = csr_array(found.Ad), csr_array(found.B0), csr_array(found.B1), csr_array(model.C)
        D, driven = model.D[:, self.forces], found.B1[:, self.forces]
        by_force = C @ driven + D
        x, state = np.zeros(len(model.A)), _Shocks.at_rest(self.laws)
        outputs, forces = np.empty((len(u), len(model.outputs))), np.zeros((len(u), len(self.ports)))
        v, change, bend = np.zeros((3, len(self.ports)))
        for k in range(len(u)):
            free = x if k == 0 else A @ x + B0 @ u[k - 1] + B1 @ u[k]
            y_free = C @ free + model.D @ u[k]
            sensitivity = by_force if k else D
            for _ in range(_MAX_ITERATIONS):
                y = y_free + sensitivity @ change
                following, force = state.after(v, y[self.velocities], self._displacement(y), step if k else 0.0)
                bent = self._bent(bend, v, y[self.velocities], step if k else 0.0)
                previous, change = change, self._change(force, y[self.velocities], bent, self._displacement(y))
                if np.abs(change - previous).max(initial=0.0) <= _CLOSE:
                    break
            else:
                raise StepError(
                    f"the shock forces at sample {k} do not converge with steps of {step:g} s; resample the drive at a "
                    "higher rate"
                )
            state, forces[k], outputs[k], v, bend = following, force, y, y[self.velocities], bent
            x = free if k == 0 else free + driven @ change
            u[k, self.forces] += change
        return outputs.T, forces.T

    def _displacement(self, y: Array) -> list[float]:
        return [0.0 if row is None else float(y[row]) for row in self.displacements]


@dataclass(frozen=True, slots=True)
class _Shocks:
    """Laws and states of the shocks."""

    laws: tuple[ShockLaw | None, ...]
    states: tuple[State, ...]

    @classmethod
    def at_rest(cls, laws: Sequence[ShockLaw | None]) -> _Shocks:
        return cls(tuple(laws), tuple(0.0 if law is None else law.start(0.0) for law in laws))

    def after(self, before: Array, now: Array, displacement: list[float], step: float) -> tuple[_Shocks, Array]:
        """Return the shocks after a step with linear velocities, and their forces."""
        states, forces = list(self.states), np.zeros(len(self.laws))
        for i, law in enumerate(self.laws):
            if law is None:
                continue
            if step > 0.0:
                states[i] = law.follow(states[i], float(before[i]), float(now[i]), step)
            forces[i] = law.response(states[i], float(now[i]), displacement[i]).force
        return _Shocks(self.laws, tuple(states)), forces


def _check_drive(model: StateSpace, drive: TimeSeries) -> None:
    if not drive.is_uniform:
        raise InputError("the drive is not evenly sampled; resample it")
    for name in drive.names:
        if name not in model.input_names:
            raise InputError(
                f"the drive has the channel {name!r}, which is not an input of the vehicle {model.name!r}; leave it out"
            )
