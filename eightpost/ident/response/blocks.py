"""Windowed, overlapping blocks and their spectra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.signal import get_window

from eightpost.errors import ParameterError, TooShortError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.response.records import Records

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]


class Spectra(NamedTuple):
    """Spectra of all blocks of all tests.

    Attributes:
        frequency: Frequencies (K,) [Hz].
        U: Spectra of the inputs (K, R, m).
        Y: Spectra of the outputs (K, R, p).
        test: Index of the test that each block belongs to (R,).
        independent: Number of independent blocks that is equivalent to the R overlapping ones.
    """

    frequency: Array
    U: Complex
    Y: Complex
    test: NDArray[np.intp]
    independent: float


@dataclass(frozen=True, slots=True)
class Blocks:
    """Division of records into blocks.

    Attributes:
        length: Length of a block [s]; the frequencies are 1 / length apart. Short blocks have leakage: if a mode rings
            for as long as the block lasts, its peak is smeared and its damping ratio is estimated too large.
        window: Window, any of `scipy.signal.get_window`; the dissertation uses "hamming".
        overlap: Overlap of neighbouring blocks [1].
        high: Highest frequency [Hz]; the lowest one is 1 / length.
    """

    length: float
    window: str = "hann"
    overlap: float = 0.5
    high: float = 30.0

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not (self.length > 0.0 and 0.0 <= self.overlap < 1.0 and self.high > 0.0):
            raise ParameterError(f"{self}: length and high must be above zero, overlap from 0 to below 1")

    def spectra(self, records: Records) -> Spectra:
        """Return the spectra of the blocks of all records.

        Raises:
            TooShortError: A record is shorter than a block.
        """
        size = max(2, round(self.length * records.rate))
        frequency: Array = np.arange(size // 2 + 1, dtype=np.float64) * (records.rate / size)
        kept = np.flatnonzero((frequency > 0.0) & (frequency <= min(self.high, 0.499 * records.rate)))
        window = np.asarray(get_window(self.window, size), dtype=np.float64)
        hop = max(1, round(size * (1.0 - self.overlap)))
        U, Y, test = [], [], []
        for number, (u, y) in enumerate(records.tests):
            starts = self._starts(number, u.shape[1], size, hop)
            U += [np.fft.rfft(window * u[:, k : k + size])[:, kept] for k in starts]
            Y += [np.fft.rfft(window * y[:, k : k + size])[:, kept] for k in starts]
            test += [number] * len(starts)
        worth = len(test) / _repetition(window, hop, len(test))
        chosen: Array = frequency[kept]
        return Spectra(chosen, _by_frequency(U), _by_frequency(Y), np.array(test, dtype=np.intp), worth)

    def _starts(self, number: int, samples: int, size: int, hop: int) -> range:
        if samples < size:
            raise TooShortError(
                f"record {number + 1} has {samples} samples, but a block of {self.length:g} s has {size}; "
                "use shorter blocks"
            )
        return range(0, samples - size + 1, hop)


def _by_frequency(spectra: list[Complex]) -> Complex:
    return np.ascontiguousarray(np.stack(spectra).transpose(2, 0, 1))


def _repetition(window: Array, hop: int, count: int) -> float:
    """Return the ratio of the variances of a mean over overlapping blocks and over separate blocks (Welch)."""
    total, energy = 1.0, float(window @ window)
    for k in range(1, min(count, (window.size - 1) // hop + 1)):
        shared = float(window[k * hop :] @ window[: window.size - k * hop]) / energy
        total += 2.0 * (1.0 - k / count) * shared**2
    return total
