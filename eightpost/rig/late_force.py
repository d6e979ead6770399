"""Whether the force of a dynamometer record is late because of the instruments: the phase over the frequency.

A delay T shifts the phase of the force by -w T: linear in the frequency w. The causes in a shock do not. The phase of
friction and hysteresis saturates, so that their lag in seconds falls with the frequency; that of a gas spring falls
itself; and the lag of a compressible fluid is short. The lag is the time by which the force must be advanced so that a
curve over velocity explains it best,

    min over T, f, k of  sum (F(t + T) - f(v) - k x)^2

with f linear between knots. With k of the whole record, it is found again in a lower and in an upper band of
frequencies, with the columns of f filtered like the force. In a record with a single frequency, and in one whose
phase is too small to be distinguished from hysteresis, the delay is unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfiltfilt

from eightpost.array_types import Array
from eightpost.rig.plausibility_rules import LATE
from eightpost.signals.filters import lowpass
from eightpost.signals.timeseries import TimeSeries
from eightpost.verdict import Reason

#: Largest lag [s] of a shock itself: the virtual ones have up to 1.5 ms in a random motion.
MOST_LAG = 3e-3
#: Smallest lag in the upper band as a share of that in the lower band: hysteresis has less.
LINEAR = 0.8
#: Smallest phase [rad] in the upper band that is distinguished from hysteresis.
LEAST_PHASE = 0.35
#: Smallest ratio of the frequencies of the bands, and smallest share of the velocity's power in each.
APART, POWER = 1.5, 0.05
#: Number of standard errors, and largest standard error of a lag that is used [s].
ERRORS, MOST_ERROR = 4.0, 5e-4

#: Advances of the force that are tried [s].
_ADVANCES = np.arange(-4e-3, 20.25e-3, 5e-4)
#: Number of knots on each side, their exponent, and number of blocks that give the standard errors.
_KNOTS, _DENSE, _BLOCKS = 8, 1.8, 8
#: Seconds at either end that are left out, most seconds that are used, highest rate [Hz], and fewest samples.
_END, _LONGEST, _RATE, _FEWEST = 0.2, 60.0, 500.0, 400


@dataclass(frozen=True, slots=True)
class BandLag:
    """Lag of the force in a band of frequencies.

    Attributes:
        frequency: Mean frequency of the velocity [Hz].
        power: Share of the velocity's power [1].
        seconds: Lag [s].
        error: Standard error of the lag [s].
    """

    frequency: float
    power: float
    seconds: float
    error: float

    @property
    def phase(self) -> float:
        """Phase by which the force is late [rad]."""
        return 2.0 * np.pi * self.frequency * self.seconds


def delay_reasons(series: TimeSeries, origin: str) -> Iterator[Reason]:
    """Yield a reason if the force is later than a shock makes it, with a phase that is linear in the frequency.

    Args:
        series: Record with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
        origin: Name of the record.
    """
    bands = band_lags(series)
    if bands is None or not _is_late(*bands):
        return
    low, high = bands
    figure = (
        f"the force is {np.degrees(low.phase):.3g} deg late at {low.frequency:.3g} Hz and {np.degrees(high.phase):.3g} "
        f"deg at {high.frequency:.3g} Hz, linear in the frequency like a delay of {_ms(high)} ms; a shock itself has "
        f"under {1e3 * MOST_LAG:.2g} ms"
    )
    remedy = (
        f"find the delay or the filter of the force channel and export again; or advance the force by {_ms(high)} ms "
        "less the lag of a similar shock (about 1 ms), and fit again"
    )
    yield LATE.reason("the force is later than a shock makes it", figure=figure, origin=origin, remedy=remedy)


def delay_statement(series: TimeSeries) -> str:
    """Return a sentence: how much the instruments can delay the force, or why this is unknown."""
    bands = band_lags(series)
    unknown = "whether the instruments delay the force is unknown: "
    if bands is None:
        return f"{unknown}the record has no two frequencies that are far enough apart; add a random motion to 10 Hz"
    low, high = bands
    if _is_late(low, high):
        return f"the instruments, such as a filter of the force channel, delay the force by about {_ms(high)} ms"
    if high.seconds > MOST_LAG:
        return (
            f"{unknown}the force follows by {_ms(low)} ms at {low.frequency:.2g} Hz and {_ms(high)} ms at "
            f"{high.frequency:.2g} Hz, which hysteresis causes too; add a random motion to 10 Hz or more"
        )
    bound = BandLag(high.frequency, high.power, high.seconds + 2.0 * high.error, high.error)
    return (
        f"the instruments delay the force by at most {_ms(bound)} ms, its lag at {high.frequency:.2g} Hz (the shock's "
        "own included)"
    )


def _is_late(low: BandLag, high: BandLag) -> bool:
    return (
        high.seconds - ERRORS * high.error > MOST_LAG
        and high.seconds >= LINEAR * low.seconds
        and high.phase >= LEAST_PHASE
    )


def _ms(band: BandLag) -> str:
    return f"{1e3 * band.seconds:.2g}"


def band_lags(series: TimeSeries) -> tuple[BandLag, BandLag] | None:
    """Return the lags of the force in a lower and an upper band; None if their frequencies are too close.

    Args:
        series: Record with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
    """
    motion = _Motion.of(series)
    if motion is None:
        return None
    whole = motion.whole()
    low, high = motion.band("low", stiffness=whole), motion.band("high", stiffness=whole)
    is_apart = high.frequency >= APART * low.frequency and min(low.power, high.power) >= POWER
    return (low, high) if is_apart and max(low.error, high.error) <= MOST_ERROR else None


@dataclass(frozen=True, slots=True, eq=False)
class _Motion:
    """A record at an even, moderate rate.

    Attributes:
        rate: Sample rate [Hz].
        velocity: Velocity (N,) [m/s].
        path: Displacement (N,) about its mean [m].
        forces: Force advanced by each of `_ADVANCES` (A, N) [N].
        curve: Columns of a curve over velocity (N, 2 K).
    """

    rate: float
    velocity: Array
    path: Array
    forces: Array
    curve: Array

    @classmethod
    def of(cls, series: TimeSeries) -> _Motion | None:
        """Return the motion of a record; None if it is too short."""
        even = series if series.is_uniform else series.resample(series.sample_rate)
        rate = even.sample_rate
        even = even.at(slice(0, round(_LONGEST * rate)))
        every = max(round(rate / _RATE), 1)
        if len(even) < every * _FEWEST or even.duration < 4.0 * _END:
            return None
        cutoff = min(50.0, 0.3 * rate)
        path = even["displacement"] if "displacement" in even else _integral(even)
        velocity, travel, force = (lowpass(row, rate, cutoff) for row in (even["velocity"], path, even["force"]))
        times = even.time[::every]
        forces = np.stack([np.interp(times + advance, even.time, force) for advance in _ADVANCES])
        velocity, travel = velocity[::every], travel[::every]
        return cls(rate / every, velocity, travel - travel.mean(), forces, _curve_columns(velocity))

    @property
    def kept(self) -> slice:
        """The samples away from the ends, where filters ring."""
        end = round(_END * self.rate)
        return slice(end, -end)

    def whole(self) -> float:
        """Return the stiffness [N/m] beside the curve, with the best advance of the force."""
        scale = float(np.linalg.norm(self.path)) or 1.0
        columns = np.column_stack([self.curve, np.ones(self.path.size), self.path / scale])
        return float(_alignment(columns[self.kept], self.forces[:, self.kept])[2][-1]) / scale

    def band(self, kind: Literal["low", "high"], *, stiffness: float) -> BandLag:
        """Return the lag in the band below or above the frequency that halves the power of the acceleration."""
        acceleration = np.gradient(self.velocity) * self.rate
        sections = butter(2, self._middle() / (0.5 * self.rate), btype=kind, output="sos")

        def filtered(rows: Array) -> Array:
            return np.asarray(sosfiltfilt(sections, rows, axis=-1)[..., self.kept])

        columns = np.column_stack([filtered(self.curve.T).T, np.ones(self.velocity[self.kept].size)])
        lag, error, _ = _alignment(columns, filtered(self.forces - stiffness * self.path))
        powers = [float(np.mean(filtered(row) ** 2)) for row in (self.velocity, acceleration)]
        share = powers[0] / float(np.var(self.velocity[self.kept]))
        return BandLag(float(np.sqrt(powers[1] / powers[0])) / (2.0 * np.pi), share, lag, error)

    def _middle(self) -> float:
        count = self.velocity.size
        frequency = np.fft.rfftfreq(count, 1.0 / self.rate)
        power = np.abs(np.fft.rfft(np.hanning(count) * (self.velocity - self.velocity.mean()))) ** 2 * frequency**2
        place = int(np.searchsorted(np.cumsum(power), 0.5 * power.sum()))
        return float(np.clip(frequency[place], frequency[1], 0.45 * self.rate))


def _integral(series: TimeSeries) -> Array:
    velocity = series["velocity"]
    return np.asarray(cumulative_trapezoid(velocity - velocity.mean(), series.time, initial=0))


def _curve_columns(velocity: Array) -> Array:
    """Return the columns (N, 2 K) of a curve that is linear between knots, dense at zero, on each side."""
    top = float(np.quantile(np.abs(velocity), 0.995))
    knots = np.concatenate([np.linspace(0.0, 1.0, _KNOTS)[:-1] ** _DENSE * top, [np.inf]])
    columns = [
        sign * np.clip(np.clip(sign * velocity, 0.0, None) - low, 0.0, high - low)
        for sign in (1.0, -1.0)
        for low, high in pairwise(knots.tolist())
    ]
    return np.column_stack(columns)


def _alignment(columns: Array, forces: Array) -> tuple[float, float, Array]:
    """Return the best advance of the force [s], its standard error from left-out blocks, and the coefficients (C,).

    Args:
        columns: Columns (N, C) of the model.
        forces: Force (A, N) advanced by each of `_ADVANCES`.
    """
    block = np.arange(len(columns)) * _BLOCKS // len(columns)
    parts = [block == number for number in range(_BLOCKS)]
    products = np.stack([columns[part].T @ columns[part] for part in parts])
    sums = np.stack([forces[:, part] @ columns[part] for part in parts])
    squares = np.stack([np.sum(forces[:, part] ** 2, axis=1) for part in parts])
    best, coefficients = _best_advance(products.sum(axis=0), sums.sum(axis=0), squares.sum(axis=0))
    without = np.array([
        _best_advance(products.sum(axis=0) - product, sums.sum(axis=0) - one, squares.sum(axis=0) - square)[0]
        for product, one, square in zip(products, sums, squares, strict=True)
    ])  # fmt: skip
    error = np.sqrt((_BLOCKS - 1) / _BLOCKS * np.sum((without - without.mean()) ** 2))
    return best, float(error), coefficients


def _best_advance(product: Array, sums: Array, squares: Array) -> tuple[float, Array]:
    """Return the advance with the smallest sum of squares, between the tried ones by a parabola, and coefficients."""
    ridge = 1e-10 * float(np.trace(product)) / len(product)
    found = np.asarray(np.linalg.solve(product + ridge * np.eye(len(product)), sums.T), dtype=np.float64)
    cost = squares - np.sum(sums.T * found, axis=0)
    least = int(np.argmin(cost))
    if least in (0, cost.size - 1):
        return float(_ADVANCES[least]), found[:, least]
    before, at, after = cost[least - 1 : least + 2]
    step = 0.5 * (before - after) / (before - 2.0 * at + after)
    return float(_ADVANCES[least] + step * (_ADVANCES[1] - _ADVANCES[0])), found[:, least]
