"""Simulation of an identified vehicle, with measured shock forces or shock laws at its ports: one or many setups."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple, dataclass, replace

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import resample
from scipy.sparse import csr_array

from eightpost.array_types import Array, Integers
from eightpost.corners import channel
from eightpost.errors import EightpostError, FmuError, InputError, ParameterError, StepError
from eightpost.ident.shock.simulation import simulate
from eightpost.ident.vehicle.experiment import port_slope, quantity
from eightpost.ident.vehicle.stability import closed_loop_stability, discretise_by_parts
from eightpost.machine import Batch, Drive, LinearCar, NotInBatchError, Port, Run, ShockData, UnstableCarError, Vehicle
from eightpost.shock import Polylinear, ShockLaw, StaticCurve, law_name
from eightpost.signals import TimeSeries
from eightpost.vehicle import Bristle, Friction, IdentifiedVehicle, StateSpace, add_port_damping, kernel
from eightpost.vehicle.friction import deflection_after

# ==== Friction and springs at the ports in a record: what its shock forces lack to drive a linear car ================

#: Rates [Hz] at which friction is evaluated: harmonics of the tanh far above the records' band would otherwise alias,
#: and a bristle turns over far less than a sample of a record.
_CREEP_RATE, _BRISTLE_RATE = 1000.0, 2500.0


def direction(velocity: Array, rate: float, width: float) -> Array:
    """Return `tanh(v / v_f)` (N,) of the velocity (N,) [m/s] in a record, band-limited to its rate [Hz].

    Raises:
        ParameterError: The friction velocity v_f (`width`) [m/s] is not above zero.
    """
    if not width > 0.0:
        raise ParameterError(f"the friction velocity is {width!r} m/s; it must be above zero")
    return _at_higher_rate(velocity, max(1, round(_CREEP_RATE / rate)), lambda v: np.tanh(v / width))


def bristle_force(velocity: Array, rate: float, law: Bristle) -> Array:
    """Return the force F_s z / z_s [N] (N,) of a bristle, band-limited to the rate of the record [Hz].

    The bristle is relaxed at the first sample. It follows the velocity (N,) [m/s], interpolated to a rate of 2.5 kHz or
    more, with steps that are exact for their mean velocity. With a sliding force of 1 N the result is relative to it.
    """
    from eightpost.vehicle.compiled import deflections  # noqa: PLC0415 - numba, which other ports do not need

    finer = max(1, int(np.ceil(_BRISTLE_RATE / rate - 1e-9)))
    bend = _at_higher_rate(velocity, finer, lambda v: deflections(v, 1.0 / (rate * finer), law))
    return np.asarray(law.force_at(bend), dtype=np.float64)


def law_force(record: TimeSeries, port: str, law: ShockLaw) -> Array:
    """Return the force of a shock [N] (N,) under the motion of a port in a record, band-limited to its rate."""
    rate = record.sample_rate
    finer = max(1, int(np.ceil(_BRISTLE_RATE / rate - 1e-9)))

    def of_velocity(v: Array) -> Array:
        time = np.arange(v.size) / (rate * finer)
        return simulate(law, TimeSeries.from_channels(time, {"velocity": ("m/s", v)}))

    gas = law.port.gas_stiffness * law.port.motion_ratio**2
    force = _at_higher_rate(record[channel(port, "velocity")], finer, of_velocity)
    return force + gas * record[channel(port, "displacement")] if gas else force


def _at_higher_rate(velocity: Array, finer: int, law: Callable[[Array], Array]) -> Array:
    if finer == 1:
        return law(velocity)
    # Padding avoids lengths with a large prime factor, whose transforms take ten times as long.
    padded = np.zeros(next_fast_len(velocity.size, real=True))
    padded[: velocity.size] = velocity
    values = law(resample(padded, padded.size * finer))
    return np.asarray(resample(values, padded.size)[: velocity.size], dtype=np.float64)


def with_port_laws(series: TimeSeries, friction: Mapping[str, Friction]) -> TimeSeries:
    """Return a record whose shock forces include friction, bristle and spring of their ports, by port.

    The record has no means; it has `force` and `velocity` of each port, and `displacement` of ports with a spring.
    """
    rate = series.sample_rate
    for port, law in friction.items():
        name, velocity, added = channel(port, "force"), series[channel(port, "velocity")], []
        if law.force:
            added.append(law.force * direction(velocity, rate, law.velocity))
        if law.bristle.force:
            added.append(bristle_force(velocity, rate, law.bristle))
        if law.spring:
            added.append(law.spring * series[channel(port, "displacement")] ** 2)
        for force in added:
            series = series.with_channel(name, "N", series[name] + force)
    return series


# ==== Prediction of a rig record =====================================================================================


def ports_of(model: StateSpace) -> tuple[str, ...]:
    """Return the ports of a vehicle, in the order of its inputs."""
    ports = (n.removesuffix("force").rstrip(".") for n in model.input_names if n.rpartition(".")[2] == "force")
    return tuple(port for port in ports if channel(port, "velocity") in model.output_names)


def open_at_ports(vehicle: IdentifiedVehicle, record: TimeSeries) -> TimeSeries:
    """Return the vehicle's outputs under a record's roads, loads and shock forces, from rest.

        dF = F + F_f tanh(v / v_f) + F_s z / z_s + k2 d^2 - c v

    with the measured force F, the measured velocity v and displacement d, and the bristle's deflection z under v. The
    record has no means; inputs of the vehicle that are not in it are zero.
    """
    model, whole = vehicle.state_space, with_port_laws(record, vehicle.friction)
    u = np.zeros((len(record), len(model.inputs)))
    for j, name in enumerate(model.input_names):
        if name in whole:
            u[:, j] = whole[name]
    for port in ports_of(model):
        rate = vehicle.baseline_damping.get(port, 0.0)
        u[:, model.input_names.index(channel(port, "force"))] -= rate * record[channel(port, "velocity")]
    step = _discrete(model, 1.0 / record.sample_rate)
    A, pushed = csr_array(step.Ad), u[:-1] @ step.B0.T + u[1:] @ step.B1.T
    C, x, y = csr_array(model.C), np.zeros(len(model.A)), u @ model.D.T
    for k, push in enumerate(pushed, start=1):
        x = A @ x + push
        y[k] += C @ x
    return _series(model, record.time, y.T)


def closed_at_ports(vehicle: IdentifiedVehicle, record: TimeSeries, laws: Mapping[str, ShockLaw]) -> TimeSeries:
    """Return the vehicle's outputs with shock laws at all ports, under the roads and loads of a record without means.

    It starts from rest.
    """
    model, forces = vehicle.state_space, {channel(port, "force") for port in ports_of(vehicle.state_space)}
    drive = record.select(n for n in model.input_names if n in record and n not in forces)
    if model.dt is None and set(vehicle.baseline_damping) == set(laws):
        bank = [laws[port] for port in vehicle.baseline_damping]
        return _series(model, record.time, ManySetups(vehicle, bank, drive).run([range(len(bank))])[0])
    return port_by_port(vehicle, drive, laws)


def _discrete(model: StateSpace, step: float) -> kernel.Discrete:
    """Return the matrices of a step with inputs that are linear, or held at its start if the model is discrete."""
    if model.dt is None:
        return discretise_by_parts(model.A, model.B, step)
    if abs(step / model.dt - 1.0) > 1e-3:
        raise InputError(f"the step of {model.name} is {model.dt} s, that of the drive {step:g} s; resample the drive")
    return kernel.Discrete(model.A, model.B, np.zeros_like(model.B))


def _series(model: StateSpace, time: Array, outputs: Array) -> TimeSeries:
    """Return the outputs (p, N) of a model as channels."""
    channels = {c.name: (c.unit, row) for c, row in zip(model.outputs, outputs, strict=True)}
    return TimeSeries.from_channels(time, channels)


# ==== Simulation step by step in Python, with any law ================================================================

#: Largest number of iterations for the forces of a step, and change of the forces [N] at which it has converged.
_MAX_ITERATIONS, _CLOSE = 50, 1e-6

#: Subdivisions of the step that are tried if a steep law prevents the solution of a step.
_FINER = (1, 2, 4, 8)


def port_by_port(vehicle: IdentifiedVehicle, drive: TimeSeries, laws: Mapping[str, ShockLaw]) -> TimeSeries:
    """Return the vehicle's outputs with arbitrary shock laws, at the drive's samples; see `simulate_with_shocks`.

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
    model = vehicle.state_space
    ports = ports_of(model)
    for port in shocks:
        if port not in ports:
            raise InputError(
                f"there is no port {port!r}; the vehicle's ports are {', '.join(map(repr, ports)) or 'none'}"
            )
    if not drive.is_uniform:
        raise InputError("the drive is not evenly sampled; resample it")
    for name in drive.names:
        if name not in model.input_names:
            raise InputError(
                f"the drive has the channel {name!r}, which is not an input of the vehicle {model.name!r}; leave it out"
            )
    outputs, forces = _Loop.of(vehicle, ports, shocks).run(drive)
    series = _series(model, drive.time, outputs)
    for port, row in zip(ports, forces, strict=True):
        series = series.with_channel(channel(port, "force"), "N", row)
    return series


