"""One input-output pair: its response, coherence and energy, as Figs 6.9 to 6.18 show them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.stats import beta

from eightpost.ident.response.records import Record, Records

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from eightpost.ident.response.local_polynomial import LocalPolynomial
    from eightpost.vehicle.statespace import Channel

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

#: Length of time response that is kept for pictures [s] (Fig 6.9a).
SHOWN = 2.0


class Excitation(NamedTuple):
    """One input alone and what the outputs did.

    Attributes:
        test: What the test is called.
        channel: The input.
        u: (N,).
        y: (p, N).
        outputs: The p outputs.
        rate: Samples per second [Hz].
    """

    test: str
    channel: Channel
    u: Array
    y: Array
    outputs: tuple[Channel, ...]
    rate: float


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """An output's answer to one input that moves alone.

    Attributes:
        test: What the test is called.
        input: The input.
        output: The output.
        frequency: (K,) [Hz], where the input has power.
        H: Frequency response (K,), output per input unit.
        coherence: (K,) [1].
        variance: Of H (K,), `E |H - E H|^2`.
        density: Power spectral density of the output (K,) [unit2/Hz].
        input_density: Of the input (K,) [unit2/Hz].
        chance: The coherence that noise alone exceeds at 5 % of the frequencies [1].
        trace: A piece of the output (T,), for pictures.
        rate: Of the piece [Hz].
    """

    test: str
    input: Channel
    output: Channel
    frequency: Array
    H: Complex
    coherence: Array
    variance: Array
    density: Array
    input_density: Array
    chance: float
    trace: Array
    rate: float

    @property
    def energy(self) -> float:
        """Power of the output over the input's band [unit2]."""
        return float(self.density.sum() * (self.frequency[1] - self.frequency[0]))

    @property
    def mean_coherence(self) -> float:
        """The part of that power which the input explains linearly [1]."""
        total = float(self.density.sum())
        return float(self.coherence @ self.density) / total if total > 0.0 else 0.0


def paths(excitation: Excitation, recipe: LocalPolynomial) -> tuple[Path, ...]:
    """Return the paths from one input to all outputs.

    Local polynomials, as windowed blocks leak: with blocks of 4 s a linear quarter car has a coherence of 0.83.

    Args:
        excitation: The input and the outputs.
        recipe: How wide the bands are.

    Raises:
        TooShortError: The record has too few bins.
    """
    record = Record(excitation.u[None], excitation.y)
    found = recipe.estimate(Records((record,), excitation.rate, (excitation.channel,), excitation.outputs))
    coherence, variance = found.coherence, found.variance
    if coherence is None or variance is None:
        raise TypeError(f"{recipe} gives no coherence")
    active = np.isfinite(variance[0, 0])
    source = _density(excitation.u[None], excitation.rate, found.frequency)[0, active]
    densities = _density(excitation.y, excitation.rate, found.frequency)[:, active]
    middle = excitation.u.size // 2
    piece = slice(middle, middle + round(SHOWN * excitation.rate))
    chance = _chance(recipe, excitation.u.size / excitation.rate)
    return tuple(
        Path(
            excitation.test,
            excitation.channel,
            output,
            found.frequency[active],
            found.H[i, 0, active],
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
    """Return the coherence of pure noise at 95 %: of B complex bins, P are taken by response and transient."""
    unknowns = 2 * (recipe.degree + 1)
    least = int(np.ceil((recipe.spare * unknowns - 1.0) / 2.0))
    bins = 2 * max(least, round((recipe.half_width or 0.0) * duration)) + 1
    left = float(beta.ppf(0.05, bins - unknowns, unknowns))
    return float(max(0.0, 1.0 - left * bins / (bins - unknowns)))


def outputs_of(names: Sequence[str], given: Sequence[str]) -> tuple[str, ...]:
    """Return the outputs asked for, or the dissertation's key ones among `names`: 6.2 shows these."""
    if given:
        return tuple(given)
    return tuple(name for name in names if name.endswith(("velocity", "tire_force", "ride_height")))
