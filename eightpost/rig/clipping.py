"""Whether a channel of a dynamometer record is clipped: it stays at one value while another channel says that it moves.

- Velocity: it stays at its extreme where the slope of the displacement exceeds it.
- Displacement: it stays within a narrow band below its extreme while the integral of the velocity leaves the band and
  returns. Of a record without a measured velocity, the force shows the motion.
- Force: it has a flat top while the velocity varies. So has dry friction; but that has the noise of the
  channel, and approaches its level asymptotically or all at once, while a clipped force has a corner.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.rig.faults import Fault, fault
from eightpost.rig.motion import slopes
from eightpost.signals.faults import clipped_samples, runs
from eightpost.signals.filters import white_noise
from eightpost.signals.timeseries import TimeSeries

#: Smallest excess of the slope over a clipped velocity, as a share of its range, and ...
EXCESS = 0.02
#: ... largest standard deviation of the velocity there, as a share of that of the slope.
CONSTANT = 0.4
#: Band below the highest displacement: shares of the range, standard deviations of noise, steps of the resolution.
BAND = (0.003, 8.0, 3.0)
BEYOND = 3.0  #: Multiple of the band by which the integral of the velocity leaves it and returns.
#: Smallest range of the force while a displacement without a velocity is at its extreme, as a share of its range.
FORCE_MOVES = 0.2
BULGE = 0.02  #: Smallest bulge of the force while a velocity without a displacement is constant, as such a share.
#: Smallest course of a measured and of a derived velocity in a flat top of the force, over its range, ...
VARIES = (0.01, 0.05)
CLEAR, SCATTER = 6.0, 2.0  #: ... and in standard errors; or smallest standard deviation there, as a multiple.
STILL = 0.25  #: Largest noise in a flat top of a clipped force, over that of the rest.
WHITE = -0.3  #: Largest correlation of successive third differences of noise: white -0.75, smooth 1.
#: Depths below the top that are compared: share of the range, standard deviations of noise, steps of the resolution.
CORNER, DEEPEST = (0.005, 6.0, 2.0), 0.08
#: Samples between two and four depths over those between one and two: 2 at a corner, 1 at an exponential approach,
#: many more at a step.
CONVEX, STEP, FEWEST = 1.4, 4.0, 15
RESOLVED = 4  #: Fewest samples there of a peak.
SLOW = 0.15  #: Speed below which a force that reaches its level is friction, as a share of the peak.


def clipping_faults(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[Fault]:
    """Yield a fault for each channel of a record that is clipped; force only if the motion is sound."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    tops = [("velocity", *top) for top in _velocity(even, measured)]
    tops += [("displacement", *top) for top in _displacement(even, measured)]
    for name, value, share in tops or [("force", *top) for top in _force(even, measured)]:
        unit, factor = {"velocity": ("mm/s", 1e3), "displacement": ("mm", 1e3), "force": ("N", 1.0)}[name]
        figure = f"{100.0 * share:.2g} % of the samples are at {factor * value:.4g} {unit}"
        yield fault("clipped channel", f"the {name} is clipped", figure)


