"""Delays between loggers, and lost channels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import CubicSpline

from eightpost.array_types import Array
from eightpost.corners import channel
from eightpost.errors import ConstantChannelError
from eightpost.signals.filters import derivative, lowpass
from eightpost.signals.timeseries import TimeSeries

# ---- Check for channels that fail during a record: a cable breaks, or a logger repeats its last value ---------------

#: Time for which a failed channel repeats one value [s] ...
HELD = 0.25
#: ... and fraction of its samples in which another channel changes if it moves [1].
MOVING = 0.5

_RESPONSES = ("tire_force", "displacement", "force", "hub_acceleration", "chassis_acceleration")


def check_lost_channels(series: TimeSeries, corners: Sequence[str], *, path: Path | None = None) -> None:
    """Check that no channel becomes constant while the others move.

    Args:
        series: Rig record.
        corners: Names of its corners; one empty name for a quarter car.
        path: Path of its file, for messages.

    Raises:
        ConstantChannelError: A channel becomes constant.
    """
    names = [f"{c}.{q}" if c else q for q in _RESPONSES for c in corners]
    there = [name for name in names if name in series]
    for name in there:
        start, stop = longest_hold(series[name])
        span = (stop - start) / series.sample_rate
        if span < HELD or not others_move(series, there, name, slice(start, stop)):
            continue
        where = f"from {series.time[start]:.4g} s to {series.time[stop]:.4g} s"
        what = (
            f"it stays at {series[name][start]:.6g} (SI) {where} ({span:.3g} s) while the other channels move: a cable "
            "or a logger failed there; remove that part of the record, or remove the channel from the map"
        )
        raise ConstantChannelError(what, path=path, channel=name)


def longest_hold(values: Array) -> tuple[int, int]:
    """Return the first and the last sample of the longest run of one value."""
    edges = np.flatnonzero(np.diff(values) != 0.0) + 1
    bounds = np.concatenate(([0], edges, [values.size]))
    longest = int(np.argmax(np.diff(bounds)))
    return int(bounds[longest]), int(bounds[longest + 1]) - 1


def others_move(series: TimeSeries, names: Sequence[str], own: str, held: slice) -> bool:
    """Return whether most of the other channels change in most samples of a span; a resting rig moves none."""
    moving = [np.mean(np.diff(series[name][held]) != 0.0) > MOVING for name in names if name != own]
    return bool(moving) and float(np.mean(moving)) > 0.5


# ---- Time lags between channels, loggers and runs, estimated by cross-correlation -----------------------------------

#: Longest lag that is searched for [s].
LONGEST = 0.5

#: Longest time between the starts of two runs [s].
LONGEST_START = 10.0

#: Upper end of the band of the comparisons [Hz], at most 0.4 of the sample rate.
BAND = 20.0

#: Length of record that is compared [s]; longer ones take seconds and give no better result.
SPAN = 60.0

#: Longest lag of a potentiometer in a sound record [s]: rubber in series with its shock makes it late by up to 6 ms. A
#: single late potentiometer follows from the laws of the corners (`plausibility`).
TRAVEL_LAG = 8e-3

#: Longest lag of the sum of the tire forces in a sound record [s]: an engine on its mounts, whose acceleration is not
#: measured, shifts it by up to 30 ms. Shorter delays of tire forces follow from the law of the tire (`plausibility`).
LOAD_LAG = 50e-3

#: Longest change of a lag within a sound record [s]; that of the tire forces may reach `LOAD_LAG`.
DRIFT = 4e-3

#: Number of its standard deviations by which a lag must exceed the threshold.
DEVIATIONS = 5.0

#: Share of the highest correlation, squared, from which another peak counts as equally high.
EQUAL = 0.95

#: Distance from the peak of a correlation at which its decrease is measured [s].
_FALL = 0.025

#: Smallest correlation of a lag; below it the lag is chance or has another cause.
SMALLEST_CORRELATION = 0.6


class Lag(NamedTuple):
    """Time lag of a channel."""

    channel: str  #: Name of the channel or of the group of channels.
    against: str  #: Reference that the channel must be in step with.
    seconds: float  #: Lag [s]; positive if `channel` is late.
    correlation: float  #: Multiple correlation at that lag [1].
    usual: float  #: Lag up to which the channel is considered in step [s].
    #: Standard deviation of the lag [s]; it is large for slow motions, whose correlation has a flat peak.
    spread: float = 0.0

    @property
    def is_notable(self) -> bool:
        """Whether the channel is out of step."""
        is_certain = abs(self.seconds) > self.usual + DEVIATIONS * self.spread
        return self.correlation >= SMALLEST_CORRELATION and is_certain

    @property
    def drift_text(self) -> str:
        """Description of a lag that `drifts` returned."""
        return (
            f"{self.channel} falls behind {self.against} by {1e3 * self.seconds:.2f} ms: a logger lost samples, or two "
            "clocks differ"
        )

    def __str__(self) -> str:
        side = "behind" if self.seconds >= 0.0 else "ahead of"
        return (
            f"{self.channel} is {1e3 * abs(self.seconds):.2f} ms {side} {self.against} "
            f"(correlation {self.correlation:.2f})"
        )


def time_lag(values: Array, references: Array, rate: float, *, longest: float = LONGEST) -> tuple[float, float]:
    """Return the lag of `values` behind the references, and their correlation at that lag.

    The lag l maximises the multiple correlation of v(t + l) with the references; between samples a parabola is
    interpolated.

    Args:
        values: Samples v (N,).
        references: One or several reference signals (N,) or (C, N); their best linear combination is used.
        rate: Sample rate [Hz].
        longest: Longest lag to either side that is searched [s].

    Returns:
        Lag [s] and multiple correlation [1]; (0, 0) if a signal is constant.
    """
    peak = _peak(values, references, rate, longest)
    return peak.seconds, peak.correlation


class _Peak(NamedTuple):
    """Peak of a correlation over lags."""

    seconds: float
    correlation: float
    spread: float


def _peak(values: Array, references: Array, rate: float, longest: float = LONGEST) -> _Peak:
    v, refs = values - values.mean(), np.atleast_2d(references)
    refs = refs - refs.mean(axis=1, keepdims=True)
    scale = np.linalg.norm(refs, axis=1)
    energy = float(v @ v)
    if energy == 0.0 or not scale.all():
        return _Peak(0.0, 0.0, 0.0)
    refs = refs / scale[:, None]
    reach = max(1, min(v.size - 2, round(longest * rate)))
    products = _products(v, refs, reach)
    explained = np.einsum("cl,cl->l", products, np.linalg.lstsq(refs @ refs.T, products, rcond=1e-10)[0]) / energy
    best = _nearest_peak(explained, reach)
    correlation = float(np.sqrt(np.clip(explained[best], 0.0, 1.0)))
    # The noise of a signal that is differentiated twice is in the last third of the band.
    independent = 2.0 / 3.0 * min(BAND, 0.4 * rate) * v.size / rate
    spread = _spread(explained, best, max(1, round(_FALL * rate)), independent) / rate
    return _Peak((best - reach + _vertex(explained, best)) / rate, correlation, spread)


def _products(v: Array, refs: Array, reach: int) -> Array:
    """Return sum_t v(t + l) r_c(t) for l from -reach to reach (C, 2 reach + 1)."""
    size = next_fast_len(v.size + reach + 1, real=True)
    correlation = irfft(rfft(v, size) * rfft(refs, size).conj(), size)
    return np.concatenate((correlation[:, -reach:], correlation[:, : reach + 1]), axis=1)


def _nearest_peak(explained: Array, reach: int) -> int:
    """Return the index of the peak closest to zero lag, at `reach`, among those that are as high as the highest one.

    Steady sines have such peaks at multiples of half a period, because the factor of the reference may be negative.
    """
    inside = explained[1:-1]
    tops = 1 + np.flatnonzero((inside >= explained[:-2]) & (inside > explained[2:]))
    top = int(np.argmax(explained))
    equal = np.append(tops[explained[tops] >= EQUAL * explained[top]], top)
    return int(equal[np.argmin(np.abs(equal - reach))])


def _vertex(heights: Array, top: int) -> float:
    """Return the position of a parabola's vertex relative to sample `top`, from -0.5 to 0.5; 0 at the ends."""
    if not 0 < top < heights.size - 1:
        return 0.0
    before, at, after = heights[top - 1 : top + 2]
    bend = before - 2.0 * at + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0


