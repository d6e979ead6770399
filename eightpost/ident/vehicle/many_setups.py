"""Setups of an identified vehicle on the machine, and free-running simulation of rig tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import resample

from eightpost.array_types import Array, Integers
from eightpost.corners import channel
from eightpost.errors import EightpostError, FmuError, InputError, ParameterError, StepError
from eightpost.ident.vehicle.experiment import quantity
from eightpost.ident.vehicle.simulation import port_by_port, port_numbers, ports_of, series_of
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.machine import Batch, Drive, LinearCar, NotInBatchError, Port, Run, ShockData, UnstableCarError, Vehicle
from eightpost.shock import Polylinear, ShockLaw, StaticCurve, law_name
from eightpost.signals import TimeSeries
from eightpost.vehicle import Friction, IdentifiedVehicle, StateSpace, add_port_damping

# ---- Many setups  ----------------------------------------------------------------------------------------------------

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

        Args:
            setups: Bank indices of the shocks of each setup, in the order of the vehicle's ports.

        Returns:
            Outputs of the vehicle (setups, p, output samples).

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
        own = {"gas_preload": 0.0}
        if not {channel(port, "displacement") for port in ports} <= set(model.output_names):
            own["gas_stiffness"] = 0.0
        laws = [replace(law, port=replace(law.port, **own)) for law in self.bank]
        try:
            return self._on_machine(drive, laws, chosen)
        except UnstableCarError as error:
            raise StepError(f"{model.name}: {error}") from error
        except (NotInBatchError, FmuError):  # FmuError: there is no compiler
            places = [dict(zip(ports, (laws[k] for k in row), strict=True)) for row in chosen.tolist()]
            return np.stack([port_by_port(self.vehicle, drive, own).values[:, :: self.every] for own in places])

    def _on_machine(self, drive: TimeSeries, laws: Sequence[ShockLaw], chosen: Integers) -> Array:
        model, count = self.vehicle.state_space, len(drive) - 1
        shocks = [ShockData.of_law(law_name(type(law)), law) for law in laws]
        damping = np.full(chosen.shape[1], np.median([shock.mean_slope(_USUAL_VELOCITY) for shock in shocks]))
        vehicle, ports = _open(self.vehicle)
        car = LinearCar.of(vehicle, ports, damping, multiple=_MULTIPLE)
        inputs = np.zeros((count + 1, len(model.inputs)))
        inputs[:, [model.input_names.index(name) for name in drive.names]] = drive.values.T
        # Whole records end at a multiple of the interval between outputs; the rest of the drive has no output.
        times = np.arange(count // self.every * self.every + 1) / drive.sample_rate
        names = model.output_names
        run = Run(
            car,
            Drive(times, self.every, times, inputs[: times.size]),
            {name: (-1, row) for row, name in enumerate(names)},
            series=names,
        )
        batch, found = Batch(run), np.empty((len(chosen), len(names), run.rows.size))
        for first in range(0, len(chosen), batch.lanes):
            several = slice(first, first + batch.lanes)
            result = batch.run([[shocks[place] for place in row] for row in chosen[several].tolist()])
            found[several] = result.values.transpose(2, 1, 0)
            if (result.ended >= 0).any() or _has_changed(result.defect[0], result.squares[0]):
                raise StepError(
                    f"the shock forces do not converge with steps of {1.0 / drive.sample_rate:g} s; resample the drive "
                    "at a higher rate"
                )
        return found


def with_dampers(vehicle: IdentifiedVehicle, drive: TimeSeries, damping: Mapping[str, float], every: int = 1) -> Array:
    """Return the outputs (p, N / every) of a vehicle with linear dampers, from rest.

    Args:
        vehicle: Continuous vehicle with friction and springs at its ports.
        drive: Inputs of the vehicle without means; `force` of a port acts in addition to its damper.
        damping: Damping of every port [N.s/m].
        every: Interval of the output samples, in samples of the drive.

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


