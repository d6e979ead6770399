"""Statistics of signals: RMS, spectra and bands."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from eightpost.array_types import Array
from eightpost.cache import digest, keep, recall
from eightpost.errors import InputError
from eightpost.signals import TimeSeries

# ---- Statistics that measures compute from their channels -----------------------------------------------------------


@dataclass(frozen=True, slots=True, eq=False)
class Response:
    """Channels of a run as input to a statistic: filtered, restricted to the measure's window, weighted."""

    rows: Array  #: Channels (C, N), each in its SI unit.
    step: float  #: Time between samples [s].
    options: Mapping[str, float] = field(default_factory=dict)  #: Options of the statistic, in SI.

    @property
    def total(self) -> Array:
        """Sum of the channels, sample by sample (N,)."""
        values: Array = self.rows[0] if len(self.rows) == 1 else self.rows.sum(axis=0)
        return values


class _Statistic(NamedTuple):
    """Function and properties of a statistic."""

    of: Callable[[Response], float]  #: Function that computes the statistic of a response.
    unit: str = ""  #: SI unit of the statistic; empty: that of the channels.
    #: Whether the statistic depends on the mean, which is unreliable without a trusted gain at 0 Hz.
    absolute: bool = False
    #: Options of the statistic with their defaults; None if there is no default.
    options: Mapping[str, float | None] = {}


def rms(values: Array) -> float:
    """Return the root mean square of the values after removing their mean."""
    return float(np.std(values))


def _joint_rms(response: Response) -> float:
    """Return the root mean square of the channels' RMS values."""
    return float(np.sqrt(np.mean(np.var(response.rows, axis=1))))


def _peak(response: Response) -> float:
    total = response.total
    return float(np.max(np.abs(total - total.mean())))


def _variation(response: Response) -> float:
    """Return the coefficient of variation: RMS divided by the mean."""
    total = response.total
    mean = float(total.mean())
    if mean == 0.0:
        raise InputError(
            "variation: the mean is zero, so the ratio is not defined; give the vehicle its static load, or use rms"
        )
    return rms(total) / abs(mean)


def _work(response: Response) -> float:
    """Return the integral of force times velocity by the trapezoidal rule."""
    power = response.rows[0] * response.rows[1]
    return float(scipy.integrate.trapezoid(power, dx=response.step))


def _share(response: Response) -> float:
    low, high = response.options["from"], response.options["to"]
    total = response.total
    return float(np.mean((total >= low) & (total < high)))


#: Statistics by their name in study files.
STATISTICS: Mapping[str, _Statistic] = {
    "rms": _Statistic(lambda r: rms(r.total)),
    "rms_with_mean": _Statistic(lambda r: float(np.sqrt(np.mean(r.total**2))), absolute=True),
    "joint_rms": _Statistic(_joint_rms),
    "mean": _Statistic(lambda r: float(np.mean(r.total)), absolute=True),
    "peak": _Statistic(_peak),
    "range": _Statistic(lambda r: float(np.ptp(r.total))),
    "maximum": _Statistic(lambda r: float(np.max(r.total)), absolute=True),
    "minimum": _Statistic(lambda r: float(np.min(r.total)), absolute=True),
    "percentile": _Statistic(
        lambda r: float(np.percentile(r.total, r.options["percent"])), absolute=True, options={"percent": None}
    ),
    "variation": _Statistic(_variation, unit="1", absolute=True),
    "work": _Statistic(_work, unit="J"),
    "share": _Statistic(_share, unit="1", options={"from": -np.inf, "to": np.inf}),
}


def statistic(name: str) -> _Statistic:
    """Return a statistic by its name.

    Raises:
        InputError: There is no statistic of that name.
    """
    if name not in STATISTICS:
        raise InputError(f"there is no statistic {name!r}; the statistics are {', '.join(STATISTICS)}")
    return STATISTICS[name]


def options_for(name: str, given: Mapping[str, float]) -> dict[str, float]:
    """Return the options of a statistic, completed by defaults.

    Raises:
        InputError: An option is missing, or the statistic has no such option.
    """
    known = statistic(name).options
    if unknown := sorted(set(given) - set(known)):
        raise InputError(f"{name} has no option {unknown[0]!r}; its options: {', '.join(known) or 'none'}")
    filled = {key: given.get(key, default) for key, default in known.items()}
    if missing := [key for key, value in filled.items() if value is None]:
        raise InputError(f"{name} needs the option {missing[0]!r}")
    return {key: float(value) for key, value in filled.items() if value is not None}


# ---- Band-pass for response measures --------------------------------------------------------------------------------

#: Order of the Butterworth filter. It runs forward and backward: no phase shift, half the amplitude at each edge.
_ORDER = 4


