"""Measures of a batch: those that are summed while it runs, and those that need the series."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from cosim.study.batch.plan import Quantity
from cosim.study.measures import Measure
from eightpost.array_types import Array
from eightpost.errors import InputError

# ---- Statistics of a quantity ---------------------------------------------------------------------------------------

_SHIFT, _SUM, _SQUARES, _LEAST, _LARGEST, _INSIDE, _FIRST, _LAST = range(8)


@dataclass(frozen=True, slots=True, eq=False)
class _Summed:
    """Statistics of a measure's quantities (Q, 8, n) over `count` rows that are `step` [s] apart."""

    of: Array
    count: int
    step: float

    @property
    def mean(self) -> Array:
        """Mean of the first quantity (n,)."""
        return np.asarray(self.of[0, _SHIFT] + self.of[0, _SUM] / self.count)

    @property
    def variances(self) -> Array:
        """Variance of every quantity (Q, n)."""
        apart = self.of[:, _SUM] / self.count
        return np.asarray(np.maximum(self.of[:, _SQUARES] / self.count - apart**2, 0.0))

    @property
    def rms(self) -> Array:
        """Root mean square about the mean of the first quantity (n,)."""
        return np.asarray(np.sqrt(self.variances[0]))

    @property
    def peak(self) -> Array:
        """Largest distance from the mean (n,)."""
        return np.asarray(np.maximum(self.of[0, _LARGEST] - self.mean, self.mean - self.of[0, _LEAST]))

    @property
    def integral(self) -> Array:
        """Integral over time by the trapezoidal rule (n,)."""
        total = self.count * self.of[0, _SHIFT] + self.of[0, _SUM]
        return np.asarray(self.step * (total - 0.5 * (self.of[0, _FIRST] + self.of[0, _LAST])))


#: Statistics that are computed from the sums, by the names in cosim.study.statistics.
_STREAMED: Mapping[str, Callable[[_Summed], Array]] = {
    "rms": lambda s: s.rms,
    "rms_with_mean": lambda s: np.sqrt(s.variances[0] + s.mean**2),
    "joint_rms": lambda s: np.sqrt(s.variances.mean(axis=0)),
    "mean": lambda s: s.mean,
    "peak": lambda s: s.peak,
    "range": lambda s: s.of[0, _LARGEST] - s.of[0, _LEAST],
    "maximum": lambda s: s.of[0, _LARGEST],
    "minimum": lambda s: s.of[0, _LEAST],
    "variation": lambda s: s.rms / np.abs(s.mean),
    "work": lambda s: s.integral,
    "share": lambda s: s.of[0, _INSIDE] / s.count,
}


#: Statistics that need the smallest or the largest value, or the share inside limits.
_WITH_LIMITS = ("peak", "range", "maximum", "minimum", "share")


# ---- Measures of a run ----------------------------------------------------------------------------------------------


class BatchMeasures:
    """Measures on a drive, divided into those that are summed and those that need series.

    Args:
        measures: Measures of the drive.
        times: Times of the recorded rows (R,) [s].
        settling: Time at the start of the run that the measures exclude [s].
    """

    def __init__(self, measures: Sequence[Measure], times: Array, settling: float) -> None:
        self._windows = {m.name: _window(m, times, settling) for m in measures}
        self.summed = tuple(m for m in measures if _is_summed(m, self._windows[m.name]))
        self.others = tuple(m for m in measures if m not in self.summed)
        found = [self._quantities(m) for m in self.summed]
        self.quantities = tuple(q for several in found for q in several)
        self._begins = list(accumulate(map(len, found), initial=0))
        self._step = float(times[-1] - times[0]) / (times.size - 1)

    @property
    def series(self) -> tuple[str, ...]:
        """Channels of the measures that need series."""
        return tuple(dict.fromkeys(channel for m in self.others for channel in m.channels))

    def values(self, statistics: Array) -> dict[str, Array]:
        """Return the values (n,) of the summed measures, in SI, from the statistics of the quantities (Q, 8, n).

        Raises:
            InputError: A measure is not defined for a setup.
        """
        found = {}
        for k, measure in enumerate(self.summed):
            begin, end = self._windows[measure.name]
            summed = _Summed(statistics[self._begins[k] : self._begins[k + 1]], end - begin, self._step)
            if measure.statistic == "variation" and not summed.mean.all():
                raise InputError(f"measure {measure.name!r}: the mean is zero")
            found[measure.name] = _STREAMED[measure.statistic](summed)
        return found

    def _quantities(self, measure: Measure) -> list[Quantity]:
        rows, weights = self._windows[measure.name], measure.weights or (1.0,) * len(measure.channels)
        if measure.statistic == "joint_rms":
            return [Quantity((c,), (w,), rows) for c, w in zip(measure.channels, weights, strict=True)]
        inside = (measure.options["from"], measure.options["to"]) if measure.statistic == "share" else (-np.inf, np.inf)
        limits = measure.statistic in _WITH_LIMITS
        return [Quantity(measure.channels, weights, rows, measure.statistic == "work", inside, limits)]


def _is_summed(measure: Measure, window: tuple[int, int]) -> bool:
    known = not measure.function and measure.band is None and measure.statistic in _STREAMED
    return known and window[1] - window[0] >= 2


def _window(measure: Measure, times: Array, settling: float) -> tuple[int, int]:
    """Return the rows of a measure, as cosim.study.statistics.Filtered does."""
    first, last = measure.section or (-np.inf, np.inf)
    begin, end = np.searchsorted(times, (max(first, settling) - 1e-9, last + 1e-9)).tolist()
    return begin, end