def closed_at_ports(vehicle: IdentifiedVehicle, record: TimeSeries, laws: Mapping[str, ShockLaw]) -> TimeSeries:
    """Return the vehicle's outputs with shock laws at its ports, under a record's roads and loads, from rest.

    Args:
        vehicle: Identified vehicle, with the friction at its ports.
        record: Record without means.
        laws: Shock law of every port.
    """
    model, forces = vehicle.state_space, {channel(port, "force") for port in ports_of(vehicle.state_space)}
    drive = record.select(n for n in model.input_names if n in record and n not in forces)
    if model.dt is None and set(vehicle.baseline_damping) == set(laws):
        bank = [laws[port] for port in vehicle.baseline_damping]
        return series_of(model, record.time, ManySetups(vehicle, bank, drive).run([range(len(bank))])[0])
    return port_by_port(vehicle, drive, laws)


def _open(vehicle: IdentifiedVehicle) -> tuple[Vehicle, list[Port]]:
    """Return the vehicle without its baseline dampers, and its ports."""
    model = vehicle.state_space
    ports = [_port(model, port, vehicle.friction.get(port, Friction())) for port in vehicle.baseline_damping]
    whole = Vehicle(model.A, model.B, model.C, model.D, np.zeros(len(model.C)), at_rest=False)
    return whole.with_dampers(ports, -np.array(list(vehicle.baseline_damping.values()))), ports


def _port(model: StateSpace, port: str, law: Friction) -> Port:
    outputs, place = model.output_names, channel(port, "displacement")
    return Port(
        model.input_names.index(channel(port, "force")),
        outputs.index(channel(port, "velocity")),
        outputs.index(place) if place in outputs else None,
        port_numbers(law),
    )


def _has_changed(changes: Array, squares: Array) -> bool:
    """Whether the velocity of a port (C, n) still changes in the last sweeps; both are sums of squares."""
    return bool((changes > _LARGEST_CHANGE**2 * squares).any())


# ---- Free-running simulation of rig tests  ---------------------------------------------------------------------------

#: Rate of the simulation, at least [Hz].
_RATE = 1250.0


def free_running(vehicle: IdentifiedVehicle, record: TimeSeries, ports: Sequence[str]) -> TimeSeries:
    """Return the outputs of a vehicle with the shocks of a test, at the times of the test, from rest.

    The shocks of the test are linear dampers c, its forces over its velocities, in the simulation, and the rest of
    their measured force, F - c v, as an input. Nothing else is fed back from the measurement.

    Args:
        vehicle: Continuous vehicle with friction and springs at its ports.
        record: Evenly sampled test.
        ports: Ports of the vehicle.

    Raises:
        StepError: The forces of a step do not converge.
    """
    damping = {port: port_slope(record, port) for port in ports}
    inputs = {name: record[name] for name in vehicle.state_space.input_names if name in record}
    for port, rate in damping.items():
        inputs[channel(port, "force")] = record[channel(port, "force")] - rate * record[channel(port, "velocity")]
    drive, finer = _drive(record, inputs)
    return series_of(vehicle.state_space, record.time, with_dampers(vehicle, drive, damping, finer))


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


def port_slope(record: TimeSeries, port: str) -> float:
    """Return the slope of a port's measured force over its measured velocity [N.s/m]."""
    v, force = (record[channel(port, name)] - record[channel(port, name)].mean() for name in ("velocity", "force"))
    return float(v @ force / (v @ v))


# ---- Faults that appear with other shocks only ----------------------------------------------------------------------

#: Duration of the simulation [s].
_SECONDS = 20.0

#: Dampers relative to the baseline that are tried, with the largest RMS of an output relative to that in the first
#: test [1]: this has the baseline dampers, and with 0.4 times the damping a car moves up to about twice as fast.
_LARGEST = {1.0: 1.5, 0.4: 6.0, 2.5: 6.0}


def fault_in_simulation(vehicle: IdentifiedVehicle, tests: Sequence[TimeSeries]) -> str | None:
    """Return why a vehicle cannot be simulated with its port laws and other dampers; None if it can.

    Args:
        vehicle: Continuous vehicle with friction and springs at its ports.
        tests: Records of its tests, the baseline first, which drives it.
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
