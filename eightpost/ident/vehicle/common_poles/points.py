"""What a common-pole model is fitted to: response values with a standard deviation each, in scaled channels."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.response import FrequencyResponse

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

_SWEEPS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Values of a response, in channels that are scaled to like size: `H_scaled = H u_size / y_size`.

    Attributes:
        s: 2 pi j f (K,) [1/s].
        H: (p, m, K), scaled.
        deviation: Standard deviation of H (p, m, K), scaled; infinite where a value is not known.
        input_size: (m,) [input units].
        output_size: (p,) [output units].
    """

    s: Complex
    H: Complex
    deviation: Array
    input_size: Array
    output_size: Array

    @property
    def weight(self) -> Array:
        """1 / deviation (p, m, K), 0 where a value is not known."""
        return np.asarray(1.0 / self.deviation, dtype=np.float64)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which values are known (p, m, K)."""
        return np.asarray(np.isfinite(self.deviation))

    def thinned(self, count: int) -> Points:
        """Return every so many-th frequency, so that about `count` of them remain."""
        step = max(1, self.s.size // count)
        chosen = slice(self.s.size % step, None, step)
        return replace(self, s=self.s[chosen], H=self.H[..., chosen], deviation=self.deviation[..., chosen])


def points_of(response: FrequencyResponse, *, floor: float) -> Points:
    """Return the values of a response with what they are worth.

    The deviation is that of the estimate; at least `floor` of the size of the output at that frequency: an estimate
    without noise errs too, and weights without bound would fit a few values only. White noise gives weights that vary
    over orders of magnitude for the same reason.

    Args:
        response: With a variance, infinite where an input had no power; without one every value that is not zero
            counts by the floor alone.
        floor: [1].

    Raises:
        InputError: An input or an output has no value at all.
    """
    variance = response.variance
    if variance is None:
        variance = np.where(np.abs(response.H) > 0.0, 0.0, np.inf)
    known = np.isfinite(variance)
    _check(known, response)
    H = np.where(known, response.H, 0.0)
    output_size, input_size = _sizes(np.abs(H), known)
    scale = (input_size[None, :] / output_size[:, None])[:, :, None]
    scaled = np.asarray(H * scale, dtype=np.complex128)
    counted = np.maximum(known.sum(axis=1), 1)
    local = np.sqrt(np.sum(np.abs(scaled) ** 2, axis=1) / counted)
    noise = np.sqrt(np.where(known, variance, 0.0)) * scale
    deviation = np.where(known, np.hypot(noise, floor * local[:, None, :]), np.inf)
    s = np.asarray(2j * np.pi * response.frequency, dtype=np.complex128)
    return Points(s, scaled, deviation, input_size, output_size)


def _check(known: NDArray[np.bool_], response: FrequencyResponse) -> None:
    for axes, names, kind in (((1, 2), response.output_names, "output"), ((0, 2), response.input_names, "input")):
        for name, there in zip(names, np.atleast_1d(known.any(axis=axes)), strict=True):
            if not there:
                raise InputError(f"the {kind} {name!r} has no response in the band of the fit; leave it out")


def _sizes(H: Array, known: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return sizes y (p,) and u (m,) with which the RMS of `H u / y` is near 1 in every row and column."""
    power, counted = np.sum(H**2, axis=2), np.maximum(known.sum(axis=2), 1)
    mean = power / counted
    y, u = np.ones(len(mean)), np.ones(mean.shape[1])
    for _ in range(_SWEEPS):
        y = _root(np.mean(mean * u**2, axis=1))
        u = 1.0 / _root(np.mean(mean / y[:, None] ** 2, axis=0))
    return y, u


def _root(power: Array) -> Array:
    return np.sqrt(np.where(power > 0.0, power, 1.0))
