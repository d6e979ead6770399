"""Measures of a study: levels of ride height, tire force and other signals, by family, and their spectra."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cosim.study.statistics import Filtered, Response, options_for, statistic
from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import EightpostError, InputError
from eightpost.signals import TimeSeries
from eightpost.uncertainty import band_shares
from eightpost.units import convert, us_customary
from eightpost.validity import Validity

# ==== Measures, and those of the user's own ==========================================================================

# ---- User-defined measures ------------------------------------------------------------------------------------------

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


# ---- Response measures ----------------------------------------------------------------------------------------------

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
    statistic: str = "rms"  #: Name of a statistic of cosim.study.statistics; `rms` removes the mean.
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
        response = Response(self._rows(run, start), _step(run.series), self.options)
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
            run: The run, with cached filtered channels.
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
        """Return the samples of the section after the settling time."""
        first, last = self.section or (-np.inf, np.inf)
        window = run.samples(max(first, start), last)
        if window.stop - window.start < 2:
            span = f"{run.series.time[0]:g} to {run.series.time[-1]:g} s"
            raise InputError(
                f"measure {self.name!r}: fewer than two samples from {max(first, start):g} to {last:g} s; the run is "
                f"{span}"
            )
        return window


def _step(series: TimeSeries) -> float:
    return series.duration / (len(series) - 1) if len(series) > 1 else 0.0


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


def ride_measures(vehicle: str, corners: Sequence[str] = CORNERS) -> tuple[Measure, ...]:
    """Return the measures of chapter 7 for a car with the channels of docs/reference/ports.md.

    They cover total tire force (from which the grip number is computed), ride heights (aero number), tire forces, hub
    accelerations and shock velocities.
    """
    tires = tuple(f"{vehicle}.{corner}.tire_force" for corner in corners)
    measures = [
        Measure("total tire force, RMS", tires, "rms", "lbf"),
        Measure("total tire force, mean", tires, "mean", "lbf"),
    ]
    for axle in ("front", "rear"):
        channel = (f"{vehicle}.{axle}.ride_height",)
        measures += [
            Measure(f"{axle} ride height, RMS", channel, "rms", "in"),
            Measure(f"{axle} ride height, mean", channel, "mean", "in"),
        ]
    for corner, tire in zip(corners, tires, strict=True):
        measures.append(Measure(f"{corner} tire force, RMS", (tire,), "rms", "lbf"))
    for corner in corners:
        channel = (f"{vehicle}.{corner}.hub_acceleration",)
        measures.append(Measure(f"{corner} hub acceleration, RMS", channel, "rms", "g"))
    for corner in corners:
        measures.append(Measure(f"{corner} shock velocity, RMS", (f"{vehicle}.{corner}.velocity",), "rms", "in/s"))
    return tuple(measures)


# ==== Families by name, for the channels that a vehicle and its shocks have ==========================================

#: Limit between low and high shock speed, as commonly used by teams [m/s].
LOW_SPEED = convert(2.0, "in/s", "m/s")

#: Bands of tire load [Hz]: chassis motion and wheel hop (Tables 4.2 and 5.2 have modes in both).
BANDS = (("chassis", (0.5, 8.0)), ("wheel hop", (8.0, 30.0)))

#: Octaves of the tire load spectra [Hz], from below the chassis modes to above the wheel modes.
OCTAVES = tuple((0.5 * 2.0**k, 2.0**k) for k in range(6))

#: Signs of lf, rf, lr, rr in each mode of the four tire loads.
MODES: Mapping[str, tuple[float, float, float, float]] = {
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
    channels: Collection[str]  #: All channels that can be recorded, as `component.variable`.

    def port(self, corner: str, variable: str) -> str:
        """Return the channel of a variable at a corner; those of a quarter car have no corner in the name."""
        own = f"{self.name}.{corner}.{variable}"
        return own if own in self.channels else f"{self.name}.{variable}"


def family(name: str, car: Car) -> tuple[Measure, ...]:
    """Return those measures of a family whose channels exist.

    Raises:
        InputError: There is no such family, or the vehicle has none of its channels.
    """
    if name not in FAMILIES:
        raise InputError(f"there is no family of measures {name!r}; there are {', '.join(FAMILIES)}")
    if found := _measures(name, car):
        return found
    others = ", ".join(other for other in FAMILIES if _measures(other, car)) or "none"
    raise InputError(f"family {name!r}: {car.name} has none of its channels; families with channels of {car.name}: "
                     f"{others} (docs/how_to/study.md)")  # fmt: skip


def _measures(name: str, car: Car) -> tuple[Measure, ...]:
    return tuple(m for m in FAMILIES[name](car) if set(m.channels) <= set(car.channels))


def _ride(car: Car) -> Iterator[Measure]:
    """Yield the measures of chapter 7."""
    yield from ride_measures(car.name, car.corners)


def _numbers(car: Car) -> Iterator[Measure]:
    """Yield grip number and aero number (2.5); lower is better."""
    tires = tuple(car.port(corner, "tire_force") for corner in car.corners)
    heights = tuple(f"{car.name}.{axle}.ride_height" for axle in ("front", "rear"))
    yield Measure("grip number", tires, "rms", "lbf")
    yield Measure("aero number", heights, "joint_rms", "in")


def _tires(car: Car) -> Iterator[Measure]:
    tires = tuple(car.port(corner, "tire_force") for corner in car.corners)
    for corner, tire in zip(car.corners, tires, strict=True):
        yield Measure(f"{corner} tire force variation", (tire,), "variation", "1")
        yield Measure(f"{corner} tire force, RMS", (tire,), "rms", "lbf")
        yield Measure(f"{corner} tire force, 1st percentile", (tire,), "percentile", "lbf", options={"percent": 1.0})
    yield Measure("total tire force variation", tires, "variation", "1")


def _accelerations(car: Car) -> Iterator[Measure]:
    for corner in car.corners:
        for place in ("hub", "chassis"):
            channel = car.port(corner, f"{place}_acceleration")
            yield Measure(f"{corner} {place} acceleration, RMS", (channel,), "rms", "g")
    yield Measure("driver acceleration, RMS", (f"{car.name}.driver.acceleration",), "rms", "g")


def _travel(car: Car) -> Iterator[Measure]:
    for corner in car.corners:
        channel = (car.port(corner, "displacement"),)
        yield Measure(f"{corner} suspension travel, RMS", channel, "rms", "in")
        yield Measure(f"{corner} suspension travel, range", channel, "range", "in")


def _energy(car: Car) -> Iterator[Measure]:
    for corner in car.corners:
        channels = (f"{corner}.force", car.port(corner, "velocity"))
        yield Measure(f"{corner} energy into the shock", channels, "work", "J")


def _velocities(car: Car) -> Iterator[Measure]:
    """Yield the shares of time in four ranges of shock velocity."""
    inf = float("inf")
    bins = {
        "high-speed rebound": (-inf, -LOW_SPEED),
        "low-speed rebound": (-LOW_SPEED, 0.0),
        "low-speed bump": (0.0, LOW_SPEED),
        "high-speed bump": (LOW_SPEED, inf),
    }
    for corner in car.corners:
        channel = (car.port(corner, "velocity"),)
        for label, (low, high) in bins.items():
            yield Measure(f"{corner} time in {label}", channel, "share", "1", options={"from": low, "to": high})


def _tire_modes(car: Car) -> Iterator[Measure]:
    """Yield heave, pitch, roll and warp of the four tire loads, each in two bands."""
    for mode in MODES:
        for label, band in BANDS:
            yield _tire_mode(car, mode, f"{label} ({band[0]:g} to {band[1]:g} Hz)", band)


def _tire_spectra(car: Car) -> Iterator[Measure]:
    """Yield octave spectra of heave, pitch, roll and warp."""
    for mode in MODES:
        for band in OCTAVES:
            yield _tire_mode(car, mode, f"{band[0]:g} to {band[1]:g} Hz", band)


def _tire_mode(car: Car, mode: str, label: str, band: tuple[float, float]) -> Measure:
    tires = tuple(f"{car.name}.{corner}.tire_force" for corner in CORNERS)
    return Measure(f"tire load {mode}, {label}, RMS", tires, "rms", "lbf", weights=MODES[mode], band=band)


#: Functions that yield the measures of a family, by the family's name in study files.
FAMILIES: Mapping[str, Callable[[Car], Iterator[Measure]]] = {
    "ride": _ride,
    "numbers": _numbers,
    "tires": _tires,
    "accelerations": _accelerations,
    "travel": _travel,
    "energy": _energy,
    "velocities": _velocities,
    "tire_modes": _tire_modes,
    "tire_spectra": _tire_spectra,
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
        vehicle: Name of the vehicle's component.
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
        run: Run of a setup.
        measures: Measures that are computed from the run.
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
    """Return the share of the power of signals (C, N) about their means above a frequency [Hz].

    Args:
        signals: Signals (C, N).
        rate: Samples per second [Hz].
        high: Frequency [Hz].
    """
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
