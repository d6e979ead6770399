"""Spectra of measures: the share of power above the band of the vehicle, and the shares in bands."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from cosim.study.measures import Measure
from cosim.study.statistics import Filtered
from eightpost.array_types import Array
from eightpost.errors import EightpostError
from eightpost.measure_uncertainty import band_shares
from eightpost.validity import Validity

#: Statistics without a power: shares of time, and means.
_NO_POWER = ("share", "mean")


class AboveBand(NamedTuple):
    """Power of a measure above the band of its vehicle."""

    high: float  #: Upper end of the band in which the vehicle was identified [Hz].
    share: float  #: Share of the power of the measure's signals above it [1].
    #: Shares of the power in the bands of `eightpost.measure_uncertainty`; empty in files of earlier versions.
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
