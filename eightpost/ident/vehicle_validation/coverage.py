"""Check that a record stays within the amplitudes and frequencies that the tests of a fit covered."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eightpost.ident.vehicle_validation.comparison import quantity
from eightpost.signals.filters import lowpass

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from eightpost.signals import TimeSeries

    Ranges = Mapping[str, tuple[float, float]]

#: Largest ratio of a channel's peak to that of the tests; largest fraction of an output's RMS above the fit's band.
_BEYOND, _ABOVE = 1.1, 0.1

#: Band of the records that fits are made from [Hz]; peaks are compared in it.
_BAND = 50.0

#: Shocks below this fraction of the tests' velocities barely move: friction holds them.
_GENTLE = 0.05


def beyond(series: TimeSeries, ranges: Ranges) -> tuple[str, ...]:
    """Return up to two sentences on where a record leaves the amplitudes and the frequencies of the tests.

    Args:
        series: The record, without means.
        ranges: Ranges that a fit stores: smallest and largest value by channel, and of `frequency` [Hz].
    """
    return (*_amplitudes(series, ranges), *_frequencies(series, ranges))


def is_gentle(series: TimeSeries, ranges: Ranges) -> bool:
    """Return whether all shocks stay below 5 % of the velocities of the tests; False if that is not known."""
    names = [name for name in ranges if quantity(name) == "velocity" and name in series]
    return bool(names) and all(_peak(series, name) < _GENTLE * _covered(ranges, name) for name in names)


def _amplitudes(series: TimeSeries, ranges: Ranges) -> Iterator[str]:
    names = [name for name in ranges if name in series and _covered(ranges, name) > 0.0]
    times = {name: _peak(series, name) / _covered(ranges, name) for name in names}
    over = sorted((name for name in names if times[name] > _BEYOND), key=lambda name: -times[name])
    if over:
        yield f"amplitudes beyond the fit's tests: {', '.join(f'{name} {times[name]:.2g} times' for name in over)}"


def _frequencies(series: TimeSeries, ranges: Ranges) -> Iterator[str]:
    if "frequency" not in ranges:
        return
    high = ranges["frequency"][1]
    shares = {n: _share_above(series, n, high) for n in series.names if quantity(n) in ("velocity", "tire_force")}
    over = sorted((name for name in shares if shares[name] > _ABOVE), key=lambda name: -shares[name])
    if over:
        listed = ", ".join(f"{name} {100.0 * shares[name]:.0f} %" for name in over)
        yield f"RMS above {high:.3g} Hz, where the model was not fitted and no criterion applies: {listed}"


def _peak(series: TimeSeries, name: str) -> float:
    rate = series.sample_rate
    return float(np.abs(lowpass(series[name], rate, min(_BAND, 0.4 * rate), order=4)).max())


def _covered(ranges: Ranges, name: str) -> float:
    return max(abs(end) for end in ranges[name])


def _share_above(series: TimeSeries, name: str, high: float) -> float:
    lines = np.fft.rfftfreq(len(series), 1.0 / series.sample_rate)
    power = np.abs(np.fft.rfft(series[name] - series[name].mean())) ** 2
    whole = float(power.sum())
    return float(np.sqrt(power[lines > high].sum() / whole)) if whole else 0.0
