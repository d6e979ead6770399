"""Response, coherence and energy of one input-output pair, as in Figs 6.9 to 6.18."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import beta

from eightpost.array_types import Array, Complex
from eightpost.ident.linearity.excitations import Excitation
from eightpost.ident.response.local_polynomial import LocalPolynomial
from eightpost.ident.response.records import Record, Records
from eightpost.vehicle.statespace import Channel

#: Length of the time response that is kept for plots [s] (Fig 6.9a).
SHOWN = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Response of an output to one input that moves alone."""

    test: str  #: Name of the test.
    input: Channel  #: Input channel.
    output: Channel  #: Output channel.
    frequency: Array  #: Frequencies at which the input has power (K,) [Hz].
    H: Complex  #: Frequency response (K,), output per input unit.
    coherence: Array  #: Coherence (K,) [1].
    variance: Array  #: Variance of H (K,), `E |H - E H|^2`.
    density: Array  #: Power spectral density of the output (K,) [unit2/Hz].
    input_density: Array  #: Power spectral density of the input (K,) [unit2/Hz].
    chance: float  #: Coherence that noise alone exceeds at 5 % of the frequencies [1].
    trace: Array  #: Part of the output for plots (T,).
    rate: float  #: Sample rate of the trace [Hz].

    @property
    def energy(self) -> float:
        """Power of the output over the input's band [unit2]."""
        return float(self.density.sum() * (self.frequency[1] - self.frequency[0]))

    @property
    def mean_coherence(self) -> float:
        """Fraction of the output's power that the input explains linearly [1]."""
        total = float(self.density.sum())
        return float(self.coherence @ self.density) / total if total > 0.0 else 0.0


def paths(excitation: Excitation, recipe: LocalPolynomial) -> tuple[Path, ...]:
    """Return the paths from one input to all outputs.

    They are estimated by local polynomials, because windowed blocks have leakage: with blocks of 4 s a linear quarter
    car has a coherence of 0.83.

    Args:
        excitation: Input and outputs.
        recipe: Estimator, with the width of its bands.

    Raises:
        TooShortError: The record has too few bins.
        TypeError: The recipe does not estimate the coherence.
    """
    record = Record(excitation.u[None], excitation.y)
    response = recipe.estimate(Records((record,), excitation.rate, (excitation.channel,), excitation.outputs))
    coherence, variance = response.coherence, response.variance
    if coherence is None or variance is None:
        raise TypeError(f"{recipe} does not estimate the coherence")
    active = np.isfinite(variance[0, 0])
    source = _density(excitation.u[None], excitation.rate, response.frequency)[0, active]
    densities = _density(excitation.y, excitation.rate, response.frequency)[:, active]
    middle = excitation.u.size // 2
    piece = slice(middle, middle + round(SHOWN * excitation.rate))
    chance = _chance(recipe, excitation.u.size / excitation.rate)
    return tuple(
        Path(
            excitation.test,
            excitation.channel,
            output,
            response.frequency[active],
            response.H[i, 0, active],
            coherence[i, active],
            variance[i, 0, active],
            densities[i],
            source,
            chance,
            excitation.y[i, piece],
            excitation.rate,
        )
        for i, output in enumerate(excitation.outputs)
    )


def _density(values: Array, rate: float, centres: Array) -> Array:
    """Return the power spectral density of values (C, N), averaged over the cells around `centres` (K,)."""
    size = values.shape[1]
    power = np.abs(np.fft.rfft(values)) ** 2 * (2.0 / (rate * size))
    lines = np.arange(power.shape[1]) * (rate / size)
    edges = np.concatenate((centres, [2.0 * centres[-1] - centres[-2]])) - 0.5 * (centres[1] - centres[0])
    starts = np.searchsorted(lines, edges)
    summed = np.concatenate((np.zeros((len(power), 1)), np.cumsum(power, axis=1)), axis=1)
    return np.asarray((summed[:, starts[1:]] - summed[:, starts[:-1]]) / np.diff(starts), dtype=np.float64)


def _chance(recipe: LocalPolynomial, duration: float) -> float:
    """Return the 95 % quantile of the coherence of pure noise, for B complex bins and P unknowns of the polynomials."""
    unknowns = 2 * (recipe.degree + 1)
    smallest = int(np.ceil((recipe.spare * unknowns - 1.0) / 2.0))
    bins = 2 * max(smallest, round((recipe.half_width or 0.0) * duration)) + 1
    left = float(beta.ppf(0.05, bins - unknowns, unknowns))
    return float(max(0.0, 1.0 - left * bins / (bins - unknowns)))
