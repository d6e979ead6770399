"""Measures of a study: statistics of ride height, tire force and other signals, by family, and their spectra."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy

from eightpost.array_types import Array
from eightpost.cache import digest, keep, recall
from eightpost.corners import CORNERS
from eightpost.errors import EightpostError, InputError
from eightpost.signals import TimeSeries
from eightpost.uncertainty import band_shares
from eightpost.units import convert, us_customary
from eightpost.validity import Validity

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


def _variation(response: Response) -> float:
    total = response.total
    mean = float(total.mean())
    if mean == 0.0:
        raise InputError(
            "variation: the mean is zero, so the ratio is not defined; give the vehicle its static load, or use rms"
        )
    return rms(total) / abs(mean)


#: Statistics by their name in study files.
STATISTICS: Mapping[str, _Statistic] = {
    "rms": _Statistic(lambda r: rms(r.total)),
    "rms_with_mean": _Statistic(lambda r: float(np.sqrt(np.mean(r.total**2))), absolute=True),
    "joint_rms": _Statistic(lambda r: float(np.sqrt(np.mean(np.var(r.rows, axis=1))))),
    "mean": _Statistic(lambda r: float(np.mean(r.total)), absolute=True),
    "peak": _Statistic(lambda r: float(np.max(np.abs(r.total - r.total.mean())))),
    "range": _Statistic(lambda r: float(np.ptp(r.total))),
    "maximum": _Statistic(lambda r: float(np.max(r.total)), absolute=True),
    "minimum": _Statistic(lambda r: float(np.min(r.total)), absolute=True),
    "percentile": _Statistic(
        lambda r: float(np.percentile(r.total, r.options["percent"])), absolute=True, options={"percent": None}
    ),
    "variation": _Statistic(_variation, unit="1", absolute=True),
    "work": _Statistic(lambda r: float(scipy.integrate.trapezoid(r.rows[0] * r.rows[1], dx=r.step)), unit="J"),
    "share": _Statistic(
        lambda r: float(np.mean((r.total >= r.options["from"]) & (r.total < r.options["to"]))),
        unit="1",
        options={"from": -np.inf, "to": np.inf},
    ),
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
    if (kept := recall("filters", key)) is not None:
        stored = np.frombuffer(kept, dtype="<f8").reshape(-1, 8)
        return Sections(stored[:, :6].copy(), stored[:, 6:].copy())
    design: dict[str, Any] = {"btype": "lowpass", "Wn": high} if low <= 0.0 else {"btype": "highpass", "Wn": low}
    if low > 0.0 and np.isfinite(high):
        design = {"btype": "bandpass", "Wn": (low, high)}
    rows = scipy.signal.butter(_ORDER, fs=rate, output="sos", **design)
    designed = Sections(np.asarray(rows), np.asarray(scipy.signal.sosfilt_zi(rows)))
    keep("filters", key, np.hstack((designed.rows, designed.rest)).astype("<f8").tobytes())
    return designed


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


# ==== Measures, and those of the user's own ==========================================================================

OwnFunction = Callable[[Response], float]


@cache
def own_function(entry: str) -> OwnFunction:
    """Return the function that `file.py:name` names.

    The function takes a Response (`rows` (C, N) in SI, `total` (N,), `step` [s], `options`) and returns a number in SI.

    Raises:
        InputError: The file or the function does not exist, or the file cannot be run.
    """
    file, colon, name = entry.rpartition(":")
    if not colon or not name.isidentifier():
        raise InputError(f"{entry!r}: a user-defined measure must be written as FILE.py:FUNCTION")
    path = Path(file)
    specification = importlib.util.spec_from_file_location(f"_measures_of_{path.stem}", path)
    if specification is None or specification.loader is None or not path.is_file():
        raise InputError(f"{entry}: there is no Python file {path}")
    module = importlib.util.module_from_spec(specification)
    try:
        specification.loader.exec_module(module)
    except Exception as error:  # the file may raise anything
        raise InputError(f"{path}: cannot be run: {type(error).__name__}: {error}") from error
    found = getattr(module, name, None)
    if not callable(found):
        raise InputError(f"{path}: has no function {name!r}")
    function: OwnFunction = found
    return function


_STATISTICS = (("RMS", "rms"), ("mean", "mean"))

#: Statistics that do not sum their channels.
_APART = ("joint_rms", "work")


@dataclass(frozen=True, slots=True)
class Measure:
    """A scalar value computed from the channels of a run.

    Raises:
        InputError: There is no such statistic, an option is missing or unknown, there are no channels, or weights, band
            or section are invalid.
    """

    name: str  #: Display name.
    channels: tuple[str, ...]  #: Channels to evaluate; most statistics first sum several channels sample by sample.
    statistic: str = "rms"  #: Name of a statistic of cosim.study.measures; `rms` removes the mean.
    display: str = ""  #: Display unit; empty: the SI unit.
    weights: tuple[float, ...] = ()  #: Factor for each channel; empty: all 1.
    #: Frequency band to which the channels are filtered [Hz]; 0 and infinity leave a side open.
    band: tuple[float, float] | None = None
    section: tuple[float, float] | None = None  #: First and last time of the section of the drive to evaluate [s].
    options: Mapping[str, float] = field(default_factory=dict)  #: Options of the statistic, in SI.
    drive: str = ""  #: Name of the drive on which to evaluate the measure; empty: any.
    function: str = ""  #: User-defined function that replaces the statistic, as `file.py:name` (docs/how_to/study.md).
    function_unit: str = ""  #: SI unit of the function's return value; empty: that of the first channel.

    def __post_init__(self) -> None:
        object.__setattr__(self, "channels", tuple(self.channels))
        if not self.channels:
            raise InputError(f"measure {self.name!r}: it has no channels; name at least one")
        if self.weights and len(self.weights) != len(self.channels):
            raise InputError(
                f"measure {self.name!r}: {len(self.channels)} channels need {len(self.channels)} weights, "
                f"not {len(self.weights)}"
            )
        for what, pair in (("band", self.band), ("section", self.section)):
            if pair is not None and not 0.0 <= pair[0] < pair[1]:
                raise InputError(
                    f"measure {self.name!r}: its {what} must be two increasing values of 0 or more, not {pair}"
                )
        try:
            options = options_for(self.statistic, self.options)
        except InputError as error:
            raise InputError(f"measure {self.name!r}: {error}") from error
        object.__setattr__(self, "options", options if not self.function else dict(self.options))
        if self.statistic == "work" and len(self.channels) != 2:
            raise InputError(f"measure {self.name!r}: the statistic work needs two channels, a force and a velocity")

    @property
    def absolute(self) -> bool:
        """Whether the measure depends on the mean of its channels."""
        return not self.function and statistic(self.statistic).absolute and (self.band is None or self.band[0] == 0.0)

    def of(self, series: TimeSeries, *, start: float = -np.inf) -> float:
        """Return the value of the measure in SI.

        Args:
            series: The run; samples before `start` are filtered with the others, then excluded.
            start: End of the settling time [s].

        Raises:
            MissingChannelError: The series lacks a channel of the measure.
            InputError: The section contains fewer than two samples, or the band does not fit the sample rate.
        """
        return self.drawn_from(Filtered(series), start=start)

    def drawn_from(self, run: Filtered, *, start: float = -np.inf) -> float:
        """Return the same value as `of`, from a run with cached filtered channels."""
        series = run.series
        step = series.duration / (len(series) - 1) if len(series) > 1 else 0.0
        response = Response(self._rows(run, start), step, self.options)
        if self.function:
            return float(own_function(self.function)(response))
        return statistic(self.statistic).of(response)

    def unit(self, series: TimeSeries) -> str:
        """Return the SI unit of the measure."""
        return self.unit_for(series.unit(self.channels[0]))

    def unit_for(self, channel: str) -> str:
        """Return the SI unit of the measure if its channels have the SI unit `channel`."""
        own = self.function_unit if self.function else statistic(self.statistic).unit
        return own or channel

    def signals(self, run: Filtered, *, start: float = -np.inf) -> Array:
        """Return the signals (C, N) of which the measure is computed: the sum of its channels, or each of them.

        Args:
            start: End of the settling time [s].
        """
        rows = self._rows(run, start)
        return rows if self.statistic in _APART else rows.sum(axis=0, keepdims=True)

    def _rows(self, run: Filtered, start: float) -> Array:
        """Return the channels (C, N): filtered, restricted to the window, weighted."""
        window = self._window(run, start)
        channels = [run.channel(name, self.band, self.name)[window] for name in self.channels]
        rows: Array = channels[0][np.newaxis] if len(channels) == 1 else np.stack(channels)
        return rows * np.array(self.weights)[:, None] if self.weights else rows

    def _window(self, run: Filtered, start: float) -> slice:
        first, last = self.section or (-np.inf, np.inf)
        window = run.samples(max(first, start), last)
        if window.stop - window.start < 2:
            raise InputError(
                f"measure {self.name!r}: fewer than two samples from {max(first, start):g} to {last:g} s; the run is "
                f"{run.series.time[0]:g} to {run.series.time[-1]:g} s"
            )
        return window


def available(measures: Sequence[Measure], *runs: TimeSeries) -> tuple[Measure, ...]:
    """Return the measures whose channels are in every run."""
    return tuple(m for m in measures if all(channel in run for run in runs for channel in m.channels))


def channel_measures(series: TimeSeries) -> tuple[Measure, ...]:
    """Return measures for RMS and mean of every channel."""
    return tuple(
        Measure(f"{name}, {label}", (name,), kind, us_customary(unit))
        for name, unit in zip(series.names, series.units, strict=True)
        for label, kind in _STATISTICS
    )


# ==== Families by name, for the channels that a vehicle and its shocks have ==========================================

#: Limit between low and high shock speed, as commonly used by teams [m/s].
LOW_SPEED = convert(2.0, "in/s", "m/s")

#: Bands of tire load [Hz]: chassis motion and wheel hop (Tables 4.2 and 5.2 have modes in both), and octaves from below
#: the chassis modes to above the wheel modes.
_BANDS = {"chassis (0.5 to 8 Hz)": (0.5, 8.0), "wheel hop (8 to 30 Hz)": (8.0, 30.0)}
_OCTAVES = {f"{0.5 * 2.0**k:g} to {2.0**k:g} Hz": (0.5 * 2.0**k, 2.0**k) for k in range(6)}

#: Ranges of shock velocity [m/s].
_SPEEDS = {
    "high-speed rebound": (-np.inf, -LOW_SPEED),
    "low-speed rebound": (-LOW_SPEED, 0.0),
    "low-speed bump": (0.0, LOW_SPEED),
    "high-speed bump": (LOW_SPEED, np.inf),
}

#: Signs of lf, rf, lr, rr in each mode of the four tire loads.
_MODES = {
    "heave": (1.0, 1.0, 1.0, 1.0),
    "pitch": (-1.0, -1.0, 1.0, 1.0),
    "roll": (1.0, -1.0, 1.0, -1.0),
    "warp": (1.0, -1.0, -1.0, 1.0),
}


@dataclass(frozen=True, slots=True)
class Car:
    """Names and channels of a car for which measures are defined."""

    name: str  #: Name of the vehicle's component.
    corners: Sequence[str]  #: Names of the shocks' components.
    channels: Collection[str] = ()  #: All channels that can be recorded, as `component.variable`.

    def port(self, corner: str, variable: str) -> str:
        """Return the channel of a variable at a corner; those of a quarter car have no corner in the name."""
        own, plain = f"{self.name}.{corner}.{variable}", f"{self.name}.{variable}"
        return plain if plain in self.channels and own not in self.channels else own

    def ports(self, variable: str) -> tuple[str, ...]:
        """Return the channels of a variable at all corners."""
        return tuple(self.port(corner, variable) for corner in self.corners)


def family(name: str, car: Car) -> tuple[Measure, ...]:
    """Return those measures of a family whose channels exist.

    Raises:
        InputError: There is no such family, or the vehicle has none of its channels.
    """
    if name not in FAMILIES:
        raise InputError(f"there is no family of measures {name!r}; there are {', '.join(FAMILIES)}")
    if found := _measures(name, car):
        return found
    others = ", ".join(filter(lambda other: _measures(other, car), FAMILIES)) or "none"
    raise InputError(f"family {name!r}: {car.name} has none of its channels; families with channels of {car.name}: "
                     f"{others} (docs/how_to/study.md)")  # fmt: skip


def _measures(name: str, car: Car) -> tuple[Measure, ...]:
    return tuple(m for m in FAMILIES[name](car) if set(m.channels) <= set(car.channels))


def ride_measures(vehicle: str, corners: Sequence[str] = CORNERS) -> tuple[Measure, ...]:
    """Return the measures of chapter 7 for a car with the channels of docs/reference/ports.md.

    They cover total tire force (from which the grip number is computed), ride heights (aero number), tire forces, hub
    accelerations and shock velocities.
    """
    return tuple(_ride(Car(vehicle, corners)))


def _ride(car: Car) -> Iterator[Measure]:
    levels = {"total tire force": (car.ports("tire_force"), "lbf")}
    levels |= {f"{axle} ride height": ((f"{car.name}.{axle}.ride_height",), "in") for axle in ("front", "rear")}
    for name, (channels, unit) in levels.items():
        yield from (Measure(f"{name}, {label}", channels, kind, unit) for label, kind in _STATISTICS)
    for variable, unit in (("tire_force", "lbf"), ("hub_acceleration", "g"), ("velocity", "in/s")):
        words = variable.replace("_", " ").replace("velocity", "shock velocity")
        for corner in car.corners:
            yield Measure(f"{corner} {words}, RMS", (car.port(corner, variable),), "rms", unit)


def _numbers(car: Car) -> Iterator[Measure]:  # 2.5; lower is better
    heights = tuple(f"{car.name}.{axle}.ride_height" for axle in ("front", "rear"))
    yield Measure("grip number", car.ports("tire_force"), "rms", "lbf")
    yield Measure("aero number", heights, "joint_rms", "in")


#: Measures of each corner by family: name, variable at the vehicle's port, statistic, unit, options of the statistic.
_AT_CORNERS: Mapping[str, Sequence[tuple[str, str, str, str, Mapping[str, float]]]] = {
    "tires": (
        ("tire force variation", "tire_force", "variation", "1", {}),
        ("tire force, RMS", "tire_force", "rms", "lbf", {}),
        ("tire force, 1st percentile", "tire_force", "percentile", "lbf", {"percent": 1.0}),
    ),
    "accelerations": tuple(
        (f"{place} acceleration, RMS", f"{place}_acceleration", "rms", "g", {}) for place in ("hub", "chassis")
    ),
    "travel": tuple(
        (f"suspension travel, {word}", "displacement", word.lower(), "in", {}) for word in ("RMS", "range")
    ),
    "energy": (("energy into the shock", "velocity", "work", "J", {}),),
    "velocities": tuple(
        (f"time in {label}", "velocity", "share", "1", {"from": low, "to": high})
        for label, (low, high) in _SPEEDS.items()
    ),
}


def _at_corners(family: str, car: Car) -> Iterator[Measure]:
    for corner in car.corners:
        for label, variable, kind, unit, options in _AT_CORNERS[family]:
            force = (f"{corner}.force",) if kind == "work" else ()
            yield Measure(f"{corner} {label}", (*force, car.port(corner, variable)), kind, unit, options=options)
    if family == "tires":
        yield Measure("total tire force variation", car.ports("tire_force"), "variation", "1")
    if family == "accelerations":
        yield Measure("driver acceleration, RMS", (f"{car.name}.driver.acceleration",), "rms", "g")


def _tire_modes(car: Car, bands: Mapping[str, tuple[float, float]]) -> Iterator[Measure]:
    """Yield heave, pitch, roll and warp of the four tire loads, each in some bands."""
    tires = tuple(f"{car.name}.{corner}.tire_force" for corner in CORNERS)
    for mode, weights in _MODES.items():
        for label, band in bands.items():
            yield Measure(f"tire load {mode}, {label}, RMS", tires, "rms", "lbf", weights=weights, band=band)


#: Functions that yield the measures of a family, by the family's name in study files.
FAMILIES: Mapping[str, Callable[[Car], Iterator[Measure]]] = {
    "ride": _ride,
    "numbers": _numbers,
    **{family: partial(_at_corners, family) for family in _AT_CORNERS},
    "tire_modes": lambda car: _tire_modes(car, _BANDS),
    "tire_spectra": lambda car: _tire_modes(car, _OCTAVES),
}


# ==== Spectra: the share of power above the band of the vehicle, and the shares in bands =============================

#: Statistics without a power: shares of time, and means.
_NO_POWER = ("share", "mean")


class AboveBand(NamedTuple):
    """Power of a measure above the band of its vehicle."""

    high: float  #: Upper end of the band in which the vehicle was identified [Hz].
    share: float  #: Share of the power of the measure's signals above it [1].
    #: Shares of the power in the bands of `eightpost.uncertainty`; empty in files of earlier versions.
    bands: tuple[float, ...] = ()


def band_ends(document: Any, vehicle: str) -> dict[str, float]:
    """Return the upper end [Hz] of the band in which each channel of a vehicle was identified, by channel.

    Args:
        document: Validity that the vehicle's FMU states, as JSON content; None if it states none.
    """
    try:
        ranges = () if document is None else Validity.from_json(document).ranges
    except EightpostError:
        return {}  # the verdict says that the model's validity cannot be read
    return {f"{vehicle}.{one.variable}": one.high for one in ranges if one.kind == "frequency"}


def above_band(
    run: Filtered, measures: Iterable[Measure], ends: dict[str, float], start: float
) -> dict[str, AboveBand]:
    """Return the power above the band of each measure of a run, by measure; without those of other channels.

    Args:
        ends: Upper end of the band by channel [Hz]; see `band_ends`.
        start: End of the settling time [s].
    """
    found = {}
    for measure in measures:
        known = [ends[name] for name in measure.channels if name in ends]
        if known and measure.statistic not in _NO_POWER:
            signals, rate, high = measure.signals(run, start=start), run.series.sample_rate, min(known)
            shares = tuple(shares_of(signals, rate).tolist())
            found[measure.name] = AboveBand(high, power_above(signals, rate, high), shares)
    return found


def power_above(signals: Array, rate: float, high: float) -> float:
    """Return the share of the power of signals (C, N), sampled at a rate [Hz], about their means above `high` [Hz]."""
    power, frequency = _spectrum(signals, rate)
    return float(power[frequency > high].sum())


def shares_of(signals: Array, rate: float) -> Array:
    """Return the shares of the power of signals (C, N) about their means in the bands of `MeasuredLevel.shares`."""
    return band_shares(*_spectrum(signals, rate))


def _spectrum(signals: Array, rate: float) -> tuple[Array, Array]:
    """Return the power of the lines of signals (C, N) about their means, with a sum of 1 or 0, and frequencies [Hz]."""
    windowed = (signals - signals.mean(axis=1, keepdims=True)) * np.hanning(signals.shape[1])
    power = np.sum(np.abs(np.fft.rfft(windowed, axis=1)) ** 2, axis=0)
    frequency, whole = np.asarray(np.fft.rfftfreq(signals.shape[1], 1.0 / rate)), float(power.sum())
    return np.asarray(power / whole if whole else power), frequency.astype(np.float64)
