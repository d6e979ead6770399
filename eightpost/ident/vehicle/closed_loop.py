"""Free-running simulation of the rig tests that a vehicle was identified from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import resample

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.ident.vehicle.many_setups import around_dampers, with_dampers
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle, StateSpace


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
        closed = with_dampers(vehicle, drive, slopes, finer)
        kept = slice(self._first_sample(part), None)
        measured = np.stack([part[name] for name in vehicle.state_space.output_names])
        return _without_mean(closed[:, kept]), _without_mean(measured[:, kept])

    def closed(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[StateSpace, dict[str, float], TimeSeries]:
        """Return the model with the lines of a test's shocks, their slopes [N.s/m] by port, and the settled record."""
        part, slopes = self._part(vehicle, test)
        return (
            around_dampers(vehicle, slopes).state_space,
            slopes,
            _samples(part, slice(self._first_sample(part), None)),
        )

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
