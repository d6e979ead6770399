"""Target of a drive file iteration, the limits of the actuators, and the errors of a pass."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.interpolate import CubicSpline
from scipy.signal.windows import tukey

from eightpost.array_types import Array, Complex
from eightpost.corners import CORNERS, channel
from eightpost.errors import ConstantChannelError, DataError, MissingChannelError, ParameterError, TooShortError
from eightpost.rig.rig_test import CHANNEL_UNITS, rig_map
from eightpost.signals import ChannelMap, TimeSeries
from eightpost.signals.filters import lowpass
from eightpost.signals.formats import read_record
from eightpost.signals.raw_record import mapped_series
from eightpost.units import convert

# ==== Frequency lines of records of one length, and sums over bands of lines =========================================


@dataclass(frozen=True)
class Lines:
    """Discrete Fourier transform of records of one length, limited to a band above 0 Hz."""

    samples: int  #: Number N of samples of a record.
    rate: float  #: Sample rate [Hz].
    high: float  #: Highest frequency of the band [Hz].

    @cached_property
    def frequency(self) -> Array:
        """Frequencies (K,) [Hz], without 0."""
        every = np.fft.rfftfreq(self.samples, 1.0 / self.rate)
        return np.asarray(every[(every > 0.0) & (every <= self.high)], dtype=np.float64)

    @property
    def spacing(self) -> float:
        """Distance between two lines [Hz]."""
        return self.rate / self.samples

    def spectrum(self, rows: Array) -> Complex:
        """Return the lines (K, C) of records (C, N)."""
        whole = scipy.fft.rfft(rows, axis=-1)[..., 1 : 1 + self.frequency.size]
        return np.ascontiguousarray(whole.T, dtype=np.complex128)

    def rows(self, spectrum: Complex) -> Array:
        """Return the records (C, N) of lines (K, C); their means are 0."""
        whole = np.zeros((spectrum.shape[1], self.samples // 2 + 1), dtype=np.complex128)
        whole[:, 1 : 1 + self.frequency.size] = spectrum.T
        return np.asarray(scipy.fft.irfft(whole, self.samples, axis=1), dtype=np.float64)

    def half_width(self, width: float) -> int:
        """Return n, where a band of a width [Hz] has 2 n + 1 lines; at least 9 lines."""
        return max(4, round(min(0.5 * width / self.spacing, self.samples)))

    def band_sum(self, values: NDArray[Any], width: float) -> NDArray[Any]:
        """Return the sums (K, ...) of values (K, ...) over the band of a width [Hz] around each line."""
        n = self.half_width(width)
        first = np.zeros((1, *values.shape[1:]), dtype=values.dtype)
        summed = np.concatenate([first, np.cumsum(values, axis=0)])
        k = np.arange(len(values))
        return np.asarray(summed[np.minimum(k + n + 1, len(values))] - summed[np.maximum(k - n, 0)])

    def band_mean(self, values: NDArray[Any], width: float) -> NDArray[Any]:
        """Return the means (K, ...) of values (K, ...) over the band of a width [Hz] around each line."""
        count = self.band_sum(np.ones(len(values)), width)
        return np.asarray(self.band_sum(values, width) / count.reshape(-1, *(1,) * (values.ndim - 1)))


# ==== The target =====================================================================================================

QUANTITIES = ("hub_acceleration", "displacement")  #: Quantities of the corners that a drive file reproduces.
#: Rest before and after the target in a drive file, and time in which the target fades in and out [s].
REST, FADE = 3.0, 1.0
LARGEST = 1e12  #: Largest value of a channel [SI], far above all that a car does.
_SHORTEST = 8.0  #: Minimum duration of a target [s].
_DEAD = 1e-12  #: Maximum standard deviation of a dead channel, relative to its mean and to the smallest number [1].


@dataclass(frozen=True)
class Target:
    """Measured track channels that the rig has to reproduce.

    A drive file has a rest, the time of the target, and another rest, which makes the number of samples a product of
    small primes. The target fades in and out, because the rig
    starts and ends at rest. Errors are evaluated between the fades.
    """

    series: TimeSeries  #: Track record with the C target channels, evenly sampled.
    high: float  #: Highest frequency to reproduce [Hz].

    def __post_init__(self) -> None:
        if not self.series.is_uniform:
            raise ParameterError("the track record is not evenly sampled; resample it")
        if self.series.duration < _SHORTEST:
            raise TooShortError(
                f"the track record has {self.series.duration:.3g} s; a drive file needs at least {_SHORTEST:g} s"
            )
        if self.high > 0.4 * self.rate:
            raise ParameterError(
                f"the track record has {self.rate:g} Hz, which is too low for errors up to {self.high:g} Hz; use a "
                f"record of {2.5 * self.high:g} Hz or more, or a lower --set high"
            )
        for name, row in zip(self.names, self.series.values, strict=True):
            if not (largest := float(np.abs(row).max())) < LARGEST:
                what = f"its largest value is {largest:.3g}; correct its unit, or export the record again"
                raise DataError(what, channel=name)
            if np.std(row) <= _DEAD * max(largest, 1e-300):
                raise ConstantChannelError("the channel is constant; remove it from --set channels", channel=name)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the C channels."""
        return self.series.names

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the C channels."""
        return self.series.units

    @property
    def rate(self) -> float:
        """Sample rate [Hz]."""
        return self.series.sample_rate

    @property
    def rest(self) -> int:
        """Number of samples of the rest before the target."""
        return round(REST * self.rate)

    @cached_property
    def lines(self) -> Lines:
        """Frequency lines of a drive file."""
        return Lines(int(next_fast_len(len(self.series) + 2 * self.rest, real=True)), self.rate, self.high)

    @property
    def time(self) -> Array:
        """Times (N,) of a drive file from its start [s]."""
        return np.arange(self.lines.samples) / self.rate

    @property
    def judged(self) -> slice:
        """Samples of a drive file at which errors are evaluated."""
        fade = round(FADE * self.rate)
        return slice(self.rest + fade, self.rest + len(self.series) - fade)

    @property
    def means(self) -> Array:
        """Means (C,) of the channels, SI."""
        return np.asarray(self.series.values.mean(axis=1))

    @cached_property
    def rows(self) -> Array:
        """Target (C, N) for the time of a drive file: without means, faded in and out, 0 during the rests."""
        count = len(self.series)
        faded = (self.series.values - self.means[:, None]) * _fade_in_and_out(count, round(FADE * self.rate))
        return np.pad(faded, ((0, 0), (self.rest, self.lines.samples - self.rest - count)))

    @cached_property
    def error_window(self) -> Array:
        """Weight (N,) of the error [1]: 1 during the target, 0 where the rig is at rest."""
        half = self.rest // 2
        inner = _fade_in_and_out(len(self.series) + 2 * (self.rest - half), self.rest - half)
        return np.pad(inner, (half, self.lines.samples - half - inner.size))

    @cached_property
    def drive_window(self) -> Array:
        """Weight (N,) of the drive [1], which is 0 at its ends."""
        return _fade_in_and_out(self.lines.samples, self.rest // 3)

    def without_means(self, rows: Array) -> tuple[Array, Array]:
        """Return records (C, N) of the rig without their means during the target, and the means (C,)."""
        means = rows[:, self.rest : self.rest + len(self.series)].mean(axis=1)
        return rows - means[:, None], np.asarray(means)


def _fade_in_and_out(count: int, fade: int) -> Array:
    """Return weights (count,) that grow from 0 to 1 over `fade` samples and decrease to 0 at the end."""
    return np.asarray(tukey(count, 2.0 * fade / (count - 1)))


def target_names(available: Iterable[str]) -> tuple[str, ...]:
    """Return the target channels of a car: hub acceleration and shock displacement of each corner.

    Raises:
        MissingChannelError: A channel is missing.
    """
    names = set(available)
    ports = ("",) if "hub_acceleration" in names or "displacement" in names else CORNERS
    wanted = tuple(channel(port, quantity) for quantity in QUANTITIES for port in ports)
    if missing := [name for name in wanted if name not in names]:
        raise MissingChannelError(
            f"the track record lacks {', '.join(missing)}; name their columns in a channel map (--channel), or choose "
            "other channels with --set channels"
        )
    return wanted


def read_channels(
    path: str | Path,
    names: Sequence[str] | None,
    *,
    optional: Sequence[str] = (),
    channel_map: ChannelMap | None = None,
    units: Mapping[str, str] | None = None,
    flip: Iterable[str] = (),
) -> TimeSeries:
    """Read channels of a track or rig record in any format of `read_series`; by default those of `target_names`.

    The optional channels are read if the record has them. `units` are those of columns without a unit in the header. A
    column that the map (docs/explanation/rig.md) does not name must have the name of its channel.

    Raises:
        DataError: The record has a fault; the message says which and where.
        MissingChannelError: The record lacks a channel.
    """
    record = read_record(path)
    record.log_notes()
    mapping = rig_map(record, channel_map).flipped(flip)
    wanted = target_names(mapping.channels) if names is None else tuple(names)
    if missing := [name for name in wanted if name not in mapping.channels]:
        raise MissingChannelError(
            f"the record lacks {', '.join(missing)}; name their columns in a channel map (--channel)", path=path
        )
    names = (*wanted, *(name for name in optional if name in mapping.channels))
    for name in names:
        record.check_unique(mapping.channels[name].source, channel=name)
    chosen = ChannelMap({name: mapping.channels[name] for name in names}, mapping.time, mapping.path)
    return mapped_series(record, chosen, units=units, expected=CHANNEL_UNITS)


def at_rate(series: TimeSeries, rate: float) -> TimeSeries:
    """Return a series at another sample rate [Hz]: low-pass if the rate decreases, then cubic splines.

    The result starts at time 0.
    """
    values = series.values
    if series.sample_rate > 1.001 * rate:
        values = lowpass(values, series.sample_rate, 0.45 * rate)
    start = series.time - series.time[0]
    count = int(np.floor(series.duration * rate * (1.0 + 1e-9))) + 1
    grid = np.arange(count) / rate
    if values.shape[1] == count and abs(series.sample_rate / rate - 1.0) < 1e-9:
        return TimeSeries(grid, values, series.names, series.units)
    return TimeSeries(grid, CubicSpline(start, values, axis=1)(grid), series.names, series.units)


# ==== Errors of a pass: measured minus target, by channel and by band ================================================

EDGES = (0.0, 1.0, 4.0, 10.0, 16.0, 24.0, 1000.0)  #: Edges of the bands in tables [Hz].


@dataclass(frozen=True, slots=True)
class PassErrors:
    """Errors of one pass between the fades of the target, up to its highest frequency."""

    channels: Mapping[str, float]  #: RMS error by channel, relative to the RMS of the target without its mean [1].
    peaks: Mapping[str, float]  #: Largest error by channel, relative to the largest value of the target [1].
    #: RMS errors by channel in the bands of `EDGES`, relative to the RMS of the whole target [1].
    bands: Mapping[str, tuple[float, ...]]
    #: RMS of the measured minus the target above the highest frequency by channel, relative to the RMS of the target
    #: [1]; it includes sensor noise.
    beyond: Mapping[str, float]
    means: Mapping[str, float]  #: Measured mean minus target mean by channel, relative to the RMS of the target [1].

    @property
    def total(self) -> float:
        """Root mean square of the relative errors of all channels [1]."""
        return float(np.sqrt(np.mean(np.square(list(self.channels.values())))))

    def of_quantity(self, quantity: str) -> float | None:
        """Return the root mean square of the errors of a quantity's channels [1]; None if it is not a target."""
        errors = [value for name, value in self.channels.items() if name.rpartition(".")[2] == quantity]
        return float(np.sqrt(np.mean(np.square(errors)))) if errors else None

    @property
    def worst(self) -> tuple[str, float]:
        """Channel with the largest error, and its error [1]."""
        name = max(self.channels, key=lambda one: self.channels[one])
        return name, self.channels[name]


