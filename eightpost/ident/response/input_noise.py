"""Bias of an estimated response from noise of its measured inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import stft

from eightpost.array_types import Array, Complex
from eightpost.ident.response.records import Records

#: Frequencies at which records have noise only, relative to their sample rate [1]: above the drive, and below the edge
#: of the decimation's filter.
_QUIET = (0.34, 0.39)

#: Duration of the blocks of the spectra [s].
_BLOCK = 8.0

#: Power over that of the noise from which an input counts as driven [1].
_DRIVEN = 10.0

#: Estimators by type, all of them regressions on the inputs.
_KINDS = {
    "H1": "H1",
    "LocalPolynomial": "local polynomials, a regression on the inputs like H1",
    "OutputErrorMethod": "output error, a simulation with the measured inputs, a regression on them like H1",
    "SameDrive": "differences of two tests with the same drive, like H1",
}


@dataclass(frozen=True, slots=True)
class InputNoise:
    """Attenuation of the responses to each input by its noise."""

    #: Relative reduction of the responses [1], median over the driven frequencies, by input; without inputs that are
    #: not driven.
    bias: Mapping[str, float]
    quiet: tuple[float, float]  #: Frequencies from which the noise was taken [Hz].

    def summary(self, estimator: object) -> str:
        """Return the estimator and its bias as a sentence.

        Args:
            estimator: Estimator of the response, or of the parameters of a simulated model.
        """
        kind = type(estimator).__name__
        sentence = f"Estimator: {_KINDS.get(kind, kind)}. Noise of the measured inputs makes its responses too small"
        if not self.bias:
            return f"{sentence}."
        worst: dict[str, str] = {}
        for name in sorted(self.bias, key=lambda name: -self.bias[name]):
            worst.setdefault(name.rpartition(".")[2], name)
        listed = ", ".join(f"{name} {100.0 * self.bias[name]:.2g} %" for name in worst.values())
        return (
            f"{sentence}: if the noise of the inputs is white and as large as their signals from {self.quiet[0]:.3g} "
            f"to {self.quiet[1]:.3g} Hz, by (worst input of each kind) {listed}."
        )


def input_noise(records: Records, band: tuple[float, float]) -> InputNoise:
    """Return the attenuation of a least-squares estimate by noise of its inputs.

    The part of an input that the other inputs do not explain has the power P; noise of power N in it reduces the
    responses to the input by

        N / P,  P = 1 / (S^-1)_jj

    with the spectral matrix S of the measured inputs, noise included.

    Args:
        records: Records, one per test, with shock forces minus c v.
        band: Lowest and highest frequency of the fit [Hz].
    """
    size = min(*(test.u.shape[1] for test in records.tests), round(_BLOCK * records.rate))
    blocks = [np.moveaxis(stft(test.u, records.rate, nperseg=size, boundary=None, padded=False)[2], -1, 0)
              for test in records.tests]  # fmt: skip
    frequency = np.fft.rfftfreq(size, 1.0 / records.rate)
    S = _spectra(np.concatenate(blocks))
    quiet = (_QUIET[0] * records.rate, _QUIET[1] * records.rate)
    power = np.real(np.einsum("kjj->jk", S))
    noise = power[:, (frequency >= quiet[0]) & (frequency <= quiet[1])].mean(axis=1)
    inside = (frequency >= band[0]) & (frequency <= band[1])
    bias = _attenuation(S[inside], noise, power[:, inside] > _DRIVEN * noise[:, None])
    names = [channel.name for channel in records.inputs]
    return InputNoise({n: b for n, b in zip(names, bias.tolist(), strict=True) if np.isfinite(b)}, quiet)


def _spectra(blocks: Complex) -> Complex:
    """Return the spectral matrices (K, m, m) of blocks (blocks, m, K)."""
    return np.asarray(np.einsum("bik,bjk->kij", blocks, blocks.conj()) / len(blocks))


def _attenuation(S: Complex, noise: Array, driven: Array) -> Array:
    """Return the median of N / P over the driven frequencies of each input (m,); NaN without one."""
    bias = np.full(driven.shape, np.nan)
    for k, matrix in enumerate(S):
        rows = np.flatnonzero(driven[:, k])
        if not rows.size:
            continue
        size = np.sqrt(np.real(np.diag(matrix))[rows])
        scaled = matrix[np.ix_(rows, rows)] / np.outer(size, size)
        alone = size**2 / np.real(np.diag(np.linalg.pinv(scaled)))
        bias[rows, k] = np.clip(noise[rows] / np.maximum(alone, 1e-300), 0.0, 1.0)
    return np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else np.nan for row in bias])