def record_lags(series: TimeSeries, corners: Sequence[str]) -> tuple[Lag, ...]:
    """Return the lags in the first `SPAN` of a record, for all mechanisms whose channels it contains.

    Args:
        series: Rig record.
        corners: Names of its corners; one empty name for a quarter car.
    """
    return _lags(series.window(series.time[0], series.time[0] + SPAN), corners)


def drifts(series: TimeSeries, corners: Sequence[str]) -> tuple[Lag, ...]:
    """Return the notable changes of lags between the start and the end of a record.

    Such a drift appears if a logger lost samples without a gap in its time, or if two clocks run at different rates.

    Args:
        series: Rig record; if it is shorter than two spans, its halves are compared.
        corners: Names of its corners; one empty name for a quarter car.
    """
    span = min(SPAN, 0.5 * series.duration)
    first, last = series.time[0], series.time[-1]
    pairs = zip(
        _lags(series.window(first, first + span), corners),
        _lags(series.window(last - span, last), corners),
        strict=True,
    )
    changes = [
        late._replace(
            seconds=late.seconds - early.seconds,
            correlation=min(early.correlation, late.correlation),
            usual=late.usual if late.channel == "tire_force" else DRIFT,
            spread=float(np.hypot(early.spread, late.spread)),
        )
        for early, late in pairs
    ]
    return tuple(change for change in changes if change.is_notable)


