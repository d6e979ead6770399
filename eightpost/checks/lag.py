"""Delay of a channel behind others that it is a linear combination of, by cross-correlation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from eightpost.array_types import Array

#: Longest delay that is searched for [s].
LONGEST = 0.5

#: Share of the highest correlation, squared, from which another peak counts as equally high.
EQUAL = 0.95

#: Distance from the peak of a correlation at which its decrease is measured [s].
_FALL = 0.025


class Delay(NamedTuple):
    """Delay at the peak of a correlation; zero without correlation if a signal is constant."""

    seconds: float  #: Delay [s]; positive if the values are late.
    correlation: float  #: Multiple correlation at that delay [1].
    spread: float  #: Standard deviation of the delay [s]; it is large for slow motions, whose peak is flat.


def delay_of(values: Array, references: Array, rate: float, *, band: float, longest: float = LONGEST) -> Delay:
    """Return the delay of values v (N,) behind references (N,) or (C, N), of which the best combination is taken.

    It maximises the multiple correlation of v(t + delay) with the references, up to `longest` to either side; between
    samples a parabola is interpolated. The signals contain frequencies up to `band` [Hz].
    """
    reach = max(1, min(values.size - 2, round(longest * rate)))
    edge = min(reach, values.size // 4)  # the references end where all values of usual delays are known
    used = np.zeros(values.size)
    used[edge : values.size - edge] = 1.0
    v, refs, count = values - values.mean(), np.atleast_2d(references), used.sum()
    refs = (refs - (refs @ used / count)[:, None]) * used
    sums, squares = _products(v, used, reach), _products(v * v, used, reach)
    energy = squares - sums**2 / count
    scale = np.linalg.norm(refs, axis=1)
    if not energy[reach] > 0.0 or not scale.all():
        return Delay(0.0, 0.0, 0.0)
    refs = refs / scale[:, None]
    products = _products(v, refs, reach)
    fits = np.linalg.lstsq(refs @ refs.T, products, rcond=1e-10)[0]
    explained = np.einsum("cl,cl->l", products, fits) / np.maximum(energy, 0.5 * energy[reach])
    best = _nearest_peak(explained, reach)
    correlation = float(np.sqrt(np.clip(explained[best], 0.0, 1.0)))
    # The noise of a signal that is differentiated twice is in the last third of the band.
    independent = 2.0 / 3.0 * min(band, 0.4 * rate) * count / rate
    spread = _spread(explained, best, max(1, round(_FALL * rate)), independent) / rate
    return Delay((best - reach + _vertex(explained, best)) / rate, correlation, spread)


def _products(v: Array, refs: Array, reach: int) -> Array:
    """Return sum_t v(t + l) r(t) for l from -reach to reach (..., 2 reach + 1), of references (..., N)."""
    size = next_fast_len(v.size + reach + 1, real=True)
    correlation = irfft(rfft(v, size) * rfft(refs, size).conj(), size)
    return np.concatenate((correlation[..., -reach:], correlation[..., : reach + 1]), axis=-1)


def _nearest_peak(explained: Array, reach: int) -> int:
    """Return the index of the peak closest to zero lag, at `reach`, among those that are as high as the highest one.

    Steady sines have such peaks at multiples of half a period, because the factor of the reference may be negative. A
    peak is the highest sample of a span in which all are that high: noise causes ripples on it.
    """
    high = np.concatenate([[0], explained >= EQUAL * explained.max(), [0]]).astype(np.int8)
    starts, stops = np.flatnonzero(np.diff(high) == 1), np.flatnonzero(np.diff(high) == -1)
    peaks = np.array([a + int(np.argmax(explained[a:b])) for a, b in zip(starts, stops, strict=True)])
    return int(peaks[np.argmin(np.abs(peaks - reach))])


def _vertex(heights: Array, top: int) -> float:
    """Return the position of a parabola's vertex relative to sample `top`, from -0.5 to 0.5; 0 at the ends."""
    if not 0 < top < heights.size - 1:
        return 0.0
    before, at, after = heights[top - 1 : top + 2]
    bend = before - 2.0 * at + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0


def _spread(explained: Array, top: int, reach: int, independent: float) -> float:
    """Return the standard deviation of a peak's position in samples.

    The fraction that is explained decreases from its peak E by E (w l)^2, where w is the RMS frequency of the motion.
    Noise moves the peak by sqrt((1 - E) / (n E)) / w, where n is the number of independent samples. The decrease is
    measured `reach` samples to either side, because closer to the peak it contains ripples of the noise.
    """
    at, last = float(explained[top]), explained.size - 1
    fall = at - 0.5 * float(explained[max(0, top - reach)] + explained[min(last, top + reach)])
    return reach * float(np.sqrt(max(0.0, 1.0 - at) / (independent * fall))) if fall > 0.0 else np.inf
