"""What the spectrum of a channel shows of its instrument: hum of the mains, and a moving average.

A moving average over T removes the frequencies k / T, of noise and of harmonics alike, so that its spectrum has lobes
between them. Neither the lag of a shock nor a filter with poles leaves such gaps.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from eightpost.array_types import Array
from eightpost.rig.cycles import displacement_of
from eightpost.rig.drift import explained
from eightpost.rig.plausibility_rules import HUM, SMOOTHED
from eightpost.signals.timeseries import TimeSeries
from eightpost.verdict import Reason

#: Frequencies of the mains [Hz], their tolerance, and the range around them in which nothing else is as large [Hz].
MAINS, TOLERANCE, AROUND = (50.0, 60.0), 0.3, 12.0
#: Smallest amplitude of hum as a share of the channel's range, and as a multiple of anything around it.
HUM_SHARE, HUM_RATIO = 2e-3, 4.0
#: Lowest frequency at which hum is looked for, because the motion is below [Hz].
LOWEST_HUM = 8.0
#: Durations of a moving average that are looked for [s], and smallest depth of its gaps (logarithm of power).
AVERAGES, DEPTH = (0.01, 0.12), 2.0
#: Number of durations that are tried, and of gaps that are examined: 1 % of error shifts the last one by 8 %.
CANDIDATES, GAPS = 250, 8
#: Length of the segments of the spectrum in periods of the motion, and smallest one [s].
PERIODS, SEGMENT = 10.0, 4.0
#: Smallest distance of the gaps in frequencies of the motion: the harmonics of a sine leave narrower ones as well.
NARROWEST = 4.0
#: Half width of a gap or of the top of a lobe, as a share of their distance; quantile that is noise between harmonics.
WIDTH, FLOOR = 0.1, 0.25


def spectrum_reasons(series: TimeSeries, measured: tuple[str, ...], origin: str) -> Iterator[Reason]:
    """Yield a reason for each channel with hum, and for a force that is a moving average.

    Args:
        series: Record with `velocity` [m/s], `force` [N] and optionally `displacement` [m].
        measured: Names of the channels that were measured, not derived.
        origin: Name of the record.
    """
    force, velocity, rate = series["force"], series["velocity"], series.sample_rate
    for name in ("force", "velocity", "displacement"):
        figure = _hum(series[name], rate) if name in measured else ""
        if name == "force" and not figure:  # without harmonics of the motion
            figure = _hum(force - explained(series).force, rate, float(np.ptp(force)))
        if figure:
            yield HUM.reason(f"the {name} has hum", figure=figure, origin=origin)
    frequency = float(velocity.std() / displacement_of(series).std()) / (2.0 * np.pi)
    if seconds := _average(force, rate, frequency):
        figure = f"a moving average over about {1e3 * seconds:.3g} ms"
        yield SMOOTHED.reason("the force is smoothed", figure=figure, origin=origin)


def _hum(values: Array, rate: float, span: float = 0.0) -> str:
    """Return a figure if `values` (N,) have a line at the frequency of the mains or its alias; empty otherwise."""
    window = np.hanning(values.size)
    size = 2.0 * np.abs(np.fft.rfft(window * (values - values.mean()))) / window.sum()
    frequency = np.fft.rfftfreq(values.size, 1.0 / rate)
    step = float(frequency[1])
    for mains in MAINS:
        seen = abs(mains - rate * round(mains / rate))
        if not LOWEST_HUM < seen < 0.48 * rate:
            continue
        distance = np.abs(frequency - seen)
        line = distance <= max(TOLERANCE, 2.0 * step)
        near = (distance <= AROUND) & (distance > max(3.0 * TOLERANCE, 6.0 * step))
        amplitude, share = float(size[line].max()), float(size[line].max()) / (span or float(np.ptp(values)))
        if share >= HUM_SHARE and amplitude >= HUM_RATIO * float(size[near].max(initial=0.0)):
            alias = "" if seen == mains else f" (seen at {seen:.3g} Hz)"
            return f"{100.0 * share:.2g} % of its range at {mains:.0f} Hz{alias}"
    return ""


def _average(values: Array, rate: float, motion: float) -> float:
    """Return the duration [s] of a moving average that made `values` (N,) of a motion [Hz]; 0 if none did."""
    if values.size * motion < PERIODS * rate:  # the ends of a short record leave lobes
        return 0.0
    count = min(values.size - 1, round(max(SEGMENT, PERIODS / motion) * rate))
    level = _level(np.diff(values), count)
    best, found = DEPTH, 0.0
    shortest, longest = max(3.0, AVERAGES[0] * rate), AVERAGES[1] * rate
    for samples in np.unique(np.round(np.geomspace(shortest, longest, CANDIDATES))).astype(int).tolist():
        depth = _depth(level, count / samples)
        if depth > best and rate / samples > NARROWEST * motion:
            best, found = depth, samples / rate
    return found


def _level(values: Array, count: int) -> Array:
    """Return the logarithm of the mean power of half overlapping segments of `count` of the values, in any unit."""
    segments = np.lib.stride_tricks.sliding_window_view(values, count)[:: count - count // 2]
    window = np.sin(np.pi * np.arange(count) / count) ** 2
    spectra = np.fft.rfft((segments - segments.mean(axis=1, keepdims=True)) * window)
    return np.asarray(np.log(np.maximum(np.mean(np.abs(spectra) ** 2, axis=0), 1e-300)))


def _depth(level: Array, spacing: float) -> float:
    """Return the median depth of the gaps in a spectrum (N,) at the multiples of a frequency [steps]."""
    half = max(WIDTH * spacing, 1.0)

    def floor(place: float) -> float:
        """Return the noise of the spectrum around a multiple of the frequency."""
        part = level[int(np.ceil(place * spacing - half)) : int(place * spacing + half) + 1]
        return float(np.sort(part)[int(FLOOR * part.size)])

    last = (level.size - 1 - half) / spacing
    depths = [
        np.mean([floor(place) for place in (k - 0.5, k + 0.5) if place <= last]) - floor(k)
        for k in range(1, min(GAPS, int(last)) + 1)
    ]
    return float(np.median(depths)) if len(depths) > 1 else 0.0