def _velocity(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[tuple[float, float]]:
    """Yield value and share of samples at which the velocity is clipped."""
    if "velocity" not in measured:
        return
    raw = series["velocity"]
    if "displacement" not in series:
        force = series["force"]
        for top in flat_tops(raw):
            _, curvature, error = top.course(force)
            if -top.sign * curvature > max(BULGE * float(np.ptp(force)), 4.0 * error):
                yield top.value, top.share
        return
    velocity, slope, rate = slopes(series)
    edge, span = int(5.0 * rate / min(50.0, 0.4 * rate)), float(np.ptp(raw))  # the filter rings at the ends
    near = EXCESS * span + 4.0 * white_noise(raw)
    cutoff = min(50.0, 0.4 * rate)  # noise of the displacement is in the slope up to there
    noise = 2.0 * np.pi * cutoff * np.sqrt(2.0 * cutoff / (3.0 * rate)) * white_noise(series["displacement"])
    excess = max(EXCESS * span, 4.0 * noise)
    for sign, top in ((1.0, float(raw.max())), (-1.0, -float(raw.min()))):
        beyond = np.flatnonzero(sign * (slope - velocity)[edge : raw.size - edge] > excess) + edge
        if beyond.size < SHARE * raw.size or raw[beyond].std() > CONSTANT * slope[beyond].std():
            continue
        level = float(np.median(raw[beyond]))
        if abs(sign * level - top) < near:
            yield level, float(np.mean(np.abs(raw - level) <= near))


def _displacement(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[tuple[float, float]]:
    """Yield value and share of samples at which the displacement is clipped."""
    if "displacement" not in measured:
        return
    values = series["displacement"]
    if "velocity" not in measured:
        force = series["force"]
        for top in flat_tops(values):
            if np.ptp(np.quantile(force[top.samples], [0.1, 0.9])) > FORCE_MOVES * np.ptp(force):
                yield top.value, top.share
        return
    _, slope, rate = slopes(series)
    path = np.cumsum(series["velocity"] - np.mean(series["velocity"] - slope)) / rate
    band = max(np.array(BAND) * (np.ptp(values), white_noise(values), resolution(values)))
    for signed, moved, sign in ((values, path, 1.0), (-values, -path, -1.0)):
        top = float(np.partition(signed, -1 - values.size // 1000)[-1 - values.size // 1000])
        high = [(start, stop) for start, stop in runs(signed > top - band) if stop - start > 2]
        left = [
            stop - start
            for start, stop in high
            if moved[start:stop].max() - max(moved[start], moved[stop - 1]) > BEYOND * band
        ]
        if sum(left) >= SHARE * values.size:
            yield sign * top, sum(left) / values.size


def _force(series: TimeSeries, measured: tuple[str, ...]) -> Iterator[tuple[float, float]]:
    """Yield value and share of samples at which the force is clipped."""
    force, velocity = series["force"], series["velocity"]
    varies = VARIES["velocity" not in measured] * float(np.ptp(velocity))
    tops = list(flat_tops(force))
    for top in tops:
        slope, curvature, error = top.course(velocity)
        is_moving = max(abs(slope), abs(curvature)) > max(varies, CLEAR * error)
        if not is_moving and velocity[top.samples].std() < SCATTER * varies:
            continue
        is_exact = len(tops) == 1 and _is_exact(force, velocity, top)  # friction is flat in both strokes
        if is_exact or _is_still(force, top) or _has_corner(force, velocity, top):
            yield top.value, top.share


def _is_still(force: Array, top: FlatTop) -> bool:
    """Return whether the flat top of a force (N,) has far less white noise than the rest."""
    changes = np.diff(force, 3)
    outside = ~np.convolve(np.abs(force - top.value) <= 1e-3 * np.ptp(force), np.ones(4, bool), "valid")[: changes.size]
    if np.count_nonzero(outside) < 4 * FEWEST:
        return False
    noise = float(np.median(np.abs(changes[outside]))) / (0.6745 * np.sqrt(20.0))
    limited = np.clip(changes, -10.0 * noise, 10.0 * noise)
    pairs = limited[1:][outside[1:] & outside[:-1]], limited[:-1][outside[1:] & outside[:-1]]
    inside = float(np.median(np.abs(force[top.samples] - top.value))) / 0.6745
    return bool(inside < STILL * noise and noise > 1.5 * resolution(force) and float(np.corrcoef(*pairs)[0, 1]) < WHITE)


def _is_exact(force: Array, velocity: Array, top: FlatTop) -> bool:
    """Return whether a force (N,) has exactly one value in a flat top, but not at low speed."""
    equal = np.abs(force - top.value) <= 1e-9 * np.ptp(force)
    if not equal[top.samples].all():
        return False
    return bool(np.quantile(np.abs(velocity[equal]), 0.05) > SLOW * np.abs(velocity).max())


def _has_corner(force: Array, velocity: Array, top: FlatTop) -> bool:
    """Return whether a force (N,) reaches its flat top with a corner, and not at low speed."""
    span = float(np.ptp(force))
    below, depth = top.sign * (top.value - force), max(np.array(CORNER) * (span, white_noise(force), resolution(force)))
    while depth < DEEPEST * span:
        near, far = (below >= depth) & (below < 2.0 * depth), (below >= 2.0 * depth) & (below < 4.0 * depth)
        first, second = np.count_nonzero(near), np.count_nonzero(far)
        if first + second >= max(FEWEST, RESOLVED * top.peaks):
            speed = float(np.median(np.abs(velocity[near | far])))
            is_convex = second - CONVEX * first > 0.5 * np.sqrt(second + 2.0 * first)
            return bool(is_convex and second < STEP * first and speed > SLOW * float(np.abs(velocity).max()))
        depth *= 1.5
    return False


# ---- Flat tops: peaks that end at one value, which neither a smooth motion nor noise explains -----------------------
#
# A peak of a smooth channel is a parabola: of its depth, a quarter is within its middle half. A flat top is a level:
# over the middles of all peaks together, slope and curvature are zero within their errors. Whether an instrument is
# clipped or the quantity itself stays constant (a rest, a triangle, dry friction) is seen only in another channel.

#: Depths below the extreme at which peaks begin, as shares of the range. The smallest one above the noise is used.
DEPTHS = (0.005, 0.01, 0.02, 0.04)
NOISE, STEPS = 8.0, 4.0  #: Smallest depth in standard deviations of white noise, and in steps of the resolution.
PEAK, PEAKS, MIDDLES = 5, 2, 12  #: Fewest samples of a peak, fewest peaks, and fewest samples of all their middles.
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
    if len(peaks) < PEAKS or sum(part.size for part in parts) < MIDDLES:
        return None
    samples, place = np.concatenate(parts), np.concatenate([p[kept] for p, kept in zip(places, inside, strict=True)])
    level = float(np.median(values[samples]))
    return FlatTop(sign, level, samples, place, float(np.mean(np.abs(values - level) <= near)), len(peaks))