@dataclass(frozen=True, slots=True, eq=False)
class Sections:
    """A filter and its steady state for a unit step; both are cached because computing them is slow."""

    rows: Array  #: Second-order sections (S, 6).
    rest: Array  #: State of the filter in which a unit step gives its final value (S, 2).

    @property
    def pad(self) -> int:
        """Number of samples of odd reflection at each end."""
        return 3 * (2 * len(self.rows) + 1)

    def forward_and_backward(self, values: Array, pad: int) -> Array:
        """Return values (N,) filtered like scipy's sosfiltfilt, with `pad` samples of odd reflection at each end."""
        before = 2.0 * values[0] - values[pad:0:-1]
        after = 2.0 * values[-1] - values[-2 : -(pad + 2) : -1]
        forward = self._once(np.concatenate((before, values, after)))
        return self._once(forward[::-1])[::-1][pad:-pad]

    def _once(self, values: Array) -> Array:
        filtered, _ = scipy.signal.sosfilt(self.rows, values, zi=self.rest * values[0])
        return np.asarray(filtered, dtype=np.float64)


def band_pass(values: Array, rate: float, band: tuple[float, float], what: str) -> Array:
    """Return values filtered to a band without phase shift; the mean remains if the band begins at 0.

    Args:
        values: Samples (N,).
        rate: Samples per second [Hz].
        band: Lower and upper edge [Hz]; 0 and infinity leave a side open.
        what: Name of the measure, for messages.

    Raises:
        InputError: The band exceeds half the sample rate, or the record is too short for the filter.
    """
    low, high = band
    if low >= 0.5 * rate or (np.isfinite(high) and high >= 0.5 * rate):
        raise InputError(
            f"measure {what!r}: the band {low:g} to {high:g} Hz exceeds half the sample rate of {rate:g} Hz; use a "
            "smaller record_step, or inf as the upper edge"
        )
    sections = sections_of(low, high, rate)
    if sections is None:
        return values
    pad = sections.pad
    if values.shape[-1] <= pad:
        raise InputError(
            f"measure {what!r}: {values.shape[-1]} samples are too few for the band-pass filter; it needs {pad + 1}"
        )
    return sections.forward_and_backward(values, pad)


@lru_cache(maxsize=64)
def sections_of(low: float, high: float, rate: float) -> Sections | None:
    """Return the filter, or None if both sides are open; it is in the cache, because scipy.signal starts slowly."""
    if low <= 0.0 and not np.isfinite(high):
        return None
    key = digest((scipy.__version__, str(_ORDER), low.hex(), high.hex(), rate.hex()))
    kept = recall("filters", key)
    if kept is None:
        designed = _designed(low, high, rate)
        keep("filters", key, np.hstack((designed.rows, designed.rest)).astype("<f8").tobytes())
        return designed
    rows = np.frombuffer(kept, dtype="<f8").reshape(-1, 8)
    return Sections(rows[:, :6].copy(), rows[:, 6:].copy())


def _designed(low: float, high: float, rate: float) -> Sections:
    if low > 0.0 and np.isfinite(high):
        rows = scipy.signal.butter(_ORDER, (low, high), btype="bandpass", fs=rate, output="sos")
    elif low > 0.0:
        rows = scipy.signal.butter(_ORDER, low, btype="highpass", fs=rate, output="sos")
    else:
        rows = scipy.signal.butter(_ORDER, high, btype="lowpass", fs=rate, output="sos")
    return Sections(np.asarray(rows), np.asarray(scipy.signal.sosfilt_zi(rows)))


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """A run with cached band-passed channels and windows, so that several measures share them."""

    series: TimeSeries  #: The run.
    _kept: dict[tuple[str, tuple[float, float]], Array] = field(init=False, repr=False, default_factory=dict)
    _windows: dict[tuple[float, float], slice] = field(init=False, repr=False, default_factory=dict)

    def samples(self, first: float, last: float) -> slice:
        """Return the slice of the samples from one time to another [s], including both."""
        if (first, last) not in self._windows:
            begin, end = np.searchsorted(self.series.time, (first - 1e-9, last + 1e-9)).tolist()
            self._windows[first, last] = slice(begin, end)
        return self._windows[first, last]

    def keep(self, name: str, band: tuple[float, float], values: Array) -> None:
        """Store a channel (N,) that was filtered to a band [Hz] elsewhere."""
        self._kept[name, band] = values

    def channel(self, name: str, band: tuple[float, float] | None, what: str) -> Array:
        """Return a channel (N,) in SI, unfiltered or filtered to a band [Hz]; `what` is the measure, for messages.

        Raises:
            MissingChannelError: There is no such channel.
            InputError: The band does not fit the sample rate.
        """
        if band is None:
            return self.series[name]
        if (name, band) not in self._kept:
            self._kept[name, band] = band_pass(self.series[name], self.series.sample_rate, band, what)
        return self._kept[name, band]
