"""Time series: named channels on one time axis, in SI, and the base of objects whose content is one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from eightpost.array_types import Array
from eightpost.display import Summarized, Summary, some
from eightpost.errors import InputError, MissingChannelError, suggestion
from eightpost.labelled import data_frame, dataset
from eightpost.signals.faults import check_finite, check_time
from eightpost.units import SI_UNITS, conversion, si_unit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import pandas as pd
    import xarray as xr
    from numpy.typing import ArrayLike, NDArray

    from eightpost.report.pictures import Picture


# ---- Time series ----------------------------------------------------------------------------------------------------

JITTER = 0.25  #: Maximum deviation from an even grid, in steps, that is attributed to rounding of time by a logger.


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TimeSeries(Summarized):
    """Channels sampled at common times; all checks are done when the object is created.

    Raises:
        ValueError: Shapes disagree, a name is not unique, or a unit is not SI.
        NotANumberError: A sample is NaN or infinite.
        BackwardTimeError: Time decreases.
        DuplicateTimeError: Time repeats.

    The arrays are read-only. Input arrays that other code could write to are copied.
    """

    time: Array  #: Strictly increasing times (N,) [s].
    values: Array  #: Samples (C, N), each row in the SI unit of its channel.
    names: tuple[str, ...]  #: C unique channel names.
    units: tuple[str, ...]  #: C SI unit symbols, such as `m/s`.

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", _protected(self.time))
        object.__setattr__(self, "values", _protected(self.values))
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "units", tuple(self.units))
        self._check_shapes()
        for name, unit in zip(self.names, self.units, strict=True):
            if unit not in SI_UNITS and conversion(unit, si_unit(unit)) != (1.0, 0.0):
                raise ValueError(f"channel {name!r} must be in the SI unit {si_unit(unit)!r}, not in {unit!r}")
        check_finite(self.time, channel="time")
        check_time(self.time)
        for name, row in zip(self.names, self.values, strict=True):
            check_finite(row, channel=name)

    def _check_shapes(self) -> None:
        expected = (len(self.names), self.time.size)
        if self.time.ndim != 1 or self.time.size == 0:
            raise ValueError(f"time must be a vector with at least one sample, not of shape {self.time.shape}")
        if self.values.shape != expected:
            raise ValueError(f"values must have shape (channels, samples) = {expected}, not {self.values.shape}")
        if len(self.units) != len(self.names):
            raise ValueError(f"there are {len(self.names)} channels but {len(self.units)} units")
        repeated = sorted({name for name in self.names if self.names.count(name) > 1})
        if repeated:
            raise ValueError(f"channel names must be unique; repeated: {', '.join(repeated)}")

    @classmethod
    def from_channels(cls, time: ArrayLike, channels: Mapping[str, tuple[str, ArrayLike]]) -> TimeSeries:
        """Create a series from `{name: (SI unit, values (N,))}`."""
        times = np.asarray(time, dtype=np.float64)
        rows = [np.asarray(values, dtype=np.float64) for _, values in channels.values()]
        values = np.stack(rows) if rows else np.empty((0, times.size))
        return cls(times, _read_only(values), tuple(channels), tuple(unit for unit, _ in channels.values()))

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def __getitem__(self, name: str) -> Array:
        """Return the channel `name` (N,) in its SI unit."""
        row: Array = self.values[self._index(name)]
        return row

    def __len__(self) -> int:
        return int(self.time.size)

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise MissingChannelError(f"no such channel; {suggestion(str(name), self.names)}", channel=name)
        return self.names.index(name)

    def _summary(self) -> Summary:
        return Summary.of("TimeSeries", *self.summary_rows())

    def summary_rows(self) -> tuple[tuple[str, str], ...]:
        """Return the time and the channels as rows of a summary."""
        first, last = self.time[0], self.time[-1]
        named = [f"{name} [{unit}]" for name, unit in zip(self.names, self.units, strict=True)]
        return ("time", f"{first:g} to {last:g} s, {len(self)} samples"), ("channels", some(named))

    def plot(
        self,
        channels: str | Sequence[str] = (),
        *,
        start: float | None = None,
        stop: float | None = None,
        title: str = "",
    ) -> Picture:
        """Return a picture of channels over time.

        Args:
            channels: Names of the channels; default: the first twelve.
            start: Start of the shown part [s]; default: so that a long series shows its middle.
            stop: End of the shown part [s].
            title: Title of the picture.

        Raises:
            MissingChannelError: There is no such channel.
            InputError: There is no sample between start and stop, or the series has no channel or only one sample.
        """
        from eightpost.report.pictures import picture  # noqa: PLC0415 -- matplotlib takes long to load

        return picture(self, channels, start=start, stop=stop, title=title)

    def to_pandas(self) -> pd.DataFrame:
        """Return a DataFrame with a column for each channel, in SI, over the time [s].

        Raises:
            MissingExtraError: pandas is not installed.
        """
        columns = dict(zip(self.names, self.values, strict=True))
        return data_frame(columns, self.time, "time", dict(zip(self.names, self.units, strict=True)))

    def to_xarray(self) -> xr.Dataset:
        """Return a Dataset with a variable for each channel, in SI, over the coordinate `time` [s].

        Raises:
            MissingExtraError: xarray is not installed.
        """
        rows = zip(self.names, self.values, self.units, strict=True)
        variables = {name: (("time",), values, unit) for name, values, unit in rows}
        return dataset(variables, {"time": (("time",), self.time, "s")})

    def unit(self, name: str) -> str:
        """Return the SI unit of the channel `name`."""
        return self.units[self._index(name)]

    @property
    def duration(self) -> float:
        """Time from the first sample to the last [s]."""
        return float(self.time[-1] - self.time[0])

    @property
    def is_uniform(self) -> bool:
        """Whether every sample is within a quarter step of an even grid.

        Times that a logger wrote with few digits (0.0033, 0.0034, ...) are uniform in this sense.
        """
        if self.time.size < 3:
            return True
        even = np.linspace(self.time[0], self.time[-1], self.time.size)
        return bool(np.abs(self.time - even).max() <= JITTER * (even[1] - even[0]))

    @property
    def sample_rate(self) -> float:
        """Sample rate [Hz], from the mean step of a uniform series, otherwise from the median step.

        Raises:
            ValueError: The series has one sample.
        """
        if self.time.size < 2:
            raise ValueError("a single sample has no sample rate")
        if self.is_uniform:
            return (self.time.size - 1) / self.duration
        return 1.0 / float(np.median(np.diff(self.time)))

    def select(self, names: Iterable[str]) -> TimeSeries:
        """Return a series with the channels `names` in this order."""
        rows = [self._index(name) for name in names]
        units = tuple(self.units[row] for row in rows)
        return TimeSeries(self.time, _read_only(self.values[rows]), tuple(self.names[row] for row in rows), units)

    def window(self, start: float, stop: float) -> TimeSeries:
        """Return the samples with `start <= time <= stop` [s]; the times are not shifted.

        Raises:
            InputError: There is no such sample.
        """
        first, last = np.searchsorted(self.time, start, "left"), np.searchsorted(self.time, stop, "right")
        if not first < last:
            span = f"{self.time[0]:g} to {self.time[-1]:g} s"
            raise InputError(f"there is no sample between {start:g} and {stop:g} s; the series covers {span}")
        return self.at(slice(first, last))

    def at(self, chosen: slice | NDArray[np.bool_]) -> TimeSeries:
        """Return the chosen samples: a slice of positions, or whether each sample (N,) is kept."""
        return TimeSeries(self.time[chosen], self.values[:, chosen], self.names, self.units)

    def with_channel(self, name: str, unit: str, values: ArrayLike) -> TimeSeries:
        """Return a series with the channel `name` added, or replaced if it exists.

        Args:
            name: Name of the channel.
            unit: SI unit of the channel.
            values: Samples (N,).
        """
        channels = {n: (u, row) for n, u, row in zip(self.names, self.units, self.values, strict=True)}
        channels[name] = (unit, np.asarray(values, dtype=np.float64))
        return TimeSeries.from_channels(self.time, channels)

    def resample(self, rate: float) -> TimeSeries:
        """Return the series on an even grid of `rate` [Hz] by linear interpolation.

        No anti-aliasing filter is applied: use a low-pass before resampling to a lower rate.

        Raises:
            ValueError: The rate is not positive.
        """
        if not rate > 0.0:
            raise ValueError(f"the rate must be positive, not {rate:g} Hz")
        count = int(np.floor(self.duration * rate * (1.0 + 1e-12))) + 1
        grid = self.time[0] + np.arange(count) / rate
        values = np.stack([np.interp(grid, self.time, row) for row in self.values])
        return TimeSeries(grid, values, self.names, self.units)


def _protected(values: ArrayLike) -> Array:
    """Return a read-only float64 array in C order; the array is copied unless it is already read-only."""
    if isinstance(values, np.ndarray) and values.dtype == np.float64 and _is_read_only(values):
        return _read_only(np.ascontiguousarray(values))
    return _read_only(np.array(values, dtype=np.float64, order="C"))


def _read_only(values: Array) -> Array:
    """Set an unshared array to read-only and return it; avoids copies, which have 0.5 GB at the rig's sample rate."""
    values.setflags(write=False)
    return values


