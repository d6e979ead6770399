"""Residuals as spectral lines in a frequency band."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.signal import get_window

from eightpost.array_types import Array, Complex
from eightpost.errors import TooShortError

#: Number of neighbouring lines that the windows below correlate.
REACH = 2


@dataclass(frozen=True, slots=True)
class Band:
    """Frequency band in which residuals are counted; the default is every line, the same as the time domain (Parseval).

    White noise of standard deviation s has a standard deviation s in the real and in the imaginary part of each line.
    """

    low: float = 0.0  #: Lowest frequency [Hz].
    high: float = np.inf  #: Highest frequency [Hz].
    #: Window over a whole record: `boxcar`, or `hann` if slow transients and offsets must not leak.
    window: Literal["boxcar", "hann"] = "boxcar"

    def frequencies(self, samples: int, rate: float) -> Array:
        """Return the frequencies of the lines (B,) [Hz] of a record.

        Raises:
            TooShortError: The record has no line in the band.
        """
        lines = np.fft.rfftfreq(samples, 1.0 / rate)
        kept = lines[(lines >= self.low) & (lines <= self.high)]
        if not kept.size:
            raise TooShortError(
                f"a record of {samples / rate:g} s at {rate:g} Hz has no spectral line from {self.low:g} to "
                f"{self.high:g} Hz; use a longer record or a wider band"
            )
        return np.asarray(kept)

    def lines(self, signals: Array, rate: float) -> Complex:
        """Return the spectral lines (..., B) of signals (..., N)."""
        samples = signals.shape[-1]
        every = np.fft.rfftfreq(samples, 1.0 / rate)
        kept = (every >= self.low) & (every <= self.high)
        window = get_window(self.window, samples)
        spectrum = np.fft.rfft(signals * (window / np.sqrt(np.mean(window**2))), norm="ortho")[..., kept]
        both_sides = np.where((every[kept] > 0.0) & (every[kept] < 0.5 * rate), np.sqrt(2.0), 1.0)
        return np.asarray(spectrum * both_sides)

    def correlations(self) -> Array:
        """Return the correlations (REACH + 1,) of white noise on lines 0, 1, ... apart [1]."""
        squared = get_window(self.window, 4096) ** 2
        return np.asarray(np.real(np.fft.rfft(squared))[: REACH + 1] / squared.sum())
