"""Time lags between channels, loggers and runs, found by cross-correlation.

Two loggers that were started by hand, or one that filters, put channels out of step; a response estimated over them has
a false phase of 360 f lag degrees. What must be in step is known from mechanics:

- a shock's travel, twice differentiated, goes with hub minus chassis acceleration of its axle's two corners;
- the tire forces together, less the aeroloaders', go with the accelerations (Newton's law of the whole car);
- a shock's force goes with its velocity, but for the few milliseconds of its own lag.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import CubicSpline

from eightpost.signals.filters import derivative, lowpass
from eightpost.signals.timeseries import TimeSeries

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Longest lag that is looked for [s].
LONGEST = 0.5

#: Longest difference of the starts of two runs [s].
LONGEST_START = 10.0

#: Band of the comparisons [Hz], at most 0.4 of the sample rate.
BAND = 20.0

#: Length of record that is compared [s]: longer ones cost seconds and tell no more.
SPAN = 60.0

#: Up to this a lag is what a filter or a shock's own lag makes of it [s].
SAME_LAG = 2e-3

#: A lag is told from none by this many of its standard deviations.
CERTAIN = 5.0

#: How far from its top a correlation's fall is measured [s].
_FALL = 0.025

#: Lags of a likeness below this are chance, or another mechanism than the one looked for.
LIKE = 0.6


class Lag(NamedTuple):
    """How late a channel is.

    Attributes:
        channel: The channel, or the group of channels.
        against: What it must go with.
        seconds: Positive where `channel` comes late [s].
        likeness: Multiple correlation at that lag [1].
        usual: Lag up to which nothing is wrong [s].
        spread: Standard deviation of the lag [s]: noise moves the flat top of a slow motion's correlation far.
    """

    channel: str
    against: str
    seconds: float
    likeness: float
    usual: float
    spread: float = 0.0

    @property
    def is_notable(self) -> bool:
        """Whether the channel is out of step."""
        return self.likeness >= LIKE and abs(self.seconds) > self.usual + CERTAIN * self.spread

    def __str__(self) -> str:
        where = "after" if self.seconds >= 0.0 else "before"
        return (
            f"{self.channel} comes {1e3 * abs(self.seconds):.2f} ms {where} {self.against} "
            f"(correlation {self.likeness:.2f})"
        )


def time_lag(values: Array, references: Array, rate: float, *, longest: float = LONGEST) -> tuple[float, float]:
    """Return by how much `values` come late, and how well references explain them then.

    The lag l has the largest multiple correlation of v(t + l) with the references; between samples it is the top of a
    parabola.

    Args:
        values: v (N,).
        references: (N,) or (C, N), one or several; a combination of them is looked for.
        rate: Samples per second [Hz].
        longest: Lag to either side that is looked for [s].

    Returns:
        The lag [s] and the multiple correlation [1]; (0, 0) where something does not move.
    """
    found = _peak(values, references, rate, longest)
    return found.seconds, found.likeness


class _Peak(NamedTuple):
    """The top of a correlation over lags."""

    seconds: float
    likeness: float
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
    best = int(np.argmax(explained))
    likeness = float(np.sqrt(np.clip(explained[best], 0.0, 1.0)))
    # What is differentiated twice has its noise in the last third of the band.
    independent = 2.0 / 3.0 * min(BAND, 0.4 * rate) * v.size / rate
    spread = _spread(explained, best, max(1, round(_FALL * rate)), independent) / rate
    return _Peak((best - reach + _vertex(explained, best)) / rate, likeness, spread)


def _products(v: Array, refs: Array, reach: int) -> Array:
    """Return sum_t v(t + l) r_c(t) for l from -reach to reach (C, 2 reach + 1)."""
    size = next_fast_len(v.size + reach + 1, real=True)
    correlation = irfft(rfft(v, size) * rfft(refs, size).conj(), size)
    return np.concatenate((correlation[:, -reach:], correlation[:, : reach + 1]), axis=1)


def _vertex(heights: Array, top: int) -> float:
    """Return the place of a parabola's top between samples, from -0.5 to 0.5; 0 at the ends."""
    if not 0 < top < heights.size - 1:
        return 0.0
    before, at, after = heights[top - 1 : top + 2]
    bend = before - 2.0 * at + after
    return float(0.5 * (before - after) / bend) if bend < 0.0 else 0.0


def record_lags(series: TimeSeries, corners: Sequence[str]) -> tuple[Lag, ...]:
    """Return the lags within the first `SPAN` of a record, of those mechanisms whose channels it has.

    Args:
        series: A rig record.
        corners: Its corners; one empty name for a quarter car.
    """
    return _lags(series.window(series.time[0], series.time[0] + SPAN), corners)