def _lags(series: TimeSeries, corners: Sequence[str]) -> tuple[Lag, ...]:
    comparison = _Comparison(series, tuple(corners))
    lags = [comparison.travel(corner) for corner in corners]
    lags += [comparison.force(corner) for corner in corners]
    lags.append(comparison.loads())
    return tuple(lag for lag in lags if lag is not None)


def drive_lag(series: TimeSeries, first: TimeSeries, channel: str) -> Lag:
    """Return the lag of the drive in a record behind the same drive in the first record, from a channel of both.

    Args:
        series: Record.
        first: First record, at the same rate.
        channel: Name of the channel, preferably a wheelloader's position.
    """
    size, rate = min(len(series), len(first)), series.sample_rate
    rough, _ = time_lag(series[channel][:size], first[channel][:size], rate, longest=LONGEST_START)
    late = round(rough * rate)
    # Repeated over the common part, because ends that only one record has displace the peak.
    own, other = series[channel][max(late, 0) :], first[channel][max(-late, 0) :]
    size = min(own.size, other.size)
    rest, correlation = time_lag(own[:size], other[:size], rate, longest=2.0 / rate)
    return Lag(channel, "that of the first record", late / rate + rest, correlation, 0.5 / rate)


def advance_channels(series: TimeSeries, delays: Mapping[str, float]) -> TimeSeries:
    """Return the record with late channels advanced by their delays, by cubic splines.

    The ends of the record that not all channels cover are removed.

    Args:
        series: Evenly sampled record.
        delays: Delay of each late channel [s]; other channels do not change.

    Raises:
        MissingChannelError: A channel is not in the record.
    """
    moved = {series.names.index(name): delay for name, delay in delays.items() if series[name].size and delay}
    if not moved:
        return series
    step, time, values = 1.0 / series.sample_rate, series.time, series.values.copy()
    for row, delay in moved.items():
        values[row] = CubicSpline(time, values[row])(time + delay)
    late, early = max(0.0, *moved.values()), max(0.0, *(-delay for delay in moved.values()))
    kept = slice(int(np.ceil(early / step - 1e-9)), len(series) - int(np.ceil(late / step - 1e-9)))
    return TimeSeries(time[kept], values[:, kept], series.names, series.units)


