"""Regularised inverse of a frequency response, line by line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array, Complex
from eightpost.drivefile.lines import Lines
from eightpost.errors import ParameterError

#: Amplitude of an input that counts as much as that of another unit: the scale of the regularisation, by SI unit.
TYPICAL = {"m": 0.002, "N": 700.0, "N.m": 1000.0}

#: Minimum amplitude of a channel in a band, relative to its largest one, to which errors are scaled [1].
_FLOOR = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Inverse:
    """Regularised inverse of a response, with its conditioning."""

    G: Complex  #: Inverse (K, m, p) in input unit per output unit.
    singular: Array  #: Singular values (K, r) of the scaled response, largest first [1].
    kept: Array  #: Share of each singular direction that the inverse uses (K, r) [1]: `s^2 / (s^2 + lambda^2)`.

    @property
    def condition(self) -> Array:
        """Ratio of the largest singular value to the smallest one (K,) [1]."""
        return np.asarray(self.singular[:, 0] / np.maximum(self.singular[:, -1], 1e-300))

    @property
    def rank(self) -> Array:
        """Number of directions (K,) that the inverse uses: the sum of their shares [1]."""
        return np.asarray(self.kept.sum(axis=1))


def output_scale(lines: Lines, target: Complex, width: float) -> Array:
    """Return the amplitude of each target channel in the band around each line (K, p), for target lines (K, p)."""
    amplitude = np.sqrt(lines.band_mean(np.abs(target) ** 2, width))
    return np.asarray(np.maximum(amplitude, _FLOOR * amplitude.max(axis=0)))


def regularised_inverse(H: Complex, outputs: Array, units: tuple[str, ...], regularisation: float) -> Inverse:
    """Return the Tikhonov-regularised inverse of a response at each line.

        S = Y^-1 H U = W diag(s) V^H,   G = U V diag(s / (s^2 + lambda^2)) W^H Y^-1,   lambda = r s_max

    Y are the amplitudes of the target channels, so that all channels count equally, and U typical amplitudes of the
    inputs. Directions with singular values far below lambda are not driven: the rig cannot reach them without commands
    that are far larger than typical ones.

    Args:
        H: Response (K, p, m).
        outputs: Amplitudes Y of the channels (K, p).
        units: SI units of the m inputs.
        regularisation: Ratio r of lambda to the largest singular value of each line [1].

    Raises:
        ParameterError: An input has another unit than m, N or N.m.
    """
    if unknown := [unit for unit in units if unit not in TYPICAL]:
        raise ParameterError(f"an input has the unit {unknown[0]}; inputs of a rig have {', '.join(TYPICAL)}")
    inputs = np.array([TYPICAL[unit] for unit in units])
    W, s, Vh = np.linalg.svd(H / outputs[:, :, None] * inputs, full_matrices=False)
    square, floor = s**2, np.maximum((regularisation * s[:, :1]) ** 2, 1e-300)
    weights = s / (square + floor)
    G = inputs[:, None] * (np.conj(Vh.transpose(0, 2, 1)) * weights[:, None, :]) @ np.conj(W.transpose(0, 2, 1))
    return Inverse(G / outputs[:, None, :], s, square / (square + floor))
