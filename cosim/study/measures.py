"""Response measures: a run in a few numbers (2.5, chapter 7)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from eightpost.signals import TimeSeries

Statistic = Literal["rms", "mean"]

_STATISTICS: tuple[tuple[str, Statistic], ...] = (("RMS", "rms"), ("mean", "mean"))


@dataclass(frozen=True, slots=True)
class Measure:
    """A number drawn from a run.

    Args:
        name: As people say it.
        channels: What it looks at; several are added up sample by sample first.
        statistic: `rms` (mean removed) or `mean`.
        display: Unit to show it in.
    """

    name: str
    channels: tuple[str, ...]
    statistic: Statistic
    display: str

    def of(self, series: TimeSeries) -> float:
        """Return the measure in SI.

        Raises:
            MissingChannelError: The series lacks one of its channels.
        """
        values = np.sum([series[name] for name in self.channels], axis=0)
        return float(np.mean(values)) if self.statistic == "mean" else rms(values)

    def unit(self, series: TimeSeries) -> str:
        """Return the SI unit of the measure."""
        return series.unit(self.channels[0])


def rms(values: NDArray[np.float64]) -> float:
    """Return the root mean square of the values less their mean, in their unit."""
    return float(np.std(values))


def available(measures: Sequence[Measure], *runs: TimeSeries) -> tuple[Measure, ...]:
    """Return the measures whose channels every run has."""
    return tuple(m for m in measures if all(channel in run for run in runs for channel in m.channels))


def channel_measures(series: TimeSeries, display: Mapping[str, str]) -> tuple[Measure, ...]:
    """Return RMS and mean of every channel; `display` gives the unit to show by SI unit."""
    return tuple(
        Measure(f"{name}, {label}", (name,), statistic, display.get(unit, unit))
        for name, unit in zip(series.names, series.units, strict=True)
        for label, statistic in _STATISTICS
    )


def ride_measures(vehicle: str, corners: Sequence[str] = ("lf", "rf", "lr", "rr")) -> tuple[Measure, ...]:
    """Return the measures of chapter 7 for a car with the channels of docs/ports.md.

    Total tire force (the grip number is drawn from it), ride heights (the aero number), hub accelerations and shock
    velocities.
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
