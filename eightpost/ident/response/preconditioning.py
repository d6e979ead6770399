"""Preconditioning of an estimate: smoothing, residual fits at high frequencies and zeroed paths (6.3.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from eightpost.ident.response.conditioning import SMOOTHING_WIDTH, HighResidual, Zeroed, ZeroPhaseSmoothing, condition

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.ident.response.frequency_response import FrequencyResponse

    Array = NDArray[np.float64]
    Complex = NDArray[np.complex128]

#: Distance between the control points of a residual fit [Hz], as for the (6, 7 Hz) of 5.3.2.
_POINTS_APART = 1.0
#: Lowest frequency from which a residual fit may replace an estimate [Hz].
_LOWEST_END = 2.0


#: Frequency above which residual fits are not reported [Hz], because the weights of the models end near it.
_NOTABLE_END = 15.0


class PreconditionedResponse(NamedTuple):
    """Response that is ready for fits, with notes on its preconditioning."""

    response: FrequencyResponse
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Preconditioning:
    """Settings of the preconditioning of an estimate before models are fitted.

    Above the frequency from which the coherence of input and output stays low, the path is extrapolated by Eq 5.48
    through two points below it. (The aeroloaders have no power above 5 Hz; other paths disappear in the noise.) In
    5.3.2 the points are set manually to 6 and 7 Hz for all paths between corners; here the coherence of each path
    determines them.

    Attributes:
        width: Width over frequency below which variations are smoothed [Hz]; 0 does not smooth.
        coherence: Coherence below which a path is replaced, from the frequency above which it stays there [1]; 0
            replaces a path only where the input has no power.
        zeroed: Paths (output, input) that are set to zero (Table 6.5).
    """

    width: float = SMOOTHING_WIDTH
    coherence: float = 0.5
    zeroed: tuple[tuple[str, str], ...] = ()

    def apply(self, response: FrequencyResponse) -> PreconditionedResponse:
        """Return the preconditioned response.

        Raises:
            ParameterError: A path that is to be zeroed does not exist.
        """
        H, extrapolated = response.H.copy(), 0
        for i, j in np.ndindex(H.shape[:2]):
            end = self._end(response, i, j)
            H[i, j, :end] = self._smoothed(response.frequency[:end], H[i, j, :end])
            if end < response.frequency.size:
                H[i, j] = _continued(response.frequency, H[i, j], end)
                extrapolated += int(response.frequency[end] < _NOTABLE_END)
        changed = response.with_response(H)
        if self.zeroed:
            changed = condition(changed, Zeroed(), paths=self.zeroed)
        return PreconditionedResponse(changed, self._notes(extrapolated, H.shape[0] * H.shape[1]))

    def _end(self, response: FrequencyResponse, i: int, j: int) -> int:
        """Return the bin from which a path is not known."""
        known = np.ones(response.frequency.size, dtype=bool)
        if response.variance is not None:
            known &= np.isfinite(response.variance[i, j])
        last = int(np.flatnonzero(known)[-1]) + 1 if known.any() else 0
        if response.partial_coherence is not None and self.coherence > 0.0:
            last = min(last, _lost(response.partial_coherence[i, j], response.frequency, self.coherence))
        return max(last, int(np.searchsorted(response.frequency, _LOWEST_END)))

    def _smoothed(self, frequency: Array, path: Complex) -> Complex:
        if self.width <= 0.0 or frequency.size < 3:
            return path
        return ZeroPhaseSmoothing(self.width).apply(frequency, path)

    def _notes(self, extrapolated: int, paths: int) -> tuple[str, ...]:
        notes = []
        if extrapolated:
            notes.append(f"{extrapolated} of {paths} paths are extrapolated by Eq 5.48 where their coherence is low")
        if self.zeroed:
            notes.append(f"{len(self.zeroed)} of {paths} paths are zeroed")
        return tuple(notes)


def _lost(coherence: Array, frequency: Array, threshold: float) -> int:
    """Return the bin from which coherence (K,), averaged over a residual fit's width, stays below `threshold`.

    If it never reaches the threshold, its maximum is the threshold.
    """
    half = max(1, round(0.5 * _POINTS_APART / float(np.mean(np.diff(frequency)))))
    level = np.convolve(np.pad(coherence, half, mode="edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")
    last = int(np.flatnonzero(level >= min(threshold, level.max()))[-1]) + 1
    return last if last == coherence.size else max(1, last - half)


def _continued(frequency: Array, path: Complex, end: int) -> Complex:
    """Return the path (K,) extrapolated from bin `end` by Eq 5.48, without an increase of magnitude."""
    high = float(frequency[end - 1])
    low = max(high - _POINTS_APART, float(frequency[0]))
    a, b = int(np.searchsorted(frequency, low)), end - 1
    if not (abs(path[a]) > abs(path[b]) > 0.0):
        changed = path.copy()
        changed[end:] = path[b] * (high / frequency[end:]) ** 2  # roll-off of a free mass
        return changed
    continued = HighResidual(float(frequency[a]), high).apply(frequency, path)
    continued[:end] = path[:end]
    return continued
