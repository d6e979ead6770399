"""Standard deviations of a model and of its responses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from eightpost.array_types import Array, Complex
from eightpost.ident.response import FrequencyResponse
from eightpost.ident.threads import for_each
from eightpost.ident.vehicle.common_poles.common_pole_fit import CommonPoleModel, state_space
from eightpost.ident.vehicle.common_poles.refinement import Refinement, integrals
from eightpost.ident.vehicle.experiment import Experiment, lifted_tires
from eightpost.ident.vehicle.trust import OutputTrust
from eightpost.signals import TimeSeries
from eightpost.vehicle import StateSpace, add_port_damping

# ---- Uncertainty of a common-pole model due to noise, from models of responses with resampled noise -----------------

#: Correlation below which values count as uncorrelated [1].
_UNCORRELATED = 0.1


def sampled_models(found: CommonPoleModel, count: int = 20, *, seed: int = 0) -> tuple[StateSpace, ...]:
    """Return models of the response with resampled noise.

    Args:
        found: Common-pole model.
        count: Number of models.
        seed: Seed of the noise generator.
    """
    generator, length = np.random.default_rng(seed), correlation_length(found.refined.solution.misfit)
    drawn = [_noise(found, generator, length) for _ in range(count)]
    return tuple(for_each(drawn, lambda noise: _sampled(found, noise)))


def response_deviation(models: tuple[StateSpace, ...], frequency_hz: ArrayLike) -> Array:
    """Return the standard deviation of |H| over sampled models (p, m, K) at `frequency_hz` (K,) [Hz]."""
    H = np.stack([model.frequency_response(frequency_hz) for model in models])
    return np.asarray(np.sqrt(np.mean(np.abs(H - H.mean(axis=0)) ** 2, axis=0) * len(models) / (len(models) - 1)))


def spread(models: tuple[StateSpace, ...], measures: Callable[[StateSpace], Array]) -> Array:
    """Return the standard deviation of measures over sampled models, in the shape of the measures.

    Args:
        models: Sampled models.
        measures: Function that returns the measures of a model, an array of any shape (...,).

    Returns:
        Standard deviations (...,) in the units of the measures.
    """
    return np.asarray(np.std(np.stack([measures(model) for model in models]), axis=0, ddof=1))


def correlation_length(misfit: Complex) -> int:
    """Return the number of frequencies over which the misfit (p, m, K) is correlated, as bands may overlap."""
    power = float(np.mean(np.abs(misfit) ** 2))
    for lag in range(1, misfit.shape[2]):
        correlation = float(np.mean((misfit[..., lag:] * misfit[..., :-lag].conj()).real)) / max(power, 1e-300)
        if correlation < _UNCORRELATED:
            return lag
    return int(misfit.shape[2])


def _noise(found: CommonPoleModel, generator: np.random.Generator, length: int) -> Complex:
    """Return noise of standard deviation 1 (p, m, K), correlated over `length` neighbouring frequencies."""
    points = found.points
    white = generator.standard_normal((2, *points.H.shape[:2], points.s.size + length - 1)) * np.sqrt(0.5)
    window = np.lib.stride_tricks.sliding_window_view(white[0] + 1j * white[1], length, axis=2)
    return np.asarray(window.sum(axis=3) / np.sqrt(length))


def _sampled(found: CommonPoleModel, noise: Complex) -> StateSpace:
    points, solution = found.points, found.refined.solution
    noisy = replace(points, H=points.H + np.where(points.known, points.deviation, 0.0) * noise)
    refined = Refinement(max_iterations=1).refine(noisy, solution.blocks, solution.through)
    return state_space(refined.solution, noisy, found.inputs, found.fitted, found.model.outputs)


# ---- Uncertainty due to noise of each output of a common-pole model -------------------------------------------------

#: Linear dampers with which the RMS of an output is evaluated, relative to the baseline damping [1].
DAMPERS = (0.5, 1.0, 2.0)

#: Duration of the first test that is used as the drive [s], and number of frequencies for comparing responses.
_SECONDS, _FREQUENCIES = 60.0, 100


@dataclass(frozen=True, slots=True, eq=False)
class Excitation:
    """Spectra of the inputs that drove a test."""

    names: tuple[str, ...]  #: Names of the r rig inputs.
    frequency: Array  #: Frequencies [Hz] (K,).
    spectra: Complex  #: Spectra of the inputs (r, K).

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
    response, measure = relative_deviations(found.model, models, tests[0], experiment, found.band)
    trusts = {}
    for k, name in enumerate(found.model.output_names):
        misfit = _misfit(found, name)
        times = max(misfit, 1.0)
        left = with_friction.get(name)
        trusts[name] = OutputTrust(
            float(response[k] * times), float(measure[k] * times), misfit, None if left is None else float(left**0.5)
        )
    return trusts


def relative_deviations(
    model: StateSpace,
    models: tuple[StateSpace, ...],
    test: TimeSeries,
    experiment: Experiment,
    band: tuple[float, float],
) -> tuple[Array, Array]:
    """Return the relative standard deviations over sampled models of each output's responses (p,) and RMS (p,).

    Args:
        model: Model.
        models: Models that noise could have given instead.
        test: Test that drives the setups.
        experiment: Rig inputs and baseline damping.
        band: Lowest and highest frequency of the fit [Hz].
    """
    frequency = np.geomspace(*band, _FREQUENCIES)
    response = _relative(response_deviation(models, frequency), np.abs(model.frequency_response(frequency)))
    drive = Excitation.of(test, experiment.rig, band)
    sizes = drive.rms(model, experiment.baseline_damping)
    scatter = spread(models, lambda one: drive.rms(one, experiment.baseline_damping))
    return response, np.asarray((scatter / np.maximum(sizes, 1e-300)).max(axis=0))


def _misfit(found: CommonPoleModel, name: str) -> float:
    """Return an output's misfit in standard deviations; displacements are not fitted and have that of the velocity."""
    return found.excess[integrals(found.model.output_names).get(name, name)]