@dataclass(frozen=True, slots=True, eq=False)
class _Loop:
    """Loop of a model and its ports: positions of their channels, laws, baseline damping and friction (7, ports)."""

    model: StateSpace
    laws: tuple[ShockLaw | None, ...]
    damping: Array
    forces: list[int]
    velocities: list[int]
    displacements: list[int | None]
    friction: Array

    @classmethod
    def of(cls, vehicle: IdentifiedVehicle, ports: Sequence[str], shocks: Mapping[str, ShockLaw]) -> _Loop:
        model = vehicle.state_space
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
        friction = np.array([_numbers(vehicle.friction.get(port, Friction())) for port in ports]).reshape(-1, 7).T
        return cls(model, tuple(shocks.get(port) for port in ports), damping, forces, velocities, at, friction)

    def run(self, drive: TimeSeries) -> tuple[Array, Array]:
        """Return the outputs (p, N) and the shock forces (ports, N)."""
        model, step, ports = self.model, 1.0 / drive.sample_rate, len(self.laws)
        u = np.zeros((len(drive), len(model.inputs)))
        for name in drive.names:
            u[:, model.input_names.index(name)] = drive[name]
        exact = _discrete(model, step)
        A, B0, B1, C = csr_array(exact.Ad), csr_array(exact.B0), csr_array(exact.B1), csr_array(model.C)
        D, driven = model.D[:, self.forces], exact.B1[:, self.forces]
        by_force = C @ driven + D
        x, states = np.zeros(len(model.A)), [0.0 if law is None else law.start(0.0) for law in self.laws]
        outputs, forces = np.empty((len(u), len(model.outputs))), np.zeros((len(u), ports))
        v, change, bend = np.zeros((3, ports))
        for k in range(len(u)):
            h = step if k else 0.0
            free = x if k == 0 else A @ x + B0 @ u[k - 1] + B1 @ u[k]
            y_free = C @ free + model.D @ u[k]
            sensitivity = by_force if k else D
            for _ in range(_MAX_ITERATIONS):
                y = y_free + sensitivity @ change
                now, travel = y[self.velocities], [0.0 if row is None else float(y[row]) for row in self.displacements]
                following, force = list(states), np.zeros(ports)
                for i, law in enumerate(self.laws):
                    if law is not None:
                        if h:
                            following[i] = law.follow(states[i], float(v[i]), float(now[i]), h)
                        force[i] = law.response(following[i], float(now[i]), travel[i]).force
                bent = self._bent(bend, v, now, h)
                previous, change = change, self._change(force, now, bent, travel)
                if np.abs(change - previous).max(initial=0.0) <= _CLOSE:
                    break
            else:
                raise StepError(
                    f"the shock forces at sample {k} do not converge with steps of {step:g} s; resample the drive at a "
                    "higher rate"
                )
            states, forces[k], outputs[k], v, bend = following, force, y, now, bent
            x = free if k == 0 else free + driven @ change
            u[k, self.forces] += change
        return outputs.T, forces.T

    def _change(self, force: Array, v: Array, bend: Array, d: Sequence[float]) -> Array:
        """Return the force of shocks, friction and port springs minus that of the baseline dampers [N] (ports,)."""
        creeping, width, sliding, reach, _, _, spring = self.friction
        friction = creeping * np.tanh(v / width) + sliding / reach * bend + spring * np.square(d)
        return np.asarray(force + friction - self.damping * v)

    def _bent(self, bend: Array, before: Array, now: Array, step: float) -> Array:
        """Return the deflections of the bristles after a step with linear velocities (ports,) [m]."""
        _, _, sliding, *law, _ = self.friction
        moved = deflection_after(bend, 0.5 * (before + now), step, *law)
        return np.where(sliding > 0.0, moved, bend)