def _spread(explained: Array, top: int, reach: int, independent: float) -> float:
    """Return the standard deviation of a peak's position in samples.

    The fraction that is explained decreases from its peak E by E (w l)^2, where w is the RMS frequency of the motion.
    Noise moves the peak by sqrt((1 - E) / (n E)) / w, where n is the number of independent samples. The decrease is
    measured `reach` samples to either side, because closer to the peak it contains ripples of the noise.
    """
    at, last = float(explained[top]), explained.size - 1
    fall = at - 0.5 * float(explained[max(0, top - reach)] + explained[min(last, top + reach)])
    return reach * float(np.sqrt(max(0.0, 1.0 - at) / (independent * fall))) if fall > 0.0 else np.inf


_AT_CORNERS = (
    "displacement", "velocity", "force", "tire_force", "hub_acceleration", "chassis_acceleration", "aero",
)  # fmt: skip
_ONCE = ("aero_force", "heave_force")


class _Comparison:
    """Low-passed channels of one record, for comparison with each other."""

    def __init__(self, series: TimeSeries, corners: tuple[str, ...]) -> None:
        self._corners, self._rate = corners, series.sample_rate
        known = {*(channel(corner, quantity) for corner in corners for quantity in _AT_CORNERS), *_ONCE}
        chosen = series.select([name for name in series.names if name in known])
        centred = chosen.values - chosen.values.mean(axis=1, keepdims=True)
        low = lowpass(centred, self._rate, min(BAND, 0.4 * self._rate))
        self._low = dict(zip(chosen.names, low, strict=True))

    def travel(self, corner: str) -> Lag | None:
        """Return the lag of the potentiometer behind the accelerometers above and below it, and across the axle.

        A shock that is mounted inboard on a solid axle moves with both wheels.
        """
        pot = channel(corner, "displacement")
        across = [other for other in self._axle(corner) if other != corner]
        if not self._there([pot, *self._accelerometers(corner)]):
            return None
        compared = [corner, *(other for other in across if self._there(self._accelerometers(other)))]
        relative = [self._low[hub] - self._low[chassis] for hub, chassis in map(self._accelerometers, compared)]
        bend = derivative(derivative(self._low[pot], self._rate), self._rate)
        return self._lag(pot, "the accelerometers", bend, np.stack(relative), TRAVEL_LAG)

    def _axle(self, corner: str) -> tuple[str, ...]:
        front = corner in self._corners[:2]
        return self._corners[:2] if front else self._corners[2:]

    def _accelerometers(self, corner: str) -> tuple[str, str]:
        return channel(corner, "hub_acceleration"), channel(corner, "chassis_acceleration")

    def force(self, corner: str) -> Lag | None:
        """Return the lag of the load cell behind the velocity of its shock."""
        force, velocity = channel(corner, "force"), channel(corner, "velocity")
        if not self._there([force, velocity]):
            return None
        return self._lag(force, velocity, self._low[force], self._low[velocity], 0.015)

    def loads(self) -> Lag | None:
        """Return the lag of the sum of the tire forces behind the accelerations of the whole car."""
        quantities = ("tire_force", "hub_acceleration", "chassis_acceleration")
        if not all(self._there([channel(corner, quantity) for corner in self._corners]) for quantity in quantities):
            return None
        total = self._sum("tire_force", self._corners)
        down = [name for name in (*(channel(c, "aero") for c in self._corners), "aero_force") if name in self._low]
        up = [name for name in ("heave_force",) if name in self._low]
        total = total - sum((self._low[name] for name in down), start=np.zeros(total.size))
        total = total + sum((self._low[name] for name in up), start=np.zeros(total.size))
        axles = [part for part in (self._corners[:2], self._corners[2:]) if part]
        inertia = np.stack([self._sum(quantity, axle) for quantity in quantities[1:] for axle in axles])
        return self._lag("tire_force", "the accelerometers", total, inertia, LOAD_LAG)

    def _lag(self, channel: str, against: str, values: Array, references: Array, usual: float) -> Lag:
        top = _peak(values, references, self._rate)
        return Lag(channel, against, top.seconds, top.correlation, max(usual, 0.5 / self._rate), top.spread)

    def _sum(self, quantity: str, corners: Sequence[str]) -> Array:
        return np.asarray(np.sum([self._low[channel(corner, quantity)] for corner in corners], axis=0))

    def _there(self, names: Sequence[str]) -> bool:
        return all(name in self._low for name in names)