def _is_read_only(values: NDArray[Any]) -> bool:
    """Return whether an array and all arrays that it is a view of are read-only."""
    owner: object = values
    while isinstance(owner, np.ndarray):
        if owner.flags.writeable:
            return False
        owner = owner.base
    return owner is None


@dataclass(frozen=True, slots=True, eq=False, repr=False, init=False)
class StoredSeries(TimeSeries):
    """A series whose channels are read each time they are used, and kept only if `values` asks for all of them."""

    rows: Mapping[str, Callable[[], Array]]  #: Functions that return the checked samples (N,), by channel.

    def __init__(self, time: Array, rows: Mapping[str, Callable[[], Array]], units: tuple[str, ...]) -> None:
        for name, value in (("time", time), ("names", tuple(rows)), ("units", units), ("rows", rows)):
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> Array:
        """Return the samples (C, N) when `values`, which has no value at first, is asked for."""
        if name != "values":
            raise AttributeError(name)
        object.__setattr__(self, name, self.at(slice(None)).values)
        return self.values

    def __getitem__(self, name: str) -> Array:
        return _read_only(self.rows[self.names[self._index(name)]]()[:])

    def select(self, names: Iterable[str]) -> TimeSeries:
        """Return a series with the channels `names` in this order, which are not read."""
        units = {name: self.unit(name) for name in names}
        return StoredSeries(self.time, {name: self.rows[name] for name in units}, tuple(units.values()))

    def at(self, chosen: slice | NDArray[np.bool_]) -> TimeSeries:
        """Return the chosen samples, in memory."""
        time = self.time[chosen]
        values = np.empty((len(self.names), time.size))
        for row, name in zip(values, self.names, strict=True):
            row[:] = self[name][chosen]
        return TimeSeries(time, _read_only(values), self.names, self.units)

    def with_channel(self, name: str, unit: str, values: ArrayLike) -> TimeSeries:
        """Return a series with the channel `name`, which is in memory, added or replaced."""
        row = np.array(values, dtype=np.float64)
        units = {**dict(zip(self.names, self.units, strict=True)), name: unit}
        return StoredSeries(self.time, {**self.rows, name: lambda: row}, tuple(units.values()))


