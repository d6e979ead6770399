"""Errors of a vehicle on rig tests that it was not identified from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.vehicle.experiment import Experiment
from eightpost.ident.vehicle.free_running import free_running
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle

#: Time at the start of a simulation that is not judged, as it starts from rest [s].
_SETTLING = 3.0


@dataclass(frozen=True, slots=True)
class HeldOutError:
    """Errors of free-running simulations of tests."""

    #: RMS of simulated minus measured output over that of the measured one, in the band [1], by output.
    error: Mapping[str, float]
    #: RMS of the simulated over that of the measured output, minus one, in the band [1], by output.
    level: Mapping[str, float]

    @property
    def mean_error(self) -> float:
        """Root mean square of the outputs' errors [1]."""
        return float(np.sqrt(np.mean(np.square(list(self.error.values())))))

    @property
    def mean_level(self) -> float:
        """Root mean square of the outputs' level errors [1]."""
        return float(np.sqrt(np.mean(np.square(list(self.level.values())))))


def held_out_error(
    vehicle: IdentifiedVehicle, tests: Sequence[TimeSeries], experiment: Experiment, band: tuple[float, float]
) -> HeldOutError:
    """Return the errors of a vehicle on tests, with the shocks of each test.

    Args:
        vehicle: Identified vehicle.
        tests: Records without means, which the vehicle was not identified from.
        experiment: Outputs and ports of the tests.
        band: Lowest and highest frequency that is judged [Hz].

    Raises:
        StepError: A simulation does not converge.
    """
    power = np.zeros((3, len(experiment.outputs)))
    for test in tests:
        simulated = free_running(vehicle, test, experiment.ports)
        for k, name in enumerate(experiment.outputs):
            found, right = (_lines(rows, test.sample_rate, band) for rows in (simulated[name], test[name]))
            power[:, k] += [np.sum(np.abs(x) ** 2) for x in (found - right, found, right)]
    whole = np.maximum(power[2], 1e-300)
    error, level = np.sqrt(power[0] / whole), np.sqrt(power[1] / whole) - 1.0
    return HeldOutError(*(dict(zip(experiment.outputs, row.tolist(), strict=True)) for row in (error, level)))


def _lines(values: Array, rate: float, band: tuple[float, float]) -> Array:
    """Return the spectral lines of a signal (N,) in a band, without its first seconds."""
    settled = values[round(_SETTLING * rate) :]
    lines = np.fft.rfft((settled - settled.mean()) * np.hanning(settled.size))
    frequency = np.fft.rfftfreq(settled.size, 1.0 / rate)
    return np.asarray(lines[(frequency >= band[0]) & (frequency <= band[1])])
