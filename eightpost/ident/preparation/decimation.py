"""Decimation to a model's rate (6.4.1): zero-phase low-pass, then every so many-th sample."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.signal import cheby1, sosfiltfilt

from eightpost.errors import ParameterError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: A record's rate may miss a multiple of the model's by this part: a logger's rounding of time.
_RATE_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class Decimation:
    """An 8th-order Chebyshev type I low-pass, forward and backward, at 80 % of the new Nyquist frequency.

    What folds into the band from above it is 63 dB down. All channels pass the same filter, so that responses between
    them do not change.

    Attributes:
        rate: The new rate [Hz]; the dissertation's models have 125 Hz.
        band: Cut-off as part of the new Nyquist frequency [1].
        order: Of the filter that is run twice.
        ripple: In the pass band, of each run [dB]; 6.4.1 names none. Ours takes 0.1 % off an amplitude at most.
    """

    rate: float = 125.0
    band: float = 0.8
    order: int = 8
    ripple: float = 0.005

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not (np.isfinite(self.rate) and self.rate > 0.0 and 0.0 < self.band < 1.0):
            raise ParameterError(f"{self}: the rate must be above 0 Hz, the band between 0 and 1")
        if self.order < 1 or not self.ripple > 0.0:
            raise ParameterError(f"{self}: the order must be 1 or more, the ripple above 0 dB")

    @property
    def cutoff(self) -> float:
        """The end of the pass band [Hz]."""
        return 0.5 * self.band * self.rate

    def factor(self, rate: float) -> int:
        """Return how many samples at `rate` [Hz] become one.

        Raises:
            ParameterError: The rate is no multiple of the new one.
        """
        factor = max(1, round(rate / self.rate))
        if abs(rate / (factor * self.rate) - 1.0) > _RATE_TOLERANCE:
            near = sorted({max(1, int(rate / self.rate)) + step for step in (0, 1)})
            offered = " or ".join(f"{rate / n:.6g}" for n in near)
            raise ParameterError(
                f"a record of {rate:.6g} Hz cannot be decimated to {self.rate:.6g} Hz: its rate is no multiple of "
                f"that; take a model's rate of {offered} Hz, or export the record at a multiple"
            )
        return factor

    def apply(self, values: Array, rate: float) -> Array:
        """Return every so many-th sample of the low-passed values; at the new rate already, the values themselves.

        Args:
            values: (..., N), time last, best without mean.
            rate: Of the values [Hz].
        """
        factor = self.factor(rate)
        if factor == 1:
            return values
        sections = _sections(self, rate)
        pad = min(values.shape[-1] - 1, 6 * self.order * factor)
        return np.asarray(sosfiltfilt(sections, values, axis=-1, padlen=pad)[..., ::factor], dtype=np.float64)


@lru_cache(maxsize=8)
def _sections(decimation: Decimation, rate: float) -> Array:
    """Return the filter's second-order sections (S, 6)."""
    low, ripple = decimation.cutoff, decimation.ripple
    return np.asarray(cheby1(decimation.order, ripple, low, fs=rate, output="sos"), dtype=np.float64)
