"""Error of the form of a model, from free-running simulations of the rig tests.

The residual of a simulation beyond noise is what the model's form cannot represent. How much of it appears as an error
of an RMS measure on another drive was found on known cars (benchmarks/vehicle_uncertainty.py, tuning seeds).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from eightpost.array_types import Array
from eightpost.errors import StepError
from eightpost.ident.vehicle.closed_loop import ClosedLoop, port_slope
from eightpost.ident.vehicle.experiment import Experiment, quantity
from eightpost.ident.vehicle.trust import OutputTrust
from eightpost.measure_uncertainty import TOTAL, MeasureUncertainty
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle

#: Identifies a vehicle from some of the tests, given their indices.
Refit = Callable[[Sequence[int]], IdentifiedVehicle]

#: Width of the bands in which the floor of the residual's spectrum is sought [Hz].
_BAND = 2.0

#: Relative residual of an output from which a simulation has diverged [1]; without any motion it would be 1.
_DIVERGED = 3.0

#: Smallest relative change of a shock's damping that counts as another shock [1].
_OTHER = 0.1


class Residual(NamedTuple):
    """Relative residual of each output [1] (p,): in the band of the model beyond noise, and above the band."""

    inside: Array
    above: Array


class Shares(NamedTuple):
    """Parts of a residual that appear as a common error and, per unit of distance of two setups, as an own error."""

    common: float
    own: float


#: Shares in the band of the model and above it (docs/vehicle_uncertainty.md).
_INSIDE, _ABOVE = Shares(0.356, 0.827), Shares(0.061, 0.268)


@dataclass(frozen=True, slots=True)
class ModelForm:
    """Uncertainty of measures from free-running simulations of the tests, some of them left out of the identification.

    Attributes:
        loop: Settings of the simulation.
        inside: Parts of the residual in the band of the model that appear as errors of measures.
        above: The same above the band, where the model is extrapolated.
    """

    loop: ClosedLoop = field(default_factory=ClosedLoop)
    inside: Shares = _INSIDE
    above: Shares = _ABOVE

    def uncertainty(
        self,
        vehicle: IdentifiedVehicle,
        tests: Sequence[TimeSeries],
        experiment: Experiment,
        band: tuple[float, float],
        *,
        refit: Refit | None = None,
        outputs: Mapping[str, OutputTrust] | None = None,
    ) -> dict[str, MeasureUncertainty]:
        """Return the uncertainty of the RMS of every output, and of the sum of the tire forces.

        Args:
            vehicle: Vehicle identified from all tests.
            tests: Records of the tests.
            experiment: Ports of the tests.
            band: Lowest and highest frequency of the model's fit [Hz].
            refit: Function that identifies the vehicle from some of the tests. A test is left out if every port has
                two different shocks without it. None simulates all tests with `vehicle`.
            outputs: Uncertainty of the outputs due to noise.

        Returns:
            Uncertainties by measure; empty if the simulation of a test with `vehicle` diverges or does not converge. A
            vehicle without a test that cannot be simulated is replaced by `vehicle`.
        """
        names = measure_names(vehicle.state_space.output_names)
        left = () if refit is None else removable_tests(tests, experiment.ports)
        found = []
        for k, test in enumerate(tests):
            others = [i for i in range(len(tests)) if i != k]
            residual = self._bounded(refit(others), test, band[1]) if refit is not None and k in left else None
            residual = residual or self._bounded(vehicle, test, band[1])
            if residual is None:
                return {}
            found.append(residual)
        inside, above = (np.sqrt(np.mean(np.square(rows), axis=0)) for rows in zip(*found, strict=True))
        noise = [self.noise(name, outputs or {}) for name in names]
        return {n: self.of_residual(*row) for n, *row in zip(names, inside, above, noise, strict=True)}

    def _bounded(self, vehicle: IdentifiedVehicle, test: TimeSeries, high: float) -> Residual | None:
        """Return the residual of a test; None if the simulation diverges or does not converge."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                found = self.residual(vehicle, test, high)
        except StepError:
            return None
        return found if np.all(np.hypot(*found) < _DIVERGED) else None

    def residual(self, vehicle: IdentifiedVehicle, test: TimeSeries, high: float) -> Residual:
        """Return the residual of a test in and above the band of a model that ends at `high` [Hz].

        Raises:
            StepError: The simulation does not converge.
        """
        names = vehicle.state_space.output_names
        simulated, measured = (_with_total(names, rows) for rows in self.loop.outputs(vehicle, test))
        rows = np.abs(np.fft.rfft((simulated - measured) * np.hanning(measured.shape[1]), axis=1)) ** 2
        whole = (np.abs(np.fft.rfft(measured * np.hanning(measured.shape[1]), axis=1)) ** 2).sum(axis=1)
        frequency = np.fft.rfftfreq(measured.shape[1], 1.0 / test.sample_rate)
        in_band = frequency <= high
        beyond = np.maximum(rows[:, in_band].sum(axis=1) - in_band.sum() * _floor(rows, frequency[1]), 0.0)
        return Residual(np.sqrt(beyond / whole), np.sqrt(rows[:, ~in_band].sum(axis=1) / whole))

    def of_residual(self, inside: float, above: float, noise: float) -> MeasureUncertainty:
        """Return the uncertainty of a measure.

        Args:
            inside: Relative residual in the band of the model [1].
            above: Relative residual above the band [1].
            noise: Relative standard deviation of the measure due to noise [1].
        """
        common, own = (
            math.hypot(part * inside, other * above, noise) for part, other in zip(self.inside, self.above, strict=True)
        )
        return MeasureUncertainty(common, own)

    @staticmethod
    def noise(name: str, outputs: Mapping[str, OutputTrust]) -> float:
        """Return the relative standard deviation of a measure due to noise [1].

        The sum of the tire forces has that of the worst one.
        """
        if name == TOTAL:
            return max((one.measure for n, one in outputs.items() if quantity(n) == "tire_force"), default=0.0)
        return outputs[name].measure if name in outputs else 0.0


def measure_names(outputs: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the measures of outputs: the outputs, and the sum of the tire forces of several wheels."""
    return (*outputs, TOTAL) if len(_tires(outputs)) > 1 else tuple(outputs)


def removable_tests(tests: Sequence[TimeSeries], ports: Sequence[str]) -> tuple[int, ...]:
    """Return the indices of the tests without which every port still has two different shocks.

    With linear dampers, the effect of a port's force cannot be separated from tests that all have the same shock there.
    """
    slopes = np.array([[port_slope(test, port) for port in ports] for test in tests])
    others = [np.delete(slopes, k, axis=0) for k in range(len(tests))]
    return tuple(k for k, rest in enumerate(others) if np.all(np.ptp(rest, axis=0) > _OTHER * np.abs(rest).min(axis=0)))


def _tires(outputs: Sequence[str]) -> list[int]:
    return [k for k, name in enumerate(outputs) if quantity(name) == "tire_force"]


def _with_total(outputs: Sequence[str], rows: Array) -> Array:
    tires = _tires(outputs)
    return np.vstack([rows, rows[tires].sum(axis=0)]) if len(tires) > 1 else rows


def _floor(power: Array, spacing: float) -> Array:
    """Return the lowest mean of a power spectrum (p, K) over bands of 2 Hz (p,): white noise is not below it."""
    width = max(1, round(_BAND / spacing))
    count = power.shape[1] // width
    return np.asarray(power[:, : count * width].reshape(len(power), count, width).mean(axis=2).min(axis=1))