def drifts(series: TimeSeries, corners: Sequence[str]) -> tuple[Lag, ...]:
    """Return by how much more channels are late at the end of a record than at its start, where that is notable.

    Samples that a logger lost without a gap in its time, or two clocks of different pace, show as such a drift.

    Args:
        series: A rig record; what is shorter than two spans is compared by its halves.
        corners: Its corners; one empty name for a quarter car.
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
            likeness=min(early.likeness, late.likeness),
            usual=2.0 * SAME_LAG,
            spread=float(np.hypot(early.spread, late.spread)),
        )
        for early, late in pairs
    ]
    return tuple(change for change in changes if change.is_notable)


def _lags(series: TimeSeries, corners: Sequence[str]) -> tuple[Lag, ...]:
    compared = _Compared(series, tuple(corners))
    found = [compared.travel(corner) for corner in corners]
    found += [compared.force(corner) for corner in corners]
    found.append(compared.loads())
    return tuple(lag for lag in found if lag is not None)


def drive_lag(series: TimeSeries, first: TimeSeries, channel: str) -> Lag:
    """Return how much later the same drive runs in a record than in the first, by a channel of both.

    Args:
        series: A record.
        first: Another one at the same rate.
        channel: A wheelloader's position, best.
    """
    size, rate = min(len(series), len(first)), series.sample_rate
    rough, _ = time_lag(series[channel][:size], first[channel][:size], rate, longest=LONGEST_START)
    late = round(rough * rate)
    # Once more over what both have: ends that only one has pull the peak.
    own, other = series[channel][max(late, 0) :], first[channel][max(-late, 0) :]
    size = min(own.size, other.size)
    rest, likeness = time_lag(own[:size], other[:size], rate, longest=2.0 / rate)
    return Lag(channel, "that of the first record", late / rate + rest, likeness, 0.5 / rate)


def shifted(series: TimeSeries, delays: Mapping[str, float]) -> TimeSeries:
    """Return the record with late channels brought forward by their delays, by cubic splines.

    The record loses the ends that not all channels have.

    Args:
        series: An evenly sampled record.
        delays: By how much each channel comes late [s]; those not named stay.

    Raises:
        MissingChannelError: The record has no such channel.
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
    """Return the standard deviation of a top's place in samples.

    The share that a lag explains falls from its top E by E (w l)^2, w the motion's RMS frequency, and noise moves the
    top by sqrt((1 - E) / (n E)) / w, n the number of independent samples. The fall is measured `reach` samples to
    either side: nearer, ripples of the noise are in it.
    """
    at, last = float(explained[top]), explained.size - 1
    fall = at - 0.5 * float(explained[max(0, top - reach)] + explained[min(last, top + reach)])
    return reach * float(np.sqrt(max(0.0, 1.0 - at) / (independent * fall))) if fall > 0.0 else np.inf


_AT_CORNERS = (
    "displacement", "velocity", "force", "tire_force", "hub_acceleration", "chassis_acceleration", "aero",
)  # fmt: skip
_ONCE = ("aero_force", "heave_force")


class _Compared:
    """The channels of one record, made comparable."""

    def __init__(self, series: TimeSeries, corners: tuple[str, ...]) -> None:
        self._corners, self._rate = corners, series.sample_rate
        wanted = {*(_name(corner, quantity) for corner in corners for quantity in _AT_CORNERS), *_ONCE}
        chosen = series.select([name for name in series.names if name in wanted])
        centred = chosen.values - chosen.values.mean(axis=1, keepdims=True)
        low = lowpass(centred, self._rate, min(BAND, 0.4 * self._rate))
        self._low = dict(zip(chosen.names, low, strict=True))

    def travel(self, corner: str) -> Lag | None:
        """The potentiometer against the accelerometers above and below it, and across the axle.

        A shock that sits inboard on a solid axle moves with both of its wheels.
        """
        pot = _name(corner, "displacement")
        across = [other for other in self._axle(corner) if other != corner]
        if not self._there([pot, *self._accelerometers(corner)]):
            return None
        compared = [corner, *(other for other in across if self._there(self._accelerometers(other)))]
        relative = [self._low[hub] - self._low[chassis] for hub, chassis in map(self._accelerometers, compared)]
        bend = derivative(derivative(self._low[pot], self._rate), self._rate)
        return self._lag(pot, "the accelerometers", bend, np.stack(relative), SAME_LAG)

    def _axle(self, corner: str) -> tuple[str, ...]:
        front = corner in self._corners[:2]
        return self._corners[:2] if front else self._corners[2:]

    def _accelerometers(self, corner: str) -> tuple[str, str]:
        return _name(corner, "hub_acceleration"), _name(corner, "chassis_acceleration")

    def force(self, corner: str) -> Lag | None:
        """The load cell against the velocity of its shock."""
        force, velocity = _name(corner, "force"), _name(corner, "velocity")
        if not self._there([force, velocity]):
            return None
        return self._lag(force, velocity, self._low[force], self._low[velocity], 0.015)

    def loads(self) -> Lag | None:
        """The tire forces against the accelerations, over the whole car."""
        quantities = ("tire_force", "hub_acceleration", "chassis_acceleration")
        if not all(self._there([_name(corner, quantity) for corner in self._corners]) for quantity in quantities):
            return None
        total = self._sum("tire_force", self._corners)
        down = [name for name in (*(_name(c, "aero") for c in self._corners), "aero_force") if name in self._low]
        up = [name for name in ("heave_force",) if name in self._low]
        total = total - sum((self._low[name] for name in down), start=np.zeros(total.size))
        total = total + sum((self._low[name] for name in up), start=np.zeros(total.size))
        axles = [part for part in (self._corners[:2], self._corners[2:]) if part]
        inertia = np.stack([self._sum(quantity, axle) for quantity in quantities[1:] for axle in axles])
        return self._lag("tire_force", "the accelerometers", total, inertia, SAME_LAG)

    def _lag(self, channel: str, against: str, values: Array, references: Array, usual: float) -> Lag:
        top = _peak(values, references, self._rate)
        return Lag(channel, against, top.seconds, top.likeness, max(usual, 0.5 / self._rate), top.spread)

    def _sum(self, quantity: str, corners: Sequence[str]) -> Array:
        return np.asarray(np.sum([self._low[_name(corner, quantity)] for corner in corners], axis=0))

    def _there(self, names: Sequence[str]) -> bool:
        return all(name in self._low for name in names)


def _name(corner: str, quantity: str) -> str:
    return f"{corner}.{quantity}" if corner else quantity
