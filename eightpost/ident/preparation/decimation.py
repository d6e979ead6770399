"""Decimation to a model's rate (6.4.1)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.signal import cheby1, sosfiltfilt

from eightpost.array_types import Array
from eightpost.errors import ParameterError

#: Relative tolerance of a record's rate as a multiple of the model's, because loggers round time.
_RATE_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True)
class Decimation:
    """Decimation with an 8th-order Chebyshev type I low-pass, forward and backward, at 80 % of the Nyquist frequency.

    Aliases in the band are 63 dB down. All channels pass the same filter, so that responses between them do not change.
    """

    rate: float = 125.0  #: New rate [Hz]; the dissertation's models have 125 Hz.
    band: float = 0.8  #: Cut-off frequency as a fraction of the new Nyquist frequency [1].
    order: int = 8  #: Order of the filter, which is run forward and backward.
    #: Ripple in the pass band per pass [dB]. 6.4.1 does not give it; the default reduces amplitudes by at most 0.1 %.
    ripple: float = 0.005

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not (np.isfinite(self.rate) and self.rate > 0.0 and 0.0 < self.band < 1.0):
            raise ParameterError(f"{self}: rate must be above 0 Hz and band between 0 and 1")
        if self.order < 1 or not self.ripple > 0.0:
            raise ParameterError(f"{self}: order must be 1 or more and ripple above 0 dB")

    @property
    def cutoff(self) -> float:
        """Upper end of the pass band [Hz]."""
        return 0.5 * self.band * self.rate

    def factor(self, rate: float) -> int:
        """Return the ratio of `rate` [Hz] to the new rate.

        Raises:
            ParameterError: The rate is not a multiple of the new rate.
        """
        factor = max(1, round(rate / self.rate))
        if abs(rate / (factor * self.rate) - 1.0) > _RATE_TOLERANCE:
            near = sorted({max(1, int(rate / self.rate)) + step for step in (0, 1)})
            offered = " or ".join(f"{rate / n:.6g}" for n in near)
            raise ParameterError(
                f"a record of {rate:.6g} Hz cannot be decimated to {self.rate:.6g} Hz because its rate is not a "
                f"multiple of that; use a model rate of {offered} Hz, or export the record at a multiple"
            )
        return factor

    def apply(self, values: Array, rate: float) -> Array:
        """Return every n-th sample of the low-passed values; the values themselves if they are at the new rate.

        Args:
            values: Samples (..., N), with time last, preferably without mean.
            rate: Sample rate of the values [Hz].
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
