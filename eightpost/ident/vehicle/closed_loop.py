"""Free-running simulation of the rig tests that a vehicle was identified from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.vehicle.free_running import free_running, port_slope
from eightpost.ident.vehicle.many_setups import around_dampers
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle, StateSpace


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """Simulation of a test with its own shocks in the loop.

    For linear dampers nothing but the rig drives the simulation; friction at the ports always follows the simulation.
    """

    seconds: float = 60.0  #: Longest part of a test that is simulated, from its start [s].
    settling: float = 4.0  #: Time at the start that is left out, because the simulation starts at rest [s].

    def outputs(self, vehicle: IdentifiedVehicle, test: TimeSeries) -> tuple[Array, Array]:
        """Return the simulated and the measured outputs of a test (p, N), without means, in the model's order.

        Args:
            vehicle: Continuous vehicle.
            test: Record with the velocity and force of every port and the outputs; missing inputs of the rig are zero.

        Raises:
            StepError: The simulation does not converge.
        """
        part, slopes = self._part(vehicle, test)
        simulated = free_running(vehicle, part, tuple(slopes))
        kept = slice(self._first_sample(part), None)
        both = (np.stack([one[n] for n in vehicle.state_space.output_names])[:, kept] for one in (simulated, part))
        found, measured = (rows - rows.mean(axis=1, keepdims=True) for rows in both)
        return found, measured

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