def pass_errors(target: Target, record: Array) -> PassErrors:
    """Return the errors of a record (C, N) from the rig, in SI and with its means."""
    lines, judged = target.lines, target.judged
    moving, means = target.without_means(record)
    difference = target.error_window * (moving - target.rows)
    wrong = lines.spectrum(difference)
    whole, error = lines.rows(lines.spectrum(target.rows))[:, judged], lines.rows(wrong)[:, judged]
    size = np.sqrt(np.mean(whole**2, axis=1))
    bands = []
    for low, high in pairwise(EDGES):
        inside = (lines.frequency >= low) & (lines.frequency < high)
        part = lines.rows(np.where(inside[:, None], wrong, 0.0))[:, judged]
        bands.append(np.sqrt(np.mean(part**2, axis=1)) / size)
    rest = (difference - difference.mean(axis=1, keepdims=True))[:, judged] - error

    def named(values: Array) -> dict[str, float]:
        return dict(zip(target.names, (float(value) for value in values), strict=True))

    return PassErrors(
        named(np.sqrt(np.mean(error**2, axis=1)) / size),
        named(np.abs(error).max(axis=1) / np.abs(whole).max(axis=1)),
        {name: tuple(float(band[k]) for band in bands) for k, name in enumerate(target.names)},
        named(np.sqrt(np.mean(rest**2, axis=1)) / size),
        named((means - target.means) / size),
    )


