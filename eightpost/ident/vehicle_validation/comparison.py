"""Predicted beside measured, output by output, both in the band of the fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from eightpost.errors import TooShortError
from eightpost.signals import TimeSeries
from eightpost.signals.filters import lowpass

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: The sum of the four tire forces: the measure of grip (2.5).
TOTAL = "total_tire_force"

#: Quantities that setups are judged by.
JUDGED = ("velocity", "tire_force", "ride_height", TOTAL)

#: An output with less than this part of the largest of its quantity hardly moves in a record.
_QUIET = 0.1

#: Order of the low-pass, run twice; its last part, where it rings, is left out [s].
_ORDER, _END = 4, 0.5

#: Most of a record that settling may take [1].
_MOST_SETTLING = 0.25


def quantity(name: str) -> str:
    """Return what a channel is, without its corner or axle."""
    return name.rpartition(".")[2]


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """One output of one record.

    Attributes:
        name: Of the output.
        unit: SI.
        measured: (N,), without its mean.
        predicted: (N,), without its mean.
        is_judged: Whether setups are judged by its quantity and it moves enough here to be judged itself.
    """

    name: str
    unit: str
    measured: Array
    predicted: Array
    is_judged: bool

    @property
    def rms(self) -> tuple[float, float]:
        """Measured and predicted."""
        return float(self.measured.std()), float(self.predicted.std())

    @property
    def level(self) -> float:
        """By how much the predicted RMS is too large [1]."""
        measured, predicted = self.rms
        return predicted / measured - 1.0

    @property
    def error(self) -> float:
        """RMS of the difference over that of the measured output [1]."""
        return float((self.measured - self.predicted).std() / self.rms[0])

    @property
    def correlation(self) -> float:
        """Of predicted and measured [1]; 0 where the prediction stands."""
        measured, predicted = self.rms
        return float(np.mean(self.measured * self.predicted) / (measured * predicted)) if predicted else 0.0


@dataclass(frozen=True, slots=True)
class Judging:
    """The part of records and signals that is judged.

    Attributes:
        band: Upper end of the low-pass that both sides pass [Hz].
        settling: Left out at the start [s], at most a quarter of the record: the car's state at the start is not known.
    """

    band: float
    settling: float = 4.0

    def inside(self, series: TimeSeries) -> TimeSeries:
        """Return the part of a series that is judged, low-passed, without means."""
        rate = series.sample_rate
        rows = lowpass(series.values, rate, min(self.band, 0.4 * rate), order=_ORDER)
        start = min(self.settling, _MOST_SETTLING * series.duration)
        kept = slice(round(start * rate), len(series) - round(_END * rate))
        rows = rows[:, kept]
        if rows.shape[1] < rate:
            raise TooShortError(f"of {series.duration:.3g} s less than 1 s is left to be judged; give a longer record")
        rows = rows - rows.mean(axis=1, keepdims=True)
        channels = {n: (u, row) for n, u, row in zip(series.names, series.units, rows, strict=True)}
        return TimeSeries.from_channels(series.time[kept], channels)


def with_total(series: TimeSeries) -> TimeSeries:
    """Return a series with the sum of its four tire forces, where it has them."""
    forces = [series[name] for name in series.names if quantity(name) == "tire_force"]
    return series.with_channel(TOTAL, "N", np.sum(forces, axis=0)) if len(forces) == 4 else series


def compare(measured: TimeSeries, predicted: TimeSeries) -> tuple[Comparison, ...]:
    """Return the outputs that both have and that are alive in the measurement.

    Args:
        measured: As `Judging.inside` gives it.
        predicted: As well.
    """
    names = [name for name in predicted.names if name in measured and measured[name].std() > 0.0]
    moving = _moving(measured, names)
    return tuple(
        Comparison(n, measured.unit(n), measured[n], predicted[n], quantity(n) in JUDGED and n in moving) for n in names
    )


def _moving(measured: TimeSeries, names: Iterable[str]) -> set[str]:
    """Return the outputs that are not quiet beside others of their quantity."""
    sizes = {name: float(measured[name].std()) for name in names}
    largest: dict[str, float] = {}
    for name, size in sizes.items():
        largest[quantity(name)] = max(size, largest.get(quantity(name), 0.0))
    return {name for name, size in sizes.items() if size >= _QUIET * largest[quantity(name)]}
