"""Frequency lines of records of one length, and sums over bands of lines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from eightpost.array_types import Array, Complex


@dataclass(frozen=True)
class Lines:
    """Discrete Fourier transform of records of one length, limited to a band above 0 Hz."""

    samples: int  #: Number N of samples of a record.
    rate: float  #: Sample rate [Hz].
    high: float  #: Highest frequency of the band [Hz].

    @cached_property
    def frequency(self) -> Array:
        """Frequencies (K,) [Hz], without 0."""
        every = np.fft.rfftfreq(self.samples, 1.0 / self.rate)
        return np.asarray(every[(every > 0.0) & (every <= self.high)])

    @property
    def spacing(self) -> float:
        """Distance between two lines [Hz]."""
        return self.rate / self.samples

    def spectrum(self, rows: Array) -> Complex:
        """Return the lines (K, C) of records (C, N)."""
        whole = scipy.fft.rfft(rows, axis=-1)[..., 1 : 1 + self.frequency.size]
        return np.ascontiguousarray(whole.T, dtype=np.complex128)

    def rows(self, spectrum: Complex) -> Array:
        """Return the records (C, N) of lines (K, C); their means are 0."""
        whole = np.zeros((spectrum.shape[1], self.samples // 2 + 1), dtype=np.complex128)
        whole[:, 1 : 1 + self.frequency.size] = spectrum.T
        return np.asarray(scipy.fft.irfft(whole, self.samples, axis=1), dtype=np.float64)

    def half_width(self, width: float) -> int:
        """Return n, where a band of a width [Hz] has 2 n + 1 lines; at least 9 lines."""
        return max(4, round(0.5 * width / self.spacing))

    def band_sum(self, values: NDArray[Any], width: float) -> NDArray[Any]:
        """Return the sums (K, ...) of values (K, ...) over the band of a width [Hz] around each line."""
        n = self.half_width(width)
        first = np.zeros((1, *values.shape[1:]), dtype=values.dtype)
        summed = np.concatenate([first, np.cumsum(values, axis=0)])
        k = np.arange(len(values))
        return np.asarray(summed[np.minimum(k + n + 1, len(values))] - summed[np.maximum(k - n, 0)])

    def band_mean(self, values: NDArray[Any], width: float) -> NDArray[Any]:
        """Return the means (K, ...) of values (K, ...) over the band of a width [Hz] around each line."""
        count = self.band_sum(np.ones(len(values)), width)
        return np.asarray(self.band_sum(values, width) / count.reshape(-1, *(1,) * (values.ndim - 1)))
