"""Comparison of predicted with measured signals."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.signal import coherence, welch

from eightpost.array_types import Array
from eightpost.errors import TooShortError
from eightpost.signals import TimeSeries
from eightpost.signals.filters import lowpass

# ---- Spectra of the prediction error, and the part of it that is linear in the prediction ---------------------------

#: Length of Welch's blocks [s] and the minimum number of them (overlapping by half).
_BLOCK, _FEWEST = 4.0, 6


@dataclass(frozen=True, slots=True, eq=False)
class ErrorSpectrum:
    """Spectra of an output and of the error of its prediction, one-sided.

    Attributes:
        frequency: Frequencies (K,) [Hz].
        measured: Power spectral density of the measured output (K,) [unit^2/Hz].
        error: Power spectral density of the error (K,) [unit^2/Hz].
        coherence: Coherence of error and prediction (K,) [1]; near 1 if another gain or phase would have predicted it.
        linear: Fraction of the error's power that is coherent with the prediction, corrected for bias [1].
    """

    frequency: Array
    measured: Array
    error: Array
    coherence: Array
    linear: float


def error_spectrum(output: Comparison, rate: float, band: float) -> ErrorSpectrum | None:
    """Return the spectra of an output's error; None if the record is too short for them.

    Args:
        output: Measured and predicted output.
        rate: Sample rate [Hz].
        band: Highest frequency [Hz].
    """
    block = round(_BLOCK * rate)
    count = 2 * output.measured.size // block - 1
    if count < _FEWEST or not output.predicted.any():
        return None
    error = output.measured - output.predicted
    frequency, measured = welch(output.measured, fs=rate, nperseg=block)
    density = welch(error, fs=rate, nperseg=block)[1]
    coherent = coherence(error, output.predicted, fs=rate, nperseg=block)[1]
    kept = (frequency > 0.0) & (frequency <= band)
    unbiased = np.clip((count * coherent[kept] - 1.0) / (count - 1.0), 0.0, 1.0)
    share = float(unbiased @ density[kept] / density[kept].sum()) if density[kept].any() else 0.0
    return ErrorSpectrum(frequency[kept], measured[kept], density[kept], coherent[kept], share)


# ---- Comparison of predicted and measured outputs in the band of the fit --------------------------------------------

#: The sum of the four tire forces: the measure of grip (2.5).
TOTAL = "total_tire_force"

#: Quantities that setups are judged by; the criteria of the verdict apply to them.
JUDGED = ("velocity", "tire_force", "ride_height", TOTAL)

#: An output below this fraction of the largest of its quantity barely moves in a record.
_QUIET = 0.1

#: Order of the low-pass, run forward and backward; time omitted at the end, where the filter rings [s].
_ORDER, _END = 4, 0.5

#: Largest fraction of a record that is omitted for settling [1].
_MOST_SETTLING = 0.25


def quantity(name: str) -> str:
    """Return the quantity of a channel: its name without corner or axle."""
    return name.rpartition(".")[2]


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Measured and predicted values of one output of one record.

    Attributes:
        name: Name of the output.
        unit: SI unit.
        measured: Measured values without their mean (N,).
        predicted: Predicted values without their mean (N,).
        is_judged: Whether the criteria apply: setups are judged by the quantity, and the output moves enough here.
    """

    name: str
    unit: str
    measured: Array
    predicted: Array
    is_judged: bool

    @property
    def rms(self) -> tuple[float, float]:
        """RMS, measured and predicted."""
        return float(self.measured.std()), float(self.predicted.std())

    @property
    def level(self) -> float:
        """Relative error of the predicted RMS [1]; positive if it is too large."""
        measured, predicted = self.rms
        return predicted / measured - 1.0

    @property
    def error(self) -> float:
        """RMS of measured minus predicted, over the measured RMS [1]."""
        return float((self.measured - self.predicted).std() / self.rms[0])

    @property
    def correlation(self) -> float:
        """Correlation of predicted and measured values [1]; 0 if the prediction is constant."""
        measured, predicted = self.rms
        return float(np.mean(self.measured * self.predicted) / (measured * predicted)) if predicted else 0.0


@dataclass(frozen=True, slots=True)
class Judging:
    """Band and time span that the criteria apply to.

    Attributes:
        band: Cut-off frequency of the low-pass that measurement and prediction pass [Hz].
        settling: Time omitted at the start, because the car's initial state is not known [s]; at most a quarter of the
            record.
    """

    band: float
    settling: float = 4.0

    def inside(self, series: TimeSeries) -> TimeSeries:
        """Return the judged part of a series, low-passed and without means."""
        rate = series.sample_rate
        rows = lowpass(series.values, rate, min(self.band, 0.4 * rate), order=_ORDER)
        start = min(self.settling, _MOST_SETTLING * series.duration)
        kept = slice(round(start * rate), len(series) - round(_END * rate))
        rows = rows[:, kept]
        if rows.shape[1] < rate:
            raise TooShortError(f"less than 1 s of {series.duration:.3g} s is left to be judged; give a longer record")
        rows = rows - rows.mean(axis=1, keepdims=True)
        channels = {n: (u, row) for n, u, row in zip(series.names, series.units, rows, strict=True)}
        return TimeSeries.from_channels(series.time[kept], channels)


def with_total(series: TimeSeries) -> TimeSeries:
    """Return a series with the sum of its four tire forces added; unchanged if it does not have all four."""
    forces = [series[name] for name in series.names if quantity(name) == "tire_force"]
    return series.with_channel(TOTAL, "N", np.sum(forces, axis=0)) if len(forces) == 4 else series


def compare(measured: TimeSeries, predicted: TimeSeries) -> tuple[Comparison, ...]:
    """Return the comparisons of all outputs that are in both series and not constant in the measurement.

    Args:
        measured: Measured outputs, processed by `Judging.inside`.
        predicted: Predicted outputs, processed by `Judging.inside`.
    """
    names = [name for name in predicted.names if name in measured and measured[name].std() > 0.0]
    moving = _moving(measured, names)
    return tuple(
        Comparison(n, measured.unit(n), measured[n], predicted[n], quantity(n) in JUDGED and n in moving) for n in names
    )


def _moving(measured: TimeSeries, names: Iterable[str]) -> set[str]:
    """Return the outputs that move enough, compared with the largest of their quantity."""
    sizes = {name: float(measured[name].std()) for name in names}
    largest: dict[str, float] = {}
    for name, size in sizes.items():
        largest[quantity(name)] = max(size, largest.get(quantity(name), 0.0))
    return {name for name, size in sizes.items() if size >= _QUIET * largest[quantity(name)]}