# ==== Limits: stroke and velocity of wheelloaders, force of aeroloaders ==============================================

_ROUNDS = 12  #: Number of alternating projections onto the limits and the band.
_CLOSE = 1e-9  #: Excess over a limit that counts as rounding [1].


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of the commands; the defaults are those of the rig in section 6.1.1."""

    #: Maximum distance of a wheelloader from the middle of its stroke [m]; half of 12.4 in.
    stroke: float = 0.5 * convert(12.4, "in", "m")
    velocity: float = convert(180.0, "in/s", "m/s")  #: Maximum velocity of a wheelloader [m/s]; 180 in/s.
    #: Maximum force of an aeroloader [N]; 4300 lbf. Moments are not limited.
    force: float = convert(4300.0, "lbf", "N")

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not value > 0.0:
                raise ParameterError(f"the limit of {name} must be above 0, not {value:g}")


@dataclass(frozen=True, slots=True)
class LimitHit:
    """A command that a limit has changed."""

    name: str  #: Name of the input.
    kind: str  #: Kind of the limit: stroke, velocity or force.
    wanted: float  #: Largest value without the limit, SI.
    limit: float  #: Limit, SI.
    unit: str  #: SI unit of both.
    time: float  #: Time of the largest excess, from the start of the drive file [s].
    share: float  #: Share of the time at which the limit was exceeded [1].

    def __str__(self) -> str:
        return (
            f"{self.name} needs a {self.kind} of {self.wanted:.4g} {self.unit} at {self.time:.2f} s, the limit is "
            f"{self.limit:.4g} {self.unit} (exceeded for {100.0 * self.share:.2g} % of the time)"
        )


def within_limits(
    rows: Array, names: tuple[str, ...], units: tuple[str, ...], lines: Lines, limits: Limits, window: Array
) -> tuple[Array, tuple[LimitHit, ...]]:
    """Return the commands (m, N) [SI] within the limits, and the limits that changed them.

    A command beyond a limit is projected alternately onto the limit and onto the band of the drive file, so that it
    gets no harmonics; finally, it is scaled by the small excess that remains. `window` is the weight (N,) of the drive,
    0 at its ends.
    """
    limited, hits = rows.copy(), []
    of_unit = {"m": [("stroke", "m", limits.stroke), ("velocity", "m/s", limits.velocity)],
               "N": [("force", "N", limits.force)]}  # fmt: skip
    for row, (name, unit) in enumerate(zip(names, units, strict=True)):
        kinds = [_Kind(*kind, lines.rate) for kind in of_unit.get(unit, [])]
        exceeded = [hit for kind in kinds if (hit := _hit(rows[row], name, kind))]
        if exceeded:
            limited[row] = _projected(rows[row], kinds, lines, window)
            hits += exceeded
    return limited, tuple(hits)


class _Kind(NamedTuple):
    """A limit of one command: of its value, or of its change per second between samples."""

    name: str
    unit: str
    limit: float
    rate: float

    @property
    def is_slope(self) -> bool:
        return self.name == "velocity"

    def of(self, row: Array) -> Array:
        """Return the limited quantity (N,) of a command (N,)."""
        return np.asarray(np.diff(row, append=row[-1:]) * self.rate, dtype=np.float64) if self.is_slope else row


def _hit(row: Array, name: str, kind: _Kind) -> LimitHit | None:
    size = np.abs(kind.of(row))
    worst = int(np.argmax(size))
    if size[worst] <= (1.0 + _CLOSE) * kind.limit:
        return None
    share = float(np.mean(size > kind.limit))
    return LimitHit(name, kind.name, float(size[worst]), kind.limit, kind.unit, worst / kind.rate, share)


def _projected(row: Array, kinds: list[_Kind], lines: Lines, window: Array) -> Array:
    steady = float(np.clip(row[0], -kinds[0].limit, kinds[0].limit))
    moving = row - row[0]
    for _ in range(_ROUNDS):
        for kind in kinds:
            values = kind.of(steady + moving)
            excess = values - np.clip(values, -kind.limit, kind.limit)
            if kind.is_slope:  # the integral of the excess velocity within the band
                slope = lines.spectrum(excess[None]) / (2j * np.pi * lines.frequency[:, None])
                excess = lines.rows(slope)[0]
            moving = moving - excess
        moving = window * lines.rows(lines.spectrum(moving[None]))[0]
    scale = 1.0  # largest factor of the motion, at most 1, with which all limits hold
    for kind in kinds:
        values = kind.of(moving)
        offset = 0.0 if kind.is_slope else steady
        for extreme, room in ((values.max(), kind.limit - offset), (-values.min(), kind.limit + offset)):
            if extreme > room:
                scale = min(scale, max(room, 0.0) / float(extreme))
    return np.asarray(steady + moving * scale, dtype=np.float64)