def _relative(deviation: Array, size: Array) -> Array:
    """Return the relative standard deviation of each output's responses (p,); all inputs have equal weight."""
    whole = np.maximum(np.mean(size**2, axis=2), 1e-300)
    return np.asarray(np.sqrt(np.mean(np.mean(deviation**2, axis=2) / whole, axis=1)))


# ---- Effects in the car that a model does not have ------------------------------------------------------------------

#: Misfit, in standard deviations of the estimate, above which it is reported as more than noise [1].
EXCESS = 1.5

#: Unexplained part of an output above which it is reported, and coherence above which it is good [1].
_NOISY, _FINE = 0.05, 0.95


def unmodelled(
    response: FrequencyResponse, found: CommonPoleModel, tests: Sequence[TimeSeries], means: Mapping[str, float]
) -> dict[str, str]:
    """Return one sentence for each sign of an effect that is not in the model, by kind of effect.

    Args:
        response: Response that was fitted.
        found: Common-pole model.
        tests: Records of the tests, without means.
        means: Mean tire forces that the original records had [N], by channel.
    """
    sentences = {
        "misfit": _misfits(found),
        "lift-off": _lifted(tests, means),
        "unexplained": _coherence(response, found),
    }
    return {what: sentence for what, sentence in sentences.items() if sentence}


def _misfits(found: CommonPoleModel) -> str:
    worst: dict[str, float] = {}
    for name, value in found.excess.items():
        quantity = name.rpartition(".")[2]
        worst[quantity] = max(value, worst.get(quantity, 0.0))
    listed = ", ".join(f"{quantity} {value:.1f}" for quantity, value in worst.items() if value > EXCESS)
    if not listed:
        return ""
    return (
        f"The misfit is larger than noise (in standard deviations, worst of each: {listed}). Likely causes are "
        "nonlinear effects, above all stick-slip, or too few states. The reported standard deviations are increased "
        "accordingly."
    )


def _lifted(tests: Sequence[TimeSeries], means: Mapping[str, float]) -> str:
    names = sorted(lifted_tires(tests, means))
    if not names:
        return ""
    return (
        f"Tires leave the ground ({', '.join(names)}), which the linear model cannot represent; lower the road's peak."
    )


def _coherence(response: FrequencyResponse, found: CommonPoleModel) -> str:
    """Return a sentence on outputs that are noisy although their coherence is good: a sign of friction or springs."""
    if response.coherence is None:
        return ""
    low, high = found.band
    inside = (response.frequency >= low) & (response.frequency <= high)
    left = np.sqrt(1.0 - np.median(response.coherence[:, inside], axis=1))
    names = [
        f"{name} {100.0 * share:.0f} %"
        for name, share in zip(response.output_names, left, strict=True)
        if _NOISY < share < np.sqrt(1.0 - _FINE**2)
    ]
    if not names:
        return ""
    return (
        f"Not explained by any linear response although coherence is good: {', '.join(names)} of the output. If the "
        "sensors are less noisy than that, the cause is friction or nonlinear springs."
    )
