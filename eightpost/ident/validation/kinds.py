"""What test a dynamometer record is, told by how its displacement moves (3.2.3)."""

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

#: Fewest periods from which a record with one frequency is a sine test.
_PERIODS = 1.8

#: Share of the time from which a record that stands is a static test or a bump.
_STANDING = 0.5

#: Between the dissertation's static test (0.2 in/s) and its bump (30 in/s) [m/s].
SLOW = convert(1.0, "in/s", "m/s")

#: Most samples that are looked at.
_ENOUGH = 40_000


@dataclass(frozen=True, slots=True)
class Recognition:
    """What a record is and why.

    Attributes:
        kind: `random`, `sine`, `static` or `bump`.
        reason: What was seen of its motion, for people.
        frequency: Of a sine [Hz]; None of the others.
    """

    kind: Kind
    reason: str
    frequency: float | None = None


def recognise(test: DynoTest) -> Recognition:
    """Say what test a record is.

    In this order:

    1. sine: of its part between the first and the last motion, at least 1.8 periods, 90 % of the velocity's power
       lies within 20 % of one frequency;
    2. static: it stands at least half of the time and is nowhere faster than 1 in/s (Fig 3.12: 0.2 in/s);
    3. bump: it stands at least half of the time and is faster (Fig 3.13: 30 in/s);
    4. random: all else; track records too.

    Args:
        test: With displacement; without it the velocity is integrated.
    """
    series = _coarse(test.series)
    frequency = frequency_of(series)
    if frequency is not None:
        return Recognition("sine", f"one frequency, {frequency:.4g} Hz", frequency)
    share = float(np.mean(standing(series)))
    if share < _STANDING:
        return Recognition("random", f"moves {100.0 * (1.0 - share):.0f} % of the time, at many frequencies")
    speed = _speed(series)
    stands = f"stands {100.0 * share:.0f} % of the time, moves at up to {convert(speed, 'm/s', 'in/s'):.2g} in/s"
    return Recognition("static" if speed < SLOW else "bump", stands)


def frequency_of(series: TimeSeries) -> float | None:
    """Return the frequency [Hz] of a record that is a sine, else None."""
    part = moving_part(series)
    coarse = single_frequency(part["velocity"], part.sample_rate)
    if coarse is None or coarse * part.duration < _PERIODS:
        return None
    if coarse * part.duration > 3.0:  # the first and last half period may have rest in them
        part = part.window(float(part.time[0]) + 0.5 / coarse, float(part.time[-1]) - 0.5 / coarse)
    return refined_frequency(displacement_of(part), part.time, coarse)


def _coarse(series: TimeSeries) -> TimeSeries:
    """Return a long record with means of blocks in place of its samples; 200 Hz or more are left."""
    even = series if series.is_uniform else series.resample(series.sample_rate)
    count = min(len(even) // _ENOUGH + 1, max(1, int(even.sample_rate // 200.0)))
    return block_means(even, count)


def block_means(series: TimeSeries, count: int) -> TimeSeries:
    """Return the means of every `count` samples, at the means of their times."""
    if count < 2:
        return series
    whole = len(series) // count * count
    values = series.values[:, :whole].reshape(len(series.names), -1, count).mean(axis=2)
    time = series.time[:whole].reshape(-1, count).mean(axis=1)
    return type(series)(time, values, series.names, series.units)


def _speed(series: TimeSeries) -> float:
    """Return the peak speed [m/s] of means over 5 ms: the velocity sensor's noise is not motion."""
    count = max(1, int(0.005 * series.sample_rate))
    return float(np.abs(block_means(series, count)["velocity"]).max())
