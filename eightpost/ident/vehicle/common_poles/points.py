"""Data of a common-pole fit: response values with their standard deviations, in scaled channels."""

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
    """Response values in channels scaled to similar size: `H_scaled = H u_size / y_size`.

    Attributes:
        s: Laplace variable 2 pi j f [1/s] (K,).
        H: Scaled response (p, m, K).
        deviation: Standard deviation of the scaled response (p, m, K); infinite where a value is unknown.
        input_size: Scale of the inputs [input units] (m,).
        output_size: Scale of the outputs [output units] (p,).
    """

    s: Complex
    H: Complex
    deviation: Array
    input_size: Array
    output_size: Array

    @property
    def weight(self) -> Array:
        """Inverse of the standard deviation (p, m, K); 0 where a value is unknown."""
        return np.asarray(1.0 / self.deviation, dtype=np.float64)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Mask of the known values (p, m, K)."""
        return np.asarray(np.isfinite(self.deviation))

    def thinned(self, count: int) -> Points:
        """Return evenly selected frequencies, about `count` of them."""
        step = max(1, self.s.size // count)
        chosen = slice(self.s.size % step, None, step)
        return replace(self, s=self.s[chosen], H=self.H[..., chosen], deviation=self.deviation[..., chosen])


def points_of(response: FrequencyResponse, *, floor: float) -> Points:
    """Return the values of a response with their standard deviations.

    The standard deviation is that of the estimate, but at least `floor` times the size of the output at that frequency.
    The floor is needed because an estimate without noise has errors too, and unbounded weights would fit only a few
    values.

    Args:
        response: Frequency response. Its variance is infinite where an input had no power. If it has no variance, all
            nonzero values are known and the floor alone gives their standard deviation.
        floor: Lower limit of the standard deviation, relative to the size of the output [1].

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
        for name, is_known in zip(names, np.atleast_1d(known.any(axis=axes)), strict=True):
            if not is_known:
                raise InputError(f"the {kind} {name!r} has no response in the frequency band of the fit; leave it out")


def _sizes(H: Array, known: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return scales y (p,) and u (m,) for which the RMS of `H u / y` is near 1 in every row and column."""
    power, counted = np.sum(H**2, axis=2), np.maximum(known.sum(axis=2), 1)
    mean = power / counted
    y, u = np.ones(len(mean)), np.ones(mean.shape[1])
    for _ in range(_SWEEPS):
        y = _root(np.mean(mean * u**2, axis=1))
        u = 1.0 / _root(np.mean(mean / y[:, None] ** 2, axis=0))
    return y, u


def _root(power: Array) -> Array:
    return np.sqrt(np.where(power > 0.0, power, 1.0))
