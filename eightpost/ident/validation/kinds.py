"""Recognition of the kind of test of a dynamometer record from its motion (3.2.3)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from eightpost.ident.shock.record.preparation import single_frequency
from eightpost.ident.validation.motion import displacement_of, moving_part, refined_frequency, standing
from eightpost.units import convert

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from eightpost.rig.dyno_test import DynoTest
    from eightpost.signals import TimeSeries

    Array = NDArray[np.float64]

Kind = Literal["random", "sine", "static", "bump"]

#: Minimum number of periods for a record with one frequency to be a sine test.
_PERIODS = 1.8

#: Share of the time at standstill from which a record is a static test or a bump.
_STANDING = 0.5

#: Limit between the dissertation's static test (0.2 in/s) and its bump (30 in/s) [m/s].
SLOW = convert(1.0, "in/s", "m/s")

#: Maximum number of samples used for the recognition.
_ENOUGH = 40_000


@dataclass(frozen=True, slots=True)
class Recognition:
    """The kind of a record and the reason for it.

    Attributes:
        kind: `random`, `sine`, `static` or `bump`.
        reason: Description of the motion that led to this kind.
        frequency: Frequency of a sine [Hz]; None for other kinds.
    """

    kind: Kind
    reason: str
    frequency: float | None = None


def recognise(test: DynoTest) -> Recognition:
    """Return the kind of test of a record.

    The rules are applied in this order:

    1. sine: in its part between the first and the last motion, at least 1.8 periods, and 90 % of the velocity's power
       within 20 % of one frequency;
    2. static: it stands still at least half of the time and is never faster than 1 in/s (Fig 3.12: 0.2 in/s);
    3. bump: it stands still at least half of the time and is faster (Fig 3.13: 30 in/s);
    4. random: everything else, including track records.

    Args:
        test: Test with displacement; if displacement is missing, the velocity is integrated.
    """
    series = _coarse(test.series)
    frequency = frequency_of(series)
    if frequency is not None:
        return Recognition("sine", f"one frequency, {frequency:.4g} Hz", frequency)
    share = float(np.mean(standing(series)))
    if share < _STANDING:
        return Recognition("random", f"moves {100.0 * (1.0 - share):.0f} % of the time, at many frequencies")
    speed = _speed(series)
    stands = f"stands still {100.0 * share:.0f} % of the time, moves at up to {convert(speed, 'm/s', 'in/s'):.2g} in/s"
    return Recognition("static" if speed < SLOW else "bump", stands)


def frequency_of(series: TimeSeries) -> float | None:
    """Return the frequency [Hz] of a record that is a sine, else None."""
    part = moving_part(series)
    coarse = single_frequency(part["velocity"], part.sample_rate)
    if coarse is None or coarse * part.duration < _PERIODS:
        return None
    if coarse * part.duration > 3.0:  # the first and last half period may include standstill
        part = part.window(float(part.time[0]) + 0.5 / coarse, float(part.time[-1]) - 0.5 / coarse)
    return refined_frequency(displacement_of(part), part.time, coarse)


def _coarse(series: TimeSeries) -> TimeSeries:
    """Return a long record averaged over blocks of samples; the rate stays at 200 Hz or more."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    count = min(len(even) // _ENOUGH + 1, max(1, int(even.sample_rate // 200.0)))
    return block_means(even, count)


def block_means(series: TimeSeries, count: int) -> TimeSeries:
    """Return the means of every `count` samples, at the mean of their times."""
    if count < 2:
        return series
    whole = len(series) // count * count
    values = series.values[:, :whole].reshape(len(series.names), -1, count).mean(axis=2)
    time = series.time[:whole].reshape(-1, count).mean(axis=1)
    return type(series)(time, values, series.names, series.units)


def _speed(series: TimeSeries) -> float:
    """Return the peak speed [m/s] of means over 5 ms, so that noise of the velocity sensor has no effect."""
    count = max(1, int(0.005 * series.sample_rate))
    return float(np.abs(block_means(series, count)["velocity"]).max())
