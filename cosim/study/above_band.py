"""Share of a measure's power that lies above the frequencies for which its vehicle was identified."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from cosim.study.measures import Measure
from cosim.study.statistics import Filtered
from eightpost.array_types import Array
from eightpost.errors import EightpostError
from eightpost.validity import Validity

#: Statistics without a power: shares of time, and means.
_NO_POWER = ("share", "mean")


class AboveBand(NamedTuple):
    """Power of a measure above the band of its vehicle."""

    high: float  #: Upper end of the band in which the vehicle was identified [Hz].
    share: float  #: Share of the power of the measure's signals above it [1].


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
            share = power_above(measure.signals(run, start=start), run.series.sample_rate, min(known))
            found[measure.name] = AboveBand(min(known), share)
    return found


def power_above(signals: Array, rate: float, high: float) -> float:
    """Return the share of the power of signals (C, N) about their means above a frequency [Hz].

    Args:
        signals: Signals (C, N).
        rate: Samples per second [Hz].
        high: Frequency [Hz].
    """
    windowed = (signals - signals.mean(axis=1, keepdims=True)) * np.hanning(signals.shape[1])
    power = np.sum(np.abs(np.fft.rfft(windowed, axis=1)) ** 2, axis=0)
    lines, whole = np.fft.rfftfreq(signals.shape[1], 1.0 / rate), float(power.sum())
    return float(power[lines > high].sum()) / whole if whole else 0.0
