"""Both branches of a loop of force over velocity, in classes of velocity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eightpost.array_types import Array
from eightpost.ident.dyno_report.cycles import path_of
from eightpost.rig.cycles import SMALLEST, turning_points
from eightpost.signals import TimeSeries
from eightpost.signals.filters import derivative, lowpass

#: Number of classes of speed in each stroke, and minimum number of samples of each branch in a class.
CLASSES, FEWEST_SAMPLES = 40, 3
#: Cut-off frequency of the acceleration that distinguishes the branches, over the usual frequency of the motion.
HARMONICS = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class LoopClasses:
    """Classes of velocity of a record that have samples on both branches.

    Attributes:
        cell: Number of the class and branch of each sample (N,): class times 2, plus 1 while the velocity rises.
        counts: Number of samples of each class and branch (2 C,).
        kept: Whether each class (C,) has enough samples on both branches.
    """

    cell: NDArray[np.intp]
    counts: NDArray[np.intp]
    kept: NDArray[np.bool_]

    @classmethod
    def of(cls, series: TimeSeries) -> LoopClasses:
        """Return the classes of a record; no class contains zero velocity."""
        velocity = series["velocity"]
        low, high = min(float(velocity.min()), 0.0), max(float(velocity.max()), 0.0)
        edges = np.concatenate([np.linspace(low, 0.0, CLASSES + 1), np.linspace(0.0, high, CLASSES + 1)[1:]])
        number = np.maximum(np.searchsorted(edges, velocity, "left") - 1, 0)
        cell = 2 * number + (_acceleration(series) > 0.0)
        counts = np.bincount(cell, minlength=4 * CLASSES)
        kept = np.asarray((counts.reshape(-1, 2) >= FEWEST_SAMPLES).all(axis=1))
        return cls(cell, counts, kept)

    def means(self, row: Array) -> Array:
        """Return the means (2, K) of a channel (N,) on the falling and the rising branch of the kept classes."""
        sums = np.bincount(self.cell, weights=row, minlength=self.counts.size)
        return np.asarray((sums / np.maximum(self.counts, 1)).reshape(-1, 2)[self.kept].T)


def _acceleration(series: TimeSeries) -> Array:
    """Return the acceleration (N,) [m/s2], low-passed so that noise does not change its sign."""
    rate, path = series.sample_rate, path_of(series)
    turns = turning_points(path, threshold=SMALLEST * float(np.ptp(path)))
    usual = rate / (2.0 * float(np.median(np.diff(turns)))) if len(turns) > 1 else rate  # [Hz]
    return derivative(lowpass(series["velocity"], rate, min(HARMONICS * usual, 50.0, 0.2 * rate), order=4), rate)
