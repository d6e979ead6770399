"""Strokes of the records of a fit: the ranges of their lengths, peak speeds and frequencies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eightpost.array_types import Array
from eightpost.ident.shock.record import Prepared

#: Speed below which the shock counts as at rest, over the peak speed of the record.
_AT_REST = 0.02

#: Share of the time at either end of a range that does not count.
_LEFT_OUT = 0.1

#: Frequencies of strokes within this factor are one frequency.
ONE_FREQUENCY = 1.5


@dataclass(frozen=True, slots=True)
class StrokeRange:
    """Ranges of the strokes of records, each without a tenth of the time at either end."""

    stroke: tuple[float, float]  #: Lengths [m].
    speed: tuple[float, float]  #: Peak speeds [m/s].
    frequency: tuple[float, float]  #: Frequencies [Hz]: the inverse of twice the duration of a stroke.

    @classmethod
    def of(cls, prepared: Sequence[Prepared]) -> StrokeRange:
        """Return the ranges of prepared records."""
        found = [strokes(p.record["velocity"][p.inside], p.step) for p in prepared]
        stroke, speed, duration = np.hstack(found)
        return cls(*(_range(values, duration) for values in (stroke, speed, 0.5 / duration)))

    @property
    def has_one_frequency(self) -> bool:
        """Whether nearly all strokes have the same frequency, as in a sine."""
        low, high = self.frequency
        return high <= ONE_FREQUENCY * low

    def __str__(self) -> str:
        millimetres = (1e3 * self.stroke[0], 1e3 * self.stroke[1])
        return f"strokes of {_ends(millimetres)} mm, peak speeds of {_ends(self.speed)} m/s, {_ends(self.frequency)} Hz"


def strokes(velocity: Array, step: float) -> Array:
    """Return length [m], peak speed [m/s] and duration [s] of each stroke of a velocity (N,), as (3, S).

    The first and the last stroke of a record are incomplete; they count only if there is no other one.
    """
    moving = np.flatnonzero(np.abs(velocity) > _AT_REST * np.abs(velocity).max())
    turns = moving[1:][np.diff(np.sign(velocity[moving])) != 0.0]
    if turns.size < 2:
        turns = np.array([0, *turns, velocity.size])
    velocity, starts = velocity[: turns[-1]], turns[:-1]
    length = np.abs(np.add.reduceat(velocity, starts)) * step
    return np.array([length, np.maximum.reduceat(np.abs(velocity), starts), np.diff(turns) * step])


def _ends(ends: tuple[float, float]) -> str:
    low, high = (f"{end:.2g}" for end in ends)
    return low if low == high else f"{low} to {high}"


def _range(values: Array, duration: Array) -> tuple[float, float]:
    order = np.argsort(values)
    share = np.cumsum(duration[order]) / duration.sum()
    low, high = np.searchsorted(share, [_LEFT_OUT, 1.0 - _LEFT_OUT])
    return float(values[order[low]]), float(values[order[high]])
