"""Flat tops: peaks of a channel that end at one value, which neither a smooth motion nor noise explains.

A peak of a smooth channel is a parabola: of its depth, a quarter is within its middle half. A flat top is a level: over
the middles of all peaks together, slope and curvature are zero within their errors. Whether an instrument is clipped or
the quantity itself stays constant (a rest, a triangle, dry friction) is seen only in another channel.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.signals.faults import clipped_samples, runs
from eightpost.signals.filters import white_noise

#: Depths below the extreme at which peaks begin, as shares of the range. The smallest one above the noise is used.
DEPTHS = (0.005, 0.01, 0.02, 0.04)
NOISE, STEPS = 8.0, 4.0  #: Smallest depth in standard deviations of white noise, and in steps of the resolution.
PEAK, PEAKS, FEWEST = 5, 2, 12  #: Fewest samples of a peak, fewest peaks, and fewest samples of all their middles.
MIDDLE = 0.6  #: Middle of a peak, whose ends are at -1 and 1.
LONG = 0.5  #: Smallest length of a peak, over that of the longest one: short ones hardly reach the level.
ERRORS, SURE = 2.5, 0.08  #: Slope and curvature of a flat top in standard errors, and their largest error in depths.
SHARE = 0.01  #: Smallest share of the record.
OUTLIERS = 1000  #: One sample of so many may be above the top.


class FlatTop(NamedTuple):
    """Samples of a channel at its highest (`sign` 1) or lowest (-1) value."""

    sign: float
    value: float
    samples: NDArray[np.intp]  #: Samples in the middles of the peaks (K,).
    place: Array  #: Their places (K,) in the peak, from -1 to 1.
    share: float  #: Share of the record that is at the value [1].
    peaks: int  #: Number of peaks.

    def course(self, values: Array) -> tuple[float, float, float]:
        """Return slope and curvature of a channel (N,) over the place in a peak, and the larger standard error."""
        columns = np.stack([np.ones_like(self.place), self.place, self.place**2], axis=1)
        inverse = np.linalg.pinv(columns)
        weights = inverse @ values[self.samples]
        scatter = float((values[self.samples] - columns @ weights).std())
        return float(weights[1]), float(weights[2]), scatter * float(np.sqrt((inverse[1:] ** 2).sum(axis=1).max()))


def flat_tops(values: Array) -> Iterator[FlatTop]:
    """Yield the flat top at the highest and at the lowest value of a channel (N,), if there is one."""
    noise, span = white_noise(values), float(np.ptp(values))
    least = max(NOISE * noise, STEPS * resolution(values))
    for sign in (1.0, -1.0):
        signed = sign * values
        top = float(np.partition(signed, -1 - values.size // OUTLIERS)[-1 - values.size // OUTLIERS])
        for depth in (share * span for share in DEPTHS if share * span >= least):
            found = _top(sign, values, _peaks(signed, top, depth), max(4.0 * noise, 0.05 * depth))
            if found is not None:
                slope, curvature, error = found.course(values)
                is_flat = np.hypot(slope, curvature) < ERRORS * error + 1e-3 * depth and error < SURE * depth
                if is_flat and found.share >= SHARE:
                    yield found
                    break
        else:
            clipped = np.isin(np.arange(values.size), clipped_samples(signed, np.ones(values.size, dtype=bool)))
            found = _top(sign, values, runs(clipped), 1e-9 * span)
            if found is not None:
                yield found


def resolution(values: Array) -> float:
    """Return the step of a rounded channel (N,), of which all differences are multiples; 0 if it is not rounded."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-9 * float(np.ptp(values))]
    if not steps.size:
        return 0.0
    ratio = steps / steps.min()
    return float(steps.min()) if float(np.abs(ratio - np.round(ratio)).max()) < 0.1 else 0.0


def _peaks(values: Array, top: float, depth: float) -> list[tuple[int, int]]:
    """Return the first sample, and the one after the last, of the peaks that reach the top and stay there for long."""
    high = [(a, b) for a, b in runs(values > top - depth) if values[a:b].max() > top - 0.5 * depth]
    longest = max(stop - start for start, stop in high)
    return [(start, stop) for start, stop in high if stop - start >= max(PEAK, LONG * longest)]


def _top(sign: float, values: Array, peaks: list[tuple[int, int]], near: float) -> FlatTop | None:
    """Return the top of peaks of a channel (N,), with the samples `near` its value; None if there are too few."""
    places = [np.linspace(-1.0, 1.0, stop - start) for start, stop in peaks]
    inside = [np.abs(place) <= MIDDLE for place in places]
    parts = [np.arange(*peak)[kept] for peak, kept in zip(peaks, inside, strict=True)]
    if len(peaks) < PEAKS or sum(part.size for part in parts) < FEWEST:
        return None
    samples, place = np.concatenate(parts), np.concatenate([p[kept] for p, kept in zip(places, inside, strict=True)])
    level = float(np.median(values[samples]))
    return FlatTop(sign, level, samples, place, float(np.mean(np.abs(values - level) <= near)), len(peaks))
