"""Free-running simulation of rig tests: those that a vehicle was identified from, and those that judge it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import next_fast_len
from scipy.signal import resample

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import EightpostError
from eightpost.ident.vehicle.experiment import quantity
from eightpost.ident.vehicle.many_setups import ManySetups
from eightpost.ident.vehicle.stability import closed_loop_stability
from eightpost.shock.curve import KNOTS, StaticCurve
from eightpost.shock.polylinear import Polylinear
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle, StateSpace, add_port_damping

# ==== Tests of the identification, with their own shocks in the loop =================================================


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """Simulation of a test with its own shocks in the loop.

    The shock force of the test is split into a line and a rest: F = c v + (F - c v), where c is the slope of the
    measured force over the measured velocity. The line follows the simulated velocity, and the rest is an input. For
    linear dampers nothing but the rig drives the simulation; friction at the ports always follows the simulation.
    """

    seconds: float = 60.0  #: Longest part of a test that is simulated, from its start [s].
    settling: float = 4.0  #: Time at the start that is left out, because the simulation starts at rest [s].
    rate: float = 1000.0  #: Minimum sample rate of the simulation [Hz].

    def outputs(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[Array, Array]:
        """Return the simulated and the measured outputs of a test (p, N), without means, in the model's order.

        Args:
            vehicle: Continuous vehicle.
            test: Record with the velocity and force of every port and the outputs; missing inputs of the rig are zero.

        Raises:
            StepError: The simulation does not converge.
        """
        part, slopes = self._part(vehicle, test)
        ports = tuple(slopes)
        forces = tuple(channel(port, "force") for port in ports)
        names = [n for n in vehicle.state_space.input_names if n in part and n not in forces]
        rows = [part[name] for name in names]
        rest = [part[force] - slopes[p] * part[channel(p, "velocity")] for p, force in zip(ports, forces, strict=True)]
        finer = max(1, int(np.ceil(self.rate / part.sample_rate)))
        values = resample(np.stack([*rows, *rest]), finer * len(part), axis=1)
        units = (*(part.unit(name) for name in names), *("N",) * len(ports))
        time = np.arange(values.shape[1]) / (finer * part.sample_rate)
        drive = TimeSeries(time, values, (*names, *forces), units)
        closed = ManySetups(_around(vehicle, slopes), (_NO_SHOCK,), drive, finer).run([[0] * len(ports)])[0]
        kept = slice(self._first_sample(part), None)
        measured = np.stack([part[name] for name in vehicle.state_space.output_names])
        return _without_mean(closed[:, kept]), _without_mean(measured[:, kept])

    def closed(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[StateSpace, dict[str, float], TimeSeries]:
        """Return the model with the lines of a test's shocks, their slopes [N.s/m] by port, and the settled record."""
        part, slopes = self._part(vehicle, test)
        return _around(vehicle, slopes).state_space, slopes, _samples(part, slice(self._first_sample(part), None))

    def _part(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[TimeSeries, dict[str, float]]:
        part = _samples(test, slice(0, round(self.seconds * test.sample_rate)))
        return part, {port: port_slope(part, port) for port in vehicle.baseline_damping}

    def _first_sample(self, test: TimeSeries) -> int:
        return round(self.settling * test.sample_rate)


def _samples(test: TimeSeries, samples: slice) -> TimeSeries:
    return TimeSeries(test.time[samples], test.values[:, samples], test.names, test.units)


def port_slope(test: TimeSeries, port: str) -> float:
    """Return the slope of a port's measured force over its measured velocity [N.s/m]."""
    v, force = (_without_mean(test[channel(port, quantity)]) for quantity in ("velocity", "force"))
    return float(v @ force / (v @ v))


def _without_mean(values: Array) -> Array:
    return np.asarray(values - values.mean(axis=-1, keepdims=True))


def _around(vehicle: IdentifiedVehicle, slopes: Mapping[str, float]) -> IdentifiedVehicle:
    """Return the vehicle with linear dampers at its ports; its inputs are the forces beyond them."""
    more = {port: slopes[port] - rate for port, rate in vehicle.baseline_damping.items()}
    model = add_port_damping(vehicle.state_space, more)
    return replace(vehicle, state_space=model, baseline_damping=dict.fromkeys(slopes, 0.0))


_PLACES = tuple(float(k - KNOTS // 2) for k in range(KNOTS))
_NO_SHOCK = Polylinear(curve=StaticCurve.through_knots(_PLACES, (0.0,) * KNOTS, (0.0,) * KNOTS))


# ==== A vehicle judged against a test, and checked for faults ========================================================

#: Rate of the simulation, at least [Hz].
_RATE = 1250.0

#: Law without force: the dampers are part of the model.
_NOTHING = Polylinear(StaticCurve((0.0,) * 15, (0.0,) * 4, (0.0,) * 4, 0.1, 0.01, 1.0, 1.0, 0.0, 0.0))


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
    added = {port: rate - vehicle.baseline_damping.get(port, 0.0) for port, rate in damping.items()}
    model = add_port_damping(vehicle.state_space, added)
    car = replace(vehicle, state_space=model, baseline_damping=dict.fromkeys(damping, 0.0))
    outputs: Array = ManySetups(car, [_NOTHING], drive, every).run([[0] * len(damping)])[0]
    return outputs


def free_running(vehicle: IdentifiedVehicle, record: TimeSeries, ports: Sequence[str]) -> TimeSeries:
    """Return the outputs of a vehicle with the shocks of a test, at the times of the test, from rest.

    The shocks of the test are linear dampers c, its forces over its velocities, in the simulation, and the rest of
    their measured force, F - c v, as an input. Nothing else is fed back from the measurement.

    Args:
        vehicle: Continuous vehicle with friction and springs at its ports.
        record: Evenly sampled test without means.
        ports: Ports of the vehicle.

    Raises:
        StepError: The forces of a step do not converge.
    """
    damping = {port: _slope(record, port) for port in ports}
    finer = max(1, int(np.ceil(_RATE / record.sample_rate - 1e-9)))
    channels = {}
    for name in vehicle.state_space.input_names:
        if name not in record:
            continue
        values = record[name]
        if (port := name.removesuffix("force").rstrip(".")) in damping and quantity(name) == "force":
            values = values - damping[port] * record[channel(port, "velocity")]
        channels[name] = (record.unit(name), _finer(values, finer))
    count = finer * (len(record) - 1) + 1
    time = np.arange(count) / (finer * record.sample_rate)
    outputs = with_dampers(vehicle, TimeSeries.from_channels(time, channels), damping, finer)
    names = {c.name: (c.unit, row) for c, row in zip(vehicle.state_space.outputs, outputs, strict=True)}
    return TimeSeries.from_channels(record.time[: outputs.shape[1]], names)


def _finer(values: Array, finer: int) -> Array:
    """Return values (finer (N - 1) + 1,) at a finer rate, about the straight line through the ends, without aliases."""
    count = values.size
    line = np.linspace(values[0], values[-1], count)
    padded = np.zeros(next_fast_len(count, real=True))
    padded[:count] = values - line
    fine = resample(padded, padded.size * finer)[: finer * (count - 1) + 1]
    return np.asarray(fine + np.linspace(values[0], values[-1], fine.size), dtype=np.float64)


def _slope(record: TimeSeries, port: str) -> float:
    v, force = (record[channel(port, name)] for name in ("velocity", "force"))
    v = v - v.mean()
    return float(np.sum(v * (force - force.mean())) / np.sum(v**2))


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
    drive, finer = _rig_drive(vehicle, test)
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


def _rig_drive(vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[TimeSeries, int]:
    """Return the inputs of the rig without means at a higher rate, and the ratio of the rates."""
    rig = [name for name in vehicle.state_space.input_names if quantity(name) != "force" and name in test]
    finer = max(1, int(np.ceil(_RATE / test.sample_rate - 1e-9)))
    drive = {name: (test.unit(name), _finer(test[name] - test[name].mean(), finer)) for name in rig}
    time = np.arange(finer * (len(test) - 1) + 1) / (finer * test.sample_rate)
    return TimeSeries.from_channels(time, drive), finer
