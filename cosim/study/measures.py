"""Measures of a study: levels of ride height, tire force and other signals, and measures of the user's own."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np

from cosim.study.statistics import Filtered, Response, options_for, statistic
from eightpost.array_types import Array
from eightpost.corners import CORNERS
from eightpost.errors import InputError
from eightpost.signals import TimeSeries
from eightpost.units import us_customary

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
