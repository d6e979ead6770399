"""Uncertainty due to noise of each output of a common-pole model: of its responses, and of its RMS in a setup."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.vehicle.common_poles.physics import integrals
from eightpost.ident.vehicle.common_poles.uncertainty import response_deviation, sampled_models, spread
from eightpost.ident.vehicle.trust import OutputTrust
from eightpost.vehicle import add_port_damping

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from eightpost.ident.vehicle.common_poles.common_pole_fit import CommonPoleModel
    from eightpost.ident.vehicle.experiment import Experiment
    from eightpost.signals import TimeSeries
    from eightpost.vehicle import StateSpace

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

#: Linear dampers with which the RMS of an output is evaluated, relative to the baseline damping [1].
DAMPERS = (0.5, 1.0, 2.0)

#: Duration of the first test that is used as the drive [s], and number of frequencies for comparing responses.
_SECONDS, _FREQUENCIES = 60.0, 100


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """Spectra of the inputs that drove a test.

    Attributes:
        names: Names of the r rig inputs.
        frequency: Frequencies [Hz] (K,).
        spectra: Spectra of the inputs (r, K).
    """

    names: tuple[str, ...]
    frequency: Array
    spectra: Complex

    @classmethod
    def of(cls, test: TimeSeries, names: Sequence[str], band: tuple[float, float]) -> Excitation:
        """Return the spectra of the first minute of a record in a band [Hz]."""
        rows = np.stack([test[name] for name in names])[:, : round(_SECONDS * test.sample_rate)]
        rows = (rows - rows.mean(axis=1, keepdims=True)) * np.hanning(rows.shape[1])
        frequency = np.fft.rfftfreq(rows.shape[1], 1.0 / test.sample_rate)
        kept = (frequency >= band[0]) & (frequency <= band[1])
        spectra = np.asarray(np.fft.rfft(rows, axis=1)[:, kept], dtype=np.complex128)
        return cls(tuple(names), np.asarray(frequency[kept], dtype=np.float64), spectra)

    def rms(self, model: StateSpace, baseline: Mapping[str, float]) -> Array:
        """Return values proportional to the outputs' RMS with each of `DAMPERS` at all ports (3, p)."""
        rows = []
        for part in DAMPERS:
            closed = add_port_damping(model, {port: (part - 1.0) * rate for port, rate in baseline.items()})
            H = closed.select(inputs=self.names).frequency_response(self.frequency)
            rows.append(np.linalg.norm(np.einsum("prk,rk->pk", H, self.spectra), axis=1))
        return np.array(rows)


def output_trust(
    found: CommonPoleModel,
    tests: Sequence[TimeSeries],
    experiment: Experiment,
    *,
    samples: int,
    with_friction: Mapping[str, float],
) -> dict[str, OutputTrust]:
    """Return the uncertainty of every output.

    The standard deviations due to noise are multiplied by the misfit where it is larger than noise explains.

    Args:
        found: Common-pole model.
        tests: Records of the tests; the first one drives the setups.
        experiment: Rig inputs and baseline damping.
        samples: Number of models with resampled noise that give the standard deviations; at least 2.
        with_friction: Mean square of the part that no linear response explains, with friction relative to without, by
            output.
    """
    models = sampled_models(found, samples)
    frequency = np.geomspace(*found.band, _FREQUENCIES)
    whole = np.abs(found.model.frequency_response(frequency))
    response = _relative(response_deviation(models, frequency), whole)
    drive = Excitation.of(tests[0], experiment.rig, found.band)
    sizes = drive.rms(found.model, experiment.baseline_damping)
    scatter = spread(models, lambda model: drive.rms(model, experiment.baseline_damping))
    measure = (scatter / np.maximum(sizes, 1e-300)).max(axis=0)
    trusts = {}
    for k, name in enumerate(found.model.output_names):
        misfit = _misfit(found, name)
        times = max(misfit, 1.0)
        left = with_friction.get(name)
        trusts[name] = OutputTrust(
            float(response[k] * times), float(measure[k] * times), misfit, None if left is None else float(left**0.5)
        )
    return trusts


def _misfit(found: CommonPoleModel, name: str) -> float:
    """Return an output's misfit in standard deviations; displacements are not fitted and have that of the velocity."""
    return found.excess[integrals(found.model.output_names).get(name, name)]


def _relative(deviation: Array, size: Array) -> Array:
    """Return the relative standard deviation of each output's responses (p,); all inputs have equal weight."""
    whole = np.maximum(np.mean(size**2, axis=2), 1e-300)
    return np.asarray(np.sqrt(np.mean(np.mean(deviation**2, axis=2) / whole, axis=1)))
