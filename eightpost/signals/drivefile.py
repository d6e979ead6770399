"""Drive files: piecewise-linear commands."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from eightpost.array_types import Array
from eightpost.display import Summary
from eightpost.signals.faults import Origin, check_gaps
from eightpost.signals.formats import read_series, write_series
from eightpost.signals.timeseries import Recording

if TYPE_CHECKING:
    from collections.abc import Mapping

    from eightpost.signals.raw_record import ChannelMap
    from eightpost.signals.timeseries import TimeSeries


_EVEN_SHARE = 0.9  #: Minimum share of equal time steps for which the other steps are gaps.


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Drivefile(Recording):
    """A time series as a continuous signal: linear between samples, constant before the first and after the last."""

    series: TimeSeries  #: Samples of the signal.
    _integral: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        time, values = self.series.time, self.series.values
        areas = 0.5 * (values[:, 1:] + values[:, :-1]) * np.diff(time)
        integral = np.concatenate([np.zeros((values.shape[0], 1)), np.cumsum(areas, axis=1)], axis=1)
        integral.setflags(write=False)
        object.__setattr__(self, "_integral", integral)

    @classmethod
    def read(
        cls, path: str | Path, *, channel_map: ChannelMap | None = None, units: Mapping[str, str] | None = None
    ) -> Drivefile:
        """Read a drive file in any format that `read_series` reads.

        Raises:
            DataError: The file has a fault; see `read_series`.
            TimeGapError: Samples are missing in an even time grid. An uneven grid has no gaps.
        """
        series = read_series(path, channel_map=channel_map, units=units)
        steps = np.diff(series.time)
        median = float(np.median(steps)) if steps.size else 0.0
        if steps.size and np.mean(np.abs(steps - median) < 0.25 * median) >= _EVEN_SHARE:
            check_gaps(series.time, origin=Origin(path=Path(path)))
        return cls(series)

    def write(self, path: str | Path) -> None:
        """Write the drive file in the format given by the suffix of `path`."""
        write_series(self.series, path)

    def _summary(self) -> Summary:
        return Summary.of("Drive file", *self.series.summary_rows())

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the C channels."""
        return self.series.names

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the C channels."""
        return self.series.units

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return self.series.duration

    def at(self, t: float) -> Array:
        """Return the values (C,) at the time `t` [s]."""
        return self.sample(np.array([t]))[:, 0]

    def sample(self, times: Array) -> Array:
        """Return the values (C, K) at `times` (K,) [s]."""
        rows = [np.interp(times, self.series.time, row) for row in self.series.values]
        return np.stack(rows) if rows else np.empty((0, times.size))

    def mean(self, start: float, stop: float) -> Array:
        """Return the exact mean (C,) between two times [s]; if they are equal, the value at this time."""
        if start == stop:
            return self.at(start)
        return self.means(np.array([start, stop]))[:, 0]

    def means(self, times: Array) -> Array:
        """Return the exact means (C, K) over the K intervals between `times` (K+1,) [s], increasing.

        Raises:
            ValueError: The times do not increase.
        """
        widths = np.diff(times)
        if not (widths > 0.0).all():
            raise ValueError("the times must increase")
        grid, values = self.series.time, self.series.values
        left = np.clip(np.searchsorted(grid, times, side="right") - 1, 0, grid.size - 1)
        before = np.minimum(times - grid[0], 0.0)
        inside = np.maximum(times, grid[0]) - grid[left]
        partial = 0.5 * (values[:, left] + self.sample(np.maximum(times, grid[0]))) * inside
        # Integral from the first sample to each time; the end values are held outside the samples.
        primitive = self._integral[:, left] + partial + values[:, :1] * before
        means: Array = np.diff(primitive, axis=1) / widths
        return means
