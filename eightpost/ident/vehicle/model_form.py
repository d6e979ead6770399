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
from eightpost.ident.vehicle.residual_noise import HIGHEST, residual_noise, spectral_power
from eightpost.ident.vehicle.trust import OutputTrust
from eightpost.measure_uncertainty import TOTAL, MeasureUncertainty
from eightpost.progress import parts
from eightpost.signals import TimeSeries
from eightpost.vehicle import IdentifiedVehicle

#: Identifies a vehicle from some of the tests, given their indices.
Refit = Callable[[Sequence[int]], IdentifiedVehicle]

#: Smallest residual beyond noise relative to the residual [1]: its noise is not known better.
_SMALLEST = 0.1

#: Share of the power above the band below which a test does not show how well the model extrapolates [1]; the residual
#: there is then taken to be as large as the output.
_TOO_LITTLE = 1e-3

#: Relative residual of an output from which a simulation has diverged [1]; without any motion it would be 1.
_DIVERGED = 3.0

#: Smallest relative change of a shock's damping that counts as another shock [1].
_OTHER = 0.1


class Residual(NamedTuple):
    """Relative residual of each measure beyond noise [1] (q,) in the band of the model and above it.

    `share` is the share of each measure's power that is above the band [1] (q,).
    """

    inside: Array
    above: Array
    share: Array


class Shares(NamedTuple):
    """Parts of a residual that appear as a common error and, per unit of distance of two setups, as an own error."""

    common: float
    own: float


#: Shares in the band of the model and above it, of the standard deviation due to noise, and smallest errors
#: (docs/explanation/vehicle_uncertainty.md).
_INSIDE, _ABOVE, _NOISE, _LEAST = Shares(0.36, 0.68), Shares(0.045, 0.09), Shares(1.9, 2.25), Shares(0.0, 7e-4)


@dataclass(frozen=True, slots=True)
class ModelForm:
    """Uncertainty of measures from free-running simulations of the tests, some left out of the identification."""

    loop: ClosedLoop = field(default_factory=ClosedLoop)  #: Settings of the simulation.
    inside: Shares = _INSIDE  #: Parts of the residual in the band of the model that appear as errors of measures.
    above: Shares = _ABOVE  #: The same above the band, where the model is extrapolated.
    #: The same for the standard deviation due to noise, which is that of the tests' drive and linear dampers.
    noise: Shares = _NOISE
    least: Shares = _LEAST  #: Errors without any residual, of integration steps and laws at the ports.

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
        for k, test in parts(list(enumerate(tests))):
            others = [i for i in range(len(tests)) if i != k]
            residual = self._bounded(refit(others), test, band[1]) if refit is not None and k in left else None
            residual = residual or self._bounded(vehicle, test, band[1])
            if residual is None:
                return {}
            found.append(residual)
        inside, above = (np.sqrt(np.mean(np.square([getattr(one, part) for one in found]), axis=0))
                         for part in ("inside", "above"))  # fmt: skip
        residual = Residual(inside, above, np.mean([one.share for one in found], axis=0))
        deviations = [noise_of(name, outputs or {}) for name in names]
        return {n: self.of_residual(*row) for n, *row in zip(names, *residual, deviations, strict=True)}

    def _bounded(self, vehicle: IdentifiedVehicle, test: TimeSeries, high: float) -> Residual | None:
        """Return the residual of a test; None if the simulation diverges or does not converge."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                found = self.residual(vehicle, test, high)
        except StepError:
            return None
        return found if np.all(np.hypot(found.inside, found.above) < _DIVERGED) else None

    def residual(self, vehicle: IdentifiedVehicle, test: TimeSeries, high: float) -> Residual:
        """Return the residual of a test in and above the band of a model that ends at `high` [Hz].

        Frequencies that the decimation of records removes are left out.

        Raises:
            StepError: The simulation does not converge.
        """
        model, slopes, part = self.loop.closed(vehicle, test)
        sums = _sums(model.output_names)
        simulated, measured = (sums @ rows for rows in self.loop.outputs(vehicle, test))
        own, noise = residual_noise(model, part, slopes, sums)
        power, whole = spectral_power(measured), spectral_power(measured).sum(axis=1)
        error = spectral_power(simulated - measured)
        frequency = np.fft.rfftfreq(measured.shape[1], 1.0 / test.sample_rate)
        below, beyond = frequency <= high, (frequency > high) & (frequency <= HIGHEST * test.sample_rate)
        inside, above = (_beyond_noise(error[:, lines], noise[:, lines], whole) for lines in (below, beyond))
        share = np.clip((power[:, beyond].sum(axis=1) - own * beyond.sum()) / whole, 0.0, 1.0)
        return Residual(inside, above, share)

    def of_residual(self, inside: float, above: float, share: float, noise: float) -> MeasureUncertainty:
        """Return the uncertainty of a measure.

        Args:
            inside: Relative residual in the band of the model [1].
            above: Relative residual above the band [1].
            share: Share of the measure's power above the band [1].
            noise: Relative standard deviation of the measure due to noise [1].
        """
        extrapolated = above / math.sqrt(share) if share >= _TOO_LITTLE else 1.0
        common, own = (
            math.hypot(a * inside, b * extrapolated * math.sqrt(share), n * noise, least)
            for a, b, n, least in zip(self.inside, self.above, self.noise, self.least, strict=True)
        )
        beyond = Shares(self.above.common * extrapolated, self.above.own * extrapolated)
        return MeasureUncertainty(common, own, beyond.common, beyond.own, share)


def noise_of(name: str, outputs: Mapping[str, OutputTrust]) -> float:
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
    if len(tests) < 2:
        return ()
    slopes = np.array([[port_slope(test, port) for port in ports] for test in tests])
    others = [np.delete(slopes, k, axis=0) for k in range(len(tests))]
    return tuple(k for k, rest in enumerate(others) if np.all(np.ptp(rest, axis=0) > _OTHER * np.abs(rest).min(axis=0)))


def _tires(outputs: Sequence[str]) -> list[int]:
    return [k for k, name in enumerate(outputs) if quantity(name) == "tire_force"]


def _beyond_noise(error: Array, noise: Array, whole: Array) -> Array:
    """Return the amplitude beyond noise of errors (q, K), relative to that of the measures with power `whole` (q,)."""
    power = error.sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(power - noise.sum(axis=1), _SMALLEST**2 * power) / whole))


def _sums(outputs: Sequence[str]) -> Array:
    """Return the sums of outputs that are measures (q, p): each output, and the tire forces together."""
    tires = np.isin(np.arange(len(outputs)), _tires(outputs)).astype(np.float64)
    single = np.eye(len(outputs))
    return np.vstack([single, tires]) if tires.sum() > 1.0 else single
