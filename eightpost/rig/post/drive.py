"""Inputs of the integration: drives of all runs, interpolated smoothly between their samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]


#: Sample rate of the rig's records (6.1.5) [Hz], and integration steps per sample, which give 5 kHz.
RATE, STEPS = 1250.0, 4

#: Duration of the lead-in before each record, in which the car comes into motion [s]; it is not recorded.
LEAD = 6.0


class Drives:
    """Drives of all runs as cubic Hermite splines through their samples.

    During the lead-in, the drive is its first sample multiplied by a factor that grows from 0 to 1 over the first third
    of the lead-in.

    Attributes:
        lead: Number of samples of the lead-in.
        values: Roads and loads (N, U) of each run, contiguous in memory by rows.
        slopes: Changes of the values per sample (N, U).
        growth: Factor of the drive during the lead-in and its change per sample (lead + N + 1, 2), for the longest run.
        weights: Weights (2, S, 4) of value, slope, next value and next slope, for the drive and for its slope.
    """

    def __init__(self, inputs: Sequence[Array], lead: int, steps: int = STEPS) -> None:
        """Prepare the drives.

        Args:
            inputs: Roads and loads (U, N) of each run at 1250 Hz. Runs may share an array.
            lead: Number of samples of the lead-in.
            steps: Number S of integration steps per sample.
        """
        self.lead = lead
        own = {id(values): values for values in inputs}
        rows = {key: np.ascontiguousarray(values.T) for key, values in own.items()}
        slopes = {key: np.gradient(values, axis=0) for key, values in rows.items()}
        self.values = [rows[id(values)] for values in inputs]
        self.slopes = [slopes[id(values)] for values in inputs]
        self.growth = _growth(lead, self.samples)
        self.weights = np.stack(_hermite(np.arange(1, steps + 1) / steps))

    @property
    def samples(self) -> int:
        """Number of samples of the longest run."""
        return max(len(values) for values in self.values)

    def between(self, sample: int) -> tuple[Array, Array]:
        """Return values and slopes [1/s] (S, U, B) of all runs after each step from `sample` to the next."""
        knots = np.stack([*self._at(sample), *self._at(sample + 1)])  # (4, B, U)
        values, slopes = (np.einsum("sk,kbu->sub", weights, knots) for weights in self.weights)
        return values, slopes * RATE

    def _at(self, sample: int) -> tuple[Array, Array]:
        """Return the values and slopes per sample (B, U) of every run at a sample."""
        growth, rise = self.growth[sample + self.lead]
        places = [min(max(sample, 0), len(rows) - 1) for rows in self.values]
        values = np.stack([rows[place] for rows, place in zip(self.values, places, strict=True)])
        slopes = np.stack([rows[p] * float(p == sample) for rows, p in zip(self.slopes, places, strict=True)])
        return values * growth, slopes * growth + values * rise


def _growth(lead: int, samples: int) -> Array:
    """Return the factor of the drive, a raised cosine, and its change per sample (lead + samples + 1, 2)."""
    ramp = max(lead // 3, 1)
    share = np.minimum(np.arange(lead + samples + 1) / ramp, 1.0)
    if lead == 0:
        share[:] = 1.0
    return np.stack([0.5 - 0.5 * np.cos(np.pi * share), 0.5 * np.pi / ramp * np.sin(np.pi * share)], axis=1)


def _hermite(s: Array) -> tuple[Array, Array]:
    """Return the weights (S, 4) of value, slope, next value and next slope, for the curve and for its slope."""
    curve = np.stack([2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s, 3 * s**2 - 2 * s**3, s**3 - s**2], axis=1)
    slope = np.stack([6 * s**2 - 6 * s, 3 * s**2 - 4 * s + 1, 6 * s - 6 * s**2, 3 * s**2 - 2 * s], axis=1)
    return curve, slope
