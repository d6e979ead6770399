"""Frequency band that rig tests support: up to where their inputs explain their outputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from eightpost.array_types import Array
from eightpost.errors import ParameterError
from eightpost.ident.response import FrequencyResponse
from eightpost.ident.vehicle.experiment import quantity

#: Share of the outputs that must be supported [1].
_SHARE = 0.75

#: Lowest upper end [Hz]: below it a coherence may be low because an output hardly moves there.
_LOWEST = 6.0

#: Width of the median filter over the coherence, and of the range in which it must stay low [Hz]; a narrower dip does
#: not end the band.
_SMOOTHING, _WIDTH = 1.0, 2.0

#: Number of outputs that a sentence names.
_LISTED = 4


@dataclass(frozen=True, slots=True)
class CoherentBand:
    """Criterion for the upper end of the band that a model is fitted in.

    An output is supported up to the frequency above which its multiple coherence stays below `coherence`. The tests
    support a model up to the frequency where fewer than three quarters of the outputs are supported (the others are
    named), or where a road or a shock force has no power. The band ends `margin` below it, as the response beyond a
    band decides its last poles.

    Raises:
        ParameterError: A value is outside its range.
    """

    coherence: float = 0.9  #: Lowest multiple coherence [1].
    margin: float = 0.15  #: Part of the supported frequencies at their upper end that is not fitted [1].
    highest: float = 30.0  #: Highest frequency that is examined [Hz].

    def __post_init__(self) -> None:
        """Check the ranges."""
        if not (0.0 < self.coherence < 1.0 and self.highest > _LOWEST):
            raise ParameterError(f"{self}: coherence must be between 0 and 1, highest above {_LOWEST:g} Hz")

    def of(self, response: FrequencyResponse) -> SupportedBand:
        """Return the upper end of the band that a response supports.

        Args:
            response: Estimated response with multiple coherence, at least up to `highest` if the records allow it.
        """
        top = min(self.highest, float(response.frequency[-1]))
        powered = _powered(response, top)
        if response.coherence is None:
            return self._end(min(top, powered), {}, powered)
        limits = {n: self._limit(response.frequency, row, top)
                  for n, row in zip(response.output_names, response.coherence, strict=True)}  # fmt: skip
        ordered = sorted(limits.values(), reverse=True)
        coherent = ordered[int(np.ceil(_SHARE * len(ordered))) - 1]
        return self._end(min(coherent, powered, top), limits, powered)

    def _end(self, supported: float, limits: Mapping[str, float], powered: float) -> SupportedBand:
        high = max((1.0 - self.margin) * supported, min(_LOWEST, supported))
        return SupportedBand(high, supported, limits, self.coherence, powered)

    def _limit(self, frequency: Array, coherence: Array, top: float) -> float:
        """Return the frequency [Hz] above which a coherence (K,) stays low."""
        spacing = float(frequency[1] - frequency[0]) if frequency.size > 1 else _WIDTH
        smooth = median_filter(coherence, max(1, round(_SMOOTHING / spacing)), mode="nearest")
        low = (smooth < self.coherence) & (frequency > _LOWEST)
        stays = _stays(low, max(1, round(_WIDTH / spacing)))
        return min(top, float(frequency[np.argmax(stays)]) if stays.any() else top)


@dataclass(frozen=True, slots=True)
class SupportedBand:
    """Upper end of the band that rig tests support."""

    high: float  #: Upper end of the band of a fit [Hz].
    supported: float  #: Frequency up to which the tests support a model [Hz].
    outputs: Mapping[str, float]  #: Frequency [Hz] up to which the coherence of each output is sufficient.
    coherence: float  #: Lowest multiple coherence that counts as sufficient [1].
    #: Highest frequency at which all roads and shock forces have power [Hz]; infinite if they have it wherever it was
    #: examined.
    powered: float

    def summary(self) -> str:
        """Return the upper end and its reason as a sentence."""
        text = f"The model was fitted up to {self.high:.3g} Hz, as the tests support one up to {self.supported:.3g} Hz"
        weak = [name for name, limit in self.outputs.items() if limit <= self.supported + 1e-9]
        if self.powered <= self.supported + 1e-9:
            reason = f"{text}; above, a road or a shock force has no power"
        elif weak:
            reason = f"{text}; above, the multiple coherence of {_listed(weak)} stays below {self.coherence:g}"
        else:
            reason = f"{text}, the highest frequency that was examined"
        less = {name: limit for name, limit in self.outputs.items() if limit < self.high}
        if not less:
            return f"{reason}."
        exceptions = ", ".join(f"{name} {limit:.3g} Hz" for name, limit in sorted(less.items(), key=lambda p: p[1]))
        return f"{reason}. The coherence of some outputs is sufficient only up to a lower frequency: {exceptions}."


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more


def _stays(low: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
    """Return where `count` values from here on, or all that remain, are low (K,)."""
    ends = np.concatenate((low, np.ones(count - 1, dtype=np.bool_)))
    return np.asarray(np.lib.stride_tricks.sliding_window_view(ends, count).all(axis=1))


def _powered(response: FrequencyResponse, top: float) -> float:
    """Return the highest frequency [Hz] at which all roads and shock forces have power; infinite if not below `top`."""
    if response.variance is None:
        return np.inf
    needed = [quantity(name) in ("road", "force") for name in response.input_names]
    known = np.asarray(np.isfinite(response.variance[:, needed]).any(axis=0), dtype=np.bool_)
    below = response.frequency <= top
    last = min((float(response.frequency[np.flatnonzero(row)[-1]]) for row in known if row.any()), default=np.inf)
    return last if last < response.frequency[below][-1] else np.inf
