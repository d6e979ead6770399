"""Uncertainty of a common-pole model due to noise, from models of responses with resampled noise.

Noise of the size of the estimate's is added to the response, and one refinement step moves the model to the new
optimum. The scatter of a quantity over these models, e.g. of a response or of a setup's measures, is its standard
deviation.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.threads import for_each
from eightpost.ident.vehicle.common_poles.common_pole_fit import CommonPoleModel, state_space
from eightpost.ident.vehicle.common_poles.refinement import Refinement

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from eightpost.vehicle import StateSpace

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

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
    """Return the standard deviation of |H| over sampled models (p, m, K)."""
    H = np.stack([model.frequency_response(frequency_hz) for model in models])
    return np.asarray(np.sqrt(np.mean(np.abs(H - H.mean(axis=0)) ** 2, axis=0) * len(models) / (len(models) - 1)))


def spread(models: tuple[StateSpace, ...], measures: Callable[[StateSpace], Array]) -> Array:
    """Return the standard deviation of measures over sampled models, in the shape of the measures."""
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
