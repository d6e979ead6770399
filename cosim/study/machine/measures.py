"""Measures of a batch: those that are summed while it runs, those of filtered channels, and those of the series."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cosim.study.measures import Measure, Sections, sections_of
from eightpost.array_types import Array
from eightpost.machine import Quantity
from eightpost.signals import TimeSeries

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


#: Statistics that are computed from the sums, by the names in cosim.study.measures.
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

#: A channel and the band to which it is filtered [Hz].
ChannelBand = tuple[str, tuple[float, float]]


class BatchMeasures:
    """Measures on a drive: summed while the batch runs, computed from channels filtered in lanes, or from the series.

    Args:
        measures: Measures of the drive.
        times: Times of the recorded rows (R,) [s].
        settling: Time at the start of the run that the measures exclude [s].

    Attributes:
        summed: Measures that are summed while the batch runs.
        quantities: Quantities of which the statistics are summed, each once.
        bands: Filter of every channel that is filtered in lanes.
        filtered: Measures of such channels.
        filtered_quantities: Quantities of these measures, with the band of their channels.
        others: Measures that need the series of each setup.
    """

    def __init__(self, measures: Sequence[Measure], times: Array, settling: float) -> None:
        self._windows = {m.name: _window(m, times, settling) for m in measures}
        self._step = float(times[-1] - times[0]) / (times.size - 1)
        self.bands = _bands(measures, times)
        known = [m for m in measures if self._is_known(m)]
        self.summed = tuple(m for m in known if m.band is None)
        self.filtered = tuple(m for m in known if m.band and all((c, m.band) in self.bands for c in m.channels))
        self.others = tuple(m for m in measures if m not in self.summed and m not in self.filtered)
        self.quantities = tuple(dict.fromkeys(q for m in self.summed for q in self._quantities_of(m)))
        self.filtered_quantities = tuple((q, m.band) for m in self.filtered if m.band for q in self._quantities_of(m))
        every = (*((q, None) for q in self.quantities), *self.filtered_quantities)
        self._places = {
            m.name: [every.index((q, m.band)) for q in self._quantities_of(m)] for m in (*self.summed, *self.filtered)
        }

    @property
    def series(self) -> tuple[str, ...]:
        """Channels of the measures that need series."""
        return tuple(dict.fromkeys(channel for m in (*self.filtered, *self.others) for channel in m.channels))

    def values(self, statistics: Array) -> dict[str, list[float]]:
        """Return the values (n,) of the summed and the filtered measures, in SI; not finite if one is not defined.

        Args:
            statistics: Statistics of the quantities, then of the filtered quantities (Q, 8, n).
        """
        return {m.name: self._values_of(m, statistics[self._places[m.name]]) for m in (*self.summed, *self.filtered)}

    def _values_of(self, measure: Measure, statistics: Array) -> list[float]:
        begin, end = self._windows[measure.name]
        summed = _Summed(statistics, end - begin, self._step)
        values: list[float] = _STREAMED[measure.statistic](summed).tolist()
        return values

    def _is_known(self, measure: Measure) -> bool:
        begin, end = self._windows[measure.name]
        return not measure.function and measure.statistic in _STREAMED and end - begin >= 2

    def _quantities_of(self, measure: Measure) -> list[Quantity]:
        rows, weights = self._windows[measure.name], measure.weights or (1.0,) * len(measure.channels)
        if measure.statistic == "joint_rms":
            return [Quantity((c,), (w,), rows) for c, w in zip(measure.channels, weights, strict=True)]
        inside = (measure.options["from"], measure.options["to"]) if measure.statistic == "share" else (-np.inf, np.inf)
        limits = measure.statistic in _WITH_LIMITS
        return [Quantity(measure.channels, weights, rows, measure.statistic == "work", inside, limits)]


def _bands(measures: Sequence[Measure], times: Array) -> dict[ChannelBand, Sections]:
    """Return the filter of every channel of a measure with a band, if lanes can filter it."""
    rate = TimeSeries(times, np.zeros((0, times.size)), (), ()).sample_rate
    found = {}
    for name, band in dict.fromkeys((c, m.band) for m in measures if m.band is not None for c in m.channels):
        sections = sections_of(*band, rate)
        if sections is not None and times.size > sections.pad:
            found[name, band] = sections
    return found


def _window(measure: Measure, times: Array, settling: float) -> tuple[int, int]:
    """Return the rows of a measure, as cosim.study.measures.Filtered does."""
    first, last = measure.section or (-np.inf, np.inf)
    begin, end = np.searchsorted(times, (max(first, settling) - 1e-9, last + 1e-9)).tolist()
    return begin, end
