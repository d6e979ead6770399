"""Preconditioning as a whole: which paths are zeroed, where residual fits replace an estimate, smoothing (6.3.2)."""

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

#: A residual fit takes its control points this far apart [Hz], as the (6, 7 Hz) of 5.3.2.
_POINTS_APART = 1.0
#: Below this [Hz] an estimate has no high end that a residual fit could continue.
_LOWEST_END = 2.0


#: Residual fits that begin above this [Hz] need no mention: the models' weights end near.
_NOTABLE_END = 15.0


class Preconditioned(NamedTuple):
    """A response that is ready for fits, and what was done to it."""

    response: FrequencyResponse
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Preconditioning:
    """What is done to an estimate before models are fitted.

    Where the coherence of input and output is lost for good, Eq 5.48 continues the path through two points below (the
    aeroloaders have no power above 5 Hz; others fade into the noise). 5.3.2 sets the points by hand at 6 and 7 Hz for
    all paths between corners; here the coherence of each path says where.

    Attributes:
        width: Variations over frequency narrower than this are smoothed away [Hz]; 0 leaves them.
        coherence: A path is replaced above the frequency from which its coherence stays below this [1]; 0 replaces
            only where an input has no power.
        zeroed: Paths (output, input) that are set to zero (Table 6.5).
    """

    width: float = SMOOTHING_WIDTH
    coherence: float = 0.5
    zeroed: tuple[tuple[str, str], ...] = ()

    def apply(self, response: FrequencyResponse) -> Preconditioned:
        """Return the response as the fits take it.

        Raises:
            ParameterError: A path that is to be zeroed is not there.
        """
        H, ended = response.H.copy(), 0
        for i, j in np.ndindex(H.shape[:2]):
            end = self._end(response, i, j)
            H[i, j, :end] = self._smoothed(response.frequency[:end], H[i, j, :end])
            if end < response.frequency.size:
                H[i, j] = _continued(response.frequency, H[i, j], end)
                ended += int(response.frequency[end] < _NOTABLE_END)
        changed = response.with_response(H)
        if self.zeroed:
            changed = condition(changed, Zeroed(), paths=self.zeroed)
        return Preconditioned(changed, self._notes(ended, H.shape[0] * H.shape[1]))

    def _end(self, response: FrequencyResponse, i: int, j: int) -> int:
        """Return the bin from which a path is not known any more."""
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

    def _notes(self, ended: int, paths: int) -> tuple[str, ...]:
        notes = []
        if ended:
            notes.append(f"{ended} of {paths} paths are continued by Eq 5.48 where their coherence is lost")
        if self.zeroed:
            notes.append(f"{len(self.zeroed)} of {paths} paths are zeroed")
        return tuple(notes)


def _lost(coherence: Array, frequency: Array, least: float) -> int:
    """Return the bin from which coherence (K,), averaged over a residual fit's width, stays below `least`.

    Where it never reaches that, the bin of its best.
    """
    half = max(1, round(0.5 * _POINTS_APART / float(np.mean(np.diff(frequency)))))
    level = np.convolve(np.pad(coherence, half, mode="edge"), np.full(2 * half + 1, 1.0 / (2 * half + 1)), "valid")
    last = int(np.flatnonzero(level >= min(least, level.max()))[-1]) + 1
    return last if last == coherence.size else max(1, last - half)


def _continued(frequency: Array, path: Complex, end: int) -> Complex:
    """Return the path (K,) with what lies beyond bin `end` falling as Eq 5.48 says, never rising."""
    high = float(frequency[end - 1])
    low = max(high - _POINTS_APART, float(frequency[0]))
    a, b = int(np.searchsorted(frequency, low)), end - 1
    if not (abs(path[a]) > abs(path[b]) > 0.0):
        changed = path.copy()
        changed[end:] = path[b] * (high / frequency[end:]) ** 2  # nothing falls slower here than a mass moves
        return changed
    continued = HighResidual(float(frequency[a]), high).apply(frequency, path)
    continued[:end] = path[:end]
    return continued