def _numbers(law: Friction) -> tuple[float, ...]:
    """Return F_f, v_f, F_s, z_s, rho, v_s and k2 of a port; see `eightpost.vehicle.Friction`."""
    return law.force, law.velocity, *astuple(law.bristle), law.spring


# ==== Simulation of many setups on the machine =======================================================================

#: Velocity up to which the median slope of the shocks is the damping around which their ports are solved [m/s].
_USUAL_VELOCITY = 0.2

#: The number of modes is made a multiple of this one, so that few libraries are compiled.
_MULTIPLE = 8

#: Largest change of a port's velocity in the last sweep of a step [1], RMS relative to the velocity.
_LARGEST_CHANGE = 0.01

#: Law without force, for dampers that are part of the model.
_NO_SHOCK = Polylinear(StaticCurve((0.0,) * 15, (0.0,) * 4, (0.0,) * 4, 0.1, 0.01, 1.0, 1.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class ManySetups:
    """Simulation of the setups of a vehicle with shocks from a bank, on one drive."""

    vehicle: IdentifiedVehicle  #: Identified continuous vehicle with the friction of its ports.
    #: Shock laws that setups choose from; their gas preload has no effect, as the vehicle moves about rest, and gas
    #: springs have none if the vehicle has no displacements of its ports.
    bank: Sequence[ShockLaw]
    #: Evenly sampled inputs by name; missing ones are zero, and forces of ports act in addition to the shocks. Its
    #: sample rate is that of the simulation.
    drive: TimeSeries
    every: int = 1  #: Interval of the output samples, in samples of the drive.

    def run(self, setups: Sequence[Sequence[int]]) -> Array:
        """Simulate setups from rest, on the machine if it can run them, or else step by step in Python.

        A setup has the places in the bank of its shocks, in the order of the vehicle's ports. The outputs of the
        vehicle are (setups, p, output samples).

        Raises:
            InputError: The drive or a setup does not match the vehicle.
            StepError: The forces of a step do not converge, as the shocks are too stiff for it, or the motion grows.
        """
        model, ports = self.vehicle.state_space, tuple(self.vehicle.baseline_damping)
        if model.dt is not None:
            raise ParameterError(f"{model.name}: the model is discrete; setups are simulated with a continuous one")
        if unknown := [name for name in self.drive.names if name not in model.input_names]:
            raise InputError(f"the drive has {', '.join(unknown)}, which {model.name} does not have as inputs")
        chosen = np.asarray(setups, dtype=np.int64)
        if chosen.ndim != 2 or chosen.shape[1] != len(ports):
            raise InputError(f"each setup needs one shock for each of {', '.join(ports) or 'one port'}")
        values = self.drive.values - self.drive.values.mean(axis=1, keepdims=True)
        drive = TimeSeries(self.drive.time, values, self.drive.names, self.drive.units)
        without = {"gas_preload": 0.0}
        if not {channel(port, "displacement") for port in ports} <= set(model.output_names):
            without["gas_stiffness"] = 0.0
        laws = [replace(law, port=replace(law.port, **without)) for law in self.bank]
        try:
            return self._on_machine(drive, laws, chosen)
        except UnstableCarError as error:
            raise StepError(f"{model.name}: {error}") from error
        except (NotInBatchError, FmuError):  # FmuError: there is no compiler
            places = [dict(zip(ports, (laws[k] for k in row), strict=True)) for row in chosen.tolist()]
            return np.stack([port_by_port(self.vehicle, drive, at).values[:, :: self.every] for at in places])

    def _on_machine(self, drive: TimeSeries, laws: Sequence[ShockLaw], chosen: Integers) -> Array:
        model, count, baseline = self.vehicle.state_space, len(drive) - 1, self.vehicle.baseline_damping
        shocks = [ShockData.of_law(law_name(type(law)), law) for law in laws]
        damping = np.full(chosen.shape[1], np.median([shock.mean_slope(_USUAL_VELOCITY) for shock in shocks]))
        ports = [_port(model, port, self.vehicle.friction.get(port, Friction())) for port in baseline]
        whole = Vehicle(model.A, model.B, model.C, model.D, np.zeros(len(model.C)), at_rest=False)
        undamped = whole.with_dampers(ports, -np.array(list(baseline.values())))
        car = LinearCar.of(undamped, ports, damping, multiple=_MULTIPLE)
        inputs = np.zeros((count + 1, len(model.inputs)))
        inputs[:, [model.input_names.index(name) for name in drive.names]] = drive.values.T
        # Whole records end at a multiple of the interval between outputs; the rest of the drive has no output.
        times = np.arange(count // self.every * self.every + 1) / drive.sample_rate
        names = model.output_names
        places = {name: (-1, row) for row, name in enumerate(names)}
        run = Run(car, Drive(times, self.every, times, inputs[: times.size]), places, series=names)
        batch, outputs = Batch(run), np.empty((len(chosen), len(names), run.rows.size))
        for first in range(0, len(chosen), batch.lanes):
            several = slice(first, first + batch.lanes)
            result = batch.run([[shocks[place] for place in row] for row in chosen[several].tolist()])
            outputs[several] = result.values.transpose(2, 1, 0)
            # Whether the velocity of a port (C, n) still changes in the last sweeps; both are sums of squares.
            has_changed = (result.defect[0] > _LARGEST_CHANGE**2 * result.squares[0]).any()
            if (result.ended >= 0).any() or has_changed:
                raise StepError(
                    f"the shock forces do not converge with steps of {1.0 / drive.sample_rate:g} s; resample the drive "
                    "at a higher rate"
                )
        return outputs


def _port(model: StateSpace, port: str, law: Friction) -> Port:
    outputs, place = model.output_names, channel(port, "displacement")
    return Port(
        model.input_names.index(channel(port, "force")),
        outputs.index(channel(port, "velocity")),
        outputs.index(place) if place in outputs else None,
        _numbers(law),
    )


def with_dampers(vehicle: IdentifiedVehicle, drive: TimeSeries, damping: Mapping[str, float], every: int = 1) -> Array:
    """Return the outputs (p, N / every) of a continuous vehicle with linear dampers at all ports [N.s/m], from rest.

    The drive has no means; `force` of a port acts in addition to its damper. `every` is the interval of the output
    samples, in samples of the drive.

    Raises:
        StepError: The forces of a step do not converge.
    """
    car = around_dampers(vehicle, damping)
    outputs: Array = ManySetups(car, [_NO_SHOCK], drive, every).run([[0] * len(damping)])[0]
    return outputs


def around_dampers(vehicle: IdentifiedVehicle, damping: Mapping[str, float]) -> IdentifiedVehicle:
    """Return the vehicle with linear dampers at its ports; its inputs are the forces beyond them."""
    added = {port: rate - vehicle.baseline_damping.get(port, 0.0) for port, rate in damping.items()}
    model = add_port_damping(vehicle.state_space, added)
    return replace(vehicle, state_space=model, baseline_damping=dict.fromkeys(damping, 0.0))


# ==== Free-running simulation of rig tests  ==========================================================================

#: Rate of the simulation, at least [Hz].
_RATE = 1250.0


def free_running(vehicle: IdentifiedVehicle, record: TimeSeries, ports: Sequence[str]) -> TimeSeries:
    """Return the outputs of a continuous vehicle with the shocks of a test, at the times of the test, from rest.

    The shocks of the test are linear dampers c, its forces over its velocities, in the simulation, and the rest of
    their measured force, F - c v, as an input. Nothing else is fed back from the measurement.

    Raises:
        StepError: The forces of a step do not converge.
    """
    damping = {port: port_slope(record, port) for port in ports}
    inputs = {name: record[name] for name in vehicle.state_space.input_names if name in record}
    for port, rate in damping.items():
        inputs[channel(port, "force")] = record[channel(port, "force")] - rate * record[channel(port, "velocity")]
    drive, finer = _drive(record, inputs)
    return _series(vehicle.state_space, record.time, with_dampers(vehicle, drive, damping, finer))


def _drive(record: TimeSeries, inputs: Mapping[str, Array]) -> tuple[TimeSeries, int]:
    """Return inputs (N,) at the times of a record at a higher rate, and the ratio of the rates."""
    finer = max(1, int(np.ceil(_RATE / record.sample_rate - 1e-9)))
    time = np.arange(finer * (len(record) - 1) + 1) / (finer * record.sample_rate)
    fine = {name: (record.unit(name), _finer(values, finer)) for name, values in inputs.items()}
    return TimeSeries.from_channels(time, fine), finer


def _finer(values: Array, finer: int) -> Array:
    """Return values (finer (N - 1) + 1,) at a finer rate, about the straight line through the ends, without aliases."""
    count = values.size
    line = np.linspace(values[0], values[-1], count)
    padded = np.zeros(next_fast_len(count, real=True))
    padded[:count] = values - line
    fine = resample(padded, padded.size * finer)[: finer * (count - 1) + 1]
    return np.asarray(fine + np.linspace(values[0], values[-1], fine.size), dtype=np.float64)


#: Duration of the simulation that shows faults [s].
_SECONDS = 20.0

#: Dampers relative to the baseline that are tried, with the largest RMS of an output relative to that in the first
#: test [1]: this has the baseline dampers, and with 0.4 times the damping a car moves up to about twice as fast.
_LARGEST = {1.0: 1.5, 0.4: 6.0, 2.5: 6.0}


def fault_in_simulation(vehicle: IdentifiedVehicle, tests: Sequence[TimeSeries]) -> str | None:
    """Return why a continuous vehicle cannot be simulated with its port laws and other dampers; None if it can.

    The first of its tests, the baseline, drives it.
    """
    stability = closed_loop_stability(vehicle)
    if not stability.stable:
        return stability.summary()
    samples = round(_SECONDS * tests[0].sample_rate)
    test = tests[0].window(float(tests[0].time[0]), float(tests[0].time[min(samples, len(tests[0]) - 1)]))
    rig = [name for name in vehicle.state_space.input_names if quantity(name) != "force" and name in test]
    drive, finer = _drive(test, {name: test[name] for name in rig})
    names = vehicle.state_space.output_names
    measured = np.array([max(float(test[name].std()), 1e-300) for name in names])
    for part, largest in _LARGEST.items():
        dampers = {port: part * rate for port, rate in vehicle.baseline_damping.items()}
        try:
            size = with_dampers(vehicle, drive, dampers, finer).std(axis=1) / measured
        except EightpostError as error:
            return f"its simulation with {part:g} times the baseline damping fails: {error}"
        worst = int(np.argmax(np.where(np.isfinite(size), size, np.inf)))
        if not size[worst] <= largest:
            return (
                f"in its simulation with {part:g} times the baseline damping, the RMS of {names[worst]} is "
                f"{size[worst]:.3g} times that of the baseline test"
            )
    return None