class Recording(Summarized):
    """Object with channels over time, which a notebook shows in a few lines and turns into tables."""

    __slots__ = ()

    if TYPE_CHECKING:

        @property
        def series(self) -> TimeSeries:
            """Channels over time."""

    def _title(self) -> str:
        """Return the title of a picture of the channels."""
        return ""

    def plot(
        self, channels: str | Sequence[str] = (), *, start: float | None = None, stop: float | None = None
    ) -> Picture:
        """Return a picture of channels over time.

        Args:
            channels: Names of the channels; default: the first twelve.
            start: Start of the shown part [s]; default: so that a long recording shows its middle.
            stop: End of the shown part [s].

        Raises:
            MissingChannelError: There is no such channel.
            InputError: There is no sample between start and stop.
        """
        return self.series.plot(channels, start=start, stop=stop, title=self._title())

    def to_pandas(self) -> pd.DataFrame:
        """Return the channels, in SI, over the time [s]; units are in `attrs["units"]`.

        Raises:
            MissingExtraError: pandas is not installed.
        """
        return self.series.to_pandas()

    def to_xarray(self) -> xr.Dataset:
        """Return the channels, in SI, over the coordinate `time` [s].

        Raises:
            MissingExtraError: xarray is not installed.
        """
        return self.series.to_xarray()
